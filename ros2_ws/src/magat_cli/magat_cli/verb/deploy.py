# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Send a policy to the robots of a running team: all switch between two episodes, or none does."""

import argparse
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_join, join

if TYPE_CHECKING:
    from rich.console import Console

NEEDS_ROS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument("policy", help="name of a policy in models/, or its folder")
    add_join(parser)


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    join(options)
    from magat_bringup.deploy import deploy
    from magat_robot.policy.models import find_policy

    deploy(find_policy(options.policy), options.namespace, console)
    return 0
