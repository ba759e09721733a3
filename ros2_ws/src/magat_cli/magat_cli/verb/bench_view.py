# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measure frames per second of the page, and the CPU time of its server."""

import argparse
from typing import TYPE_CHECKING

from magat_cli.options import Options, own_network, seconds

if TYPE_CHECKING:
    from rich.console import Console

NEEDS_ROS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument("--seconds", type=seconds, default=10.0, help="of each team (default: 10)")


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    own_network()
    from rich.console import Console

    from magat_bench.view import CROWDS, bench_view, table

    Console().print(table(list(bench_view(CROWDS, options.seconds, console))))
    return 0
