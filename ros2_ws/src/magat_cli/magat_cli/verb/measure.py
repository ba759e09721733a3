# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measure a policy on the standard sets, and keep the reports in its folder, for `magat models`."""

import argparse
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_policy, positive

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument("--cases", type=positive, metavar="N", help="at most N of each set (default: all)")
    parser.add_argument("--temperature", type=float, help="sampling temperature (default: the policy's own)")
    add_policy(parser)


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    import dataclasses

    from rich.console import Console

    from magat_evaluation.measures_file import measure
    from magat_evaluation.sets import STANDARD_SETS
    from magat_evaluation.tables import table
    from magat_robot.policy.models import find_policy

    most = options.cases or max(cases.cases for cases in STANDARD_SETS)
    sets = [dataclasses.replace(cases, cases=min(cases.cases, most)) for cases in STANDARD_SETS]
    reports = measure(find_policy(options.policy), sets, console, options.temperature)
    Console().print(table((options.policy, report.digest, report) for report in reports))
    return 0
