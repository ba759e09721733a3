# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measure the studies of docs/results.md, and write the page; run again to resume."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_policies, add_workers, policies_of, positive

if TYPE_CHECKING:
    from rich.console import Console

#: The study of computation times, which has no points.
TIMES = "times"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    from magat_sim.shield import SHIELDS

    add_policies(parser)
    parser.add_argument("--study", nargs="+", metavar="NAME", help="studies to measure (default: all)")
    parser.add_argument("--shield", nargs="+", choices=SHIELDS, help="shields to measure (default: all)")
    parser.add_argument("--cases", type=positive, metavar="N", help="at most N of each set (default: all)")
    add_workers(parser)
    parser.add_argument("--output", type=Path, default=Path("docs"), help="folder of the page (default: docs)")
    parser.add_argument(
        "--no-measure", action="store_true", help="measure nothing: write the page again from its CSV files"
    )


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from magat_evaluation.results_page import write_results
    from magat_evaluation.studies.study import all_studies
    from magat_evaluation.times import update_times
    from magat_node.errors import MagatError
    from magat_robot.policy.models import all_policies

    known = all_studies()
    unknown = [name for name in options.study or () if name not in (*known, TIMES)]
    if unknown:
        raise MagatError(f"there is no study {unknown[0]!r}: it is one of {', '.join((*known, TIMES))}")
    if options.no_measure:
        options.without_effect("--no-measure", "study", "policy", "shield", "cases", "workers")
    chosen = policies_of(options)
    policies = all_policies() | chosen
    studies = [make(policies) for make in known.values()]
    names = () if options.no_measure else options.study or (*known, TIMES)
    asked = {
        study.name: study.select(chosen, options.shield, options.cases) for study in studies if study.name in names
    }
    if TIMES in names:
        update_times(chosen, options.output, console)
    page = write_results(studies, policies, asked, options.output, console, options.workers)
    console.print(f"{page}, its pictures and files are in {options.output}")
    return 0
