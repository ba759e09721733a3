# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Draw a recorded episode: paths, links and attention, or an animation."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument("bag", type=Path)
    parser.add_argument("--episode", type=int, default=0, metavar="K", help="its number, from 0 (default: 0)")
    parser.add_argument(
        "--tick", type=int, metavar="N", help="whose links are drawn (default: the one with most links)"
    )
    parser.add_argument("--robot", metavar="NAME", help="draw the attention of this robot only (default: of all)")
    parser.add_argument("--policy", help="name or folder of the robots' policy (default: found by its digest)")
    parser.add_argument(
        "--output", type=Path, default=Path("plot.svg"), metavar="FILE", help="SVG, PNG, PDF, or a GIF, an animation"
    )


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from magat_recording.plot import ANIMATION, plot

    if options.output.suffix == ANIMATION:
        options.without_effect(f"an animation ({ANIMATION}), which shows every tick", "tick")
    plot(options.bag, options.episode, options.tick, options.robot, options.policy, options.output, console)
    return 0
