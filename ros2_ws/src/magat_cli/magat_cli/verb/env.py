# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Print the environment in which processes join a team, for eval."""

import argparse
import shlex
from typing import TYPE_CHECKING

from magat_cli.options import Options, domain

if TYPE_CHECKING:
    from rich.console import Console

NEEDS_ROS = True  # it names a file of the installed workspace


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument("--domain", type=domain, default=0, help="ROS domain of the team (default: 0)")
    parser.add_argument(
        "--server", default="", metavar="HOST", help="of the team's discovery server (default: none, this host only)"
    )
    parser.add_argument("--tools", action="store_true", help="for tools that list topics and nodes")


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from magat_bringup.environment import Network

    network = Network(options.domain, options.server)
    for name, value in (network.tool_variables if options.tools else network.variables).items():
        print(f"export {name}={shlex.quote(value)}")
    return 0
