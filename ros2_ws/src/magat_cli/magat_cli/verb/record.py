# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Join a running team, and write all its messages to a rosbag2 folder."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_join, join

if TYPE_CHECKING:
    from rich.console import Console

NEEDS_ROS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument("folder", type=Path, help="of the bag; it must not exist yet")
    add_join(parser)


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    join(options)
    from magat_recording.record import record

    return record(options.folder, options.namespace, console)
