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
    parser.add_argument(
        "recipes", nargs="*", help="names of policies, or YAML files, to compare (default: MAGAT-F-128)"
    )
    parser.add_argument("--threads", type=positive, default=1, help="(default: 1)")
    parser.add_argument("--steps", type=positive, default=100, help="number of timed steps (default: 100)")
    parser.add_argument("--cases", type=positive, default=2_000, help="training cases (default: 2,000)")


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from rich.console import Console

    from magat_bench.training import bench_training, table
    from magat_training.recipe import read_recipe

    configs = [read_recipe(recipe) for recipe in options.recipes or ["MAGAT-F-128"]]
    benches = bench_training(configs, options.threads, options.steps, options.cases, console)
    Console().print(*map(table, benches))
    return 0
