# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Publish what tools could see of a recorded team again, for RViz, Foxglove and the page."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_join, factor, join, seconds

if TYPE_CHECKING:
    from rich.console import Console

NEEDS_ROS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument("bag", type=Path)
    parser.add_argument("--rate", type=factor, default=1.0, help="how many times faster than recorded (default: 1)")
    parser.add_argument(
        "--delay", type=seconds, default=1.0, metavar="SECONDS", help="how long to wait for tools first (default: 1)"
    )
    parser.add_argument("--view", action="store_true", help="show it in a browser on this machine, as if it were live")
    parser.add_argument(
        "--rviz",
        action="store_true",
        help="compute map, markers and diagnostics anew instead of replaying recorded ones",
    )
    add_join(parser, namespace=False)


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    join(options)
    from magat_viewer.replay import replay

    replay(options.bag, options.rate, options.rviz, options.view, options.delay, console)
    return 0
