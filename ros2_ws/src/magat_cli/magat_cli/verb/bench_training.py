# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measure observations per second in training, and the time of each part of a step."""

import argparse
from typing import TYPE_CHECKING

from magat_cli.options import Options, positive

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument("--policy", default="MAGAT-F-128", help="name of a policy (default: MAGAT-F-128)")
    parser.add_argument("--threads", type=positive, default=1, help="(default: 1)")
    parser.add_argument("--steps", type=positive, default=100, help="number of timed steps (default: 100)")
    parser.add_argument("--cases", type=positive, default=2_000, help="training cases (default: 2,000)")


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from rich.console import Console

    from magat_bench.training import bench_training, table

    bench = bench_training(options.policy, options.threads, options.steps, options.cases, console)
    Console().print(table(bench))
    return 0
