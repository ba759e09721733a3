# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measure the time of the expert on sets of cases."""

import argparse
from typing import TYPE_CHECKING

from magat_cli.options import Options, positive, seconds

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    from magat_evaluation.splits import SET_SEED

    parser.add_argument("--cases", type=positive, default=100, help="of each set (default: 100)")
    parser.add_argument("--large", action="store_true", help="also maps of up to 200x200 cells with up to 1,000 robots")
    parser.add_argument(
        "--large-cases", type=positive, default=5, metavar="CASES", help="of each large set (default: 5)"
    )
    parser.add_argument("--seed", type=int, default=SET_SEED, help=f"of the cases (default: {SET_SEED})")
    parser.add_argument(
        "--time-limit", type=seconds, default=60.0, metavar="SECONDS", help="of each search (default: 60)"
    )


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from rich.console import Console

    from magat_bench.expert import LARGE_SETS, SETS, bench_expert, table

    counts = [(which, options.cases) for which in SETS]
    if options.large:
        counts += [(which, options.large_cases) for which in LARGE_SETS]
    else:
        options.without_effect("the small sets alone (add --large)", "large_cases")
    Console().print(table(counts, bench_expert(counts, options.seed, options.time_limit, console)))
    return 0
