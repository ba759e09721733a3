# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Finish a bag whose recorder was killed, or save what is undamaged of a bag."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument("bag", type=Path)
    parser.add_argument("--output", type=Path, help="folder of the bag to write (default: BAG_recovered)")


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from magat_recording.recovery import recover

    bag: Path = options.bag
    output = options.output or bag.with_name(f"{bag.resolve().stem}_recovered")
    with console.status(f"reading {bag}"):
        messages, damaged = recover(bag, output)
    chunks = f"; {damaged} damaged chunks, each of at most a quarter of a second, are lost" if damaged else ""
    console.print(f"{messages} messages are in {output}{chunks}", highlight=False)
    return 0
