# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measure success against flowtime over sampling temperatures; run again to resume."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_policies, add_size, policies_of, positive, size_of

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    from magat_sim.shield import SHIELDS

    add_policies(parser)
    parser.add_argument("--temperatures", type=float, nargs="+", metavar="T", help="(default: 7 from 0.25 to 2)")
    parser.add_argument("--shield", choices=SHIELDS, nargs="+", default=list(SHIELDS), help="(default: all)")
    parser.add_argument("--cases", type=positive, default=300, help="of the validation split (default: 300)")
    parser.add_argument("--output", type=Path, default=Path("runs"), help="folder for frontier.csv and frontier.png")
    add_size(parser)


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from rich.console import Console

    from magat_evaluation.sets import CaseSet
    from magat_evaluation.studies.temperatures import TEMPERATURES, frontier

    cases = CaseSet(**size_of(options), cases=options.cases, split="valid", seed=options.seed)
    study = frontier(policies_of(options), options.shield, options.temperatures or TEMPERATURES, cases)
    reports = study.measure(options.output, console)
    study.draw(reports, options.output)
    Console().print(study.table(reports))
    console.print(f"frontier.csv and frontier.png are in {options.output}")
    return 0
