# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measure a policy in POGEMA (needs the extra requirements-pogema.txt)."""

import argparse
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_policy, add_size, positive, size_of

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument("--cases", type=positive, default=100, help="number of cases of the test split (default: 100)")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    add_policy(parser)
    add_size(parser)


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from rich.console import Console

    from magat_cli.output import print_json
    from magat_evaluation.pogema.evaluate import evaluate_in_pogema, table
    from magat_evaluation.sets import CaseSet
    from magat_robot.policy.models import find_policy

    cases = CaseSet(**size_of(options), cases=options.cases, seed=options.seed)
    report = evaluate_in_pogema(find_policy(options.policy), cases, console)
    if options.json:
        print_json(report)
    else:
        Console().print(table(report))
    return 0
