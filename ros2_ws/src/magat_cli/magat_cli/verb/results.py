"""Measure the studies of docs/results.md, and write the page; run again to resume."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_policies, policies_of, positive

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    add_policies(parser)
    parser.add_argument("--study", nargs="+", metavar="NAME", help="what to measure (default: all studies)")
    parser.add_argument("--cases", type=positive, metavar="N", help="at most N of each set (default: all)")
    parser.add_argument("--workers", type=positive, default=1, help="processes (default: 1)")
    parser.add_argument("--output", type=Path, default=Path("docs"), help="folder of the page (default: docs)")


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from magat_evaluation.results_page import results
    from magat_evaluation.studies.studies import STUDIES, with_cases
    from magat_node.errors import MagatError

    unknown = [name for name in options.study or () if name not in STUDIES]
    if unknown:
        raise MagatError(f"there is no study {unknown[0]!r}: it is one of {', '.join(STUDIES)}")
    policies = policies_of(options)
    studies = [study(policies) for study in STUDIES.values()]
    if options.cases:
        studies = [with_cases(study, options.cases) for study in studies]
    page = results(studies, options.study or list(STUDIES), options.output, console, options.workers)
    console.print(f"{page}, its pictures and files are in {options.output}")
    return 0
