# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""List the policies in models/ with their measures."""

import argparse
from typing import TYPE_CHECKING

from magat_cli.options import Options

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument("--json", action="store_true", help="print one JSON list and nothing else")


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from rich.console import Console

    from magat_cli.output import print_json
    from magat_evaluation.listing import UnusablePolicy, describe, listing
    from magat_robot.policy.models import all_policies

    policies = [describe(name, folder) for name, folder in all_policies().items()]
    if options.json:
        print_json([policy.to_json() for policy in policies])
    else:
        Console().print(listing(policies))
    return int(any(isinstance(policy, UnusablePolicy) for policy in policies))
