# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Make and verify data sets: cases with the expert's solutions."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_size, add_workers, positive, size_of

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    from magat_evaluation.splits import SPLITS

    actions = parser.add_subparsers(dest="action", required=True)
    make = actions.add_parser("make", help="draw cases and solve them; run again to resume")
    make.add_argument("--cases", type=positive, default=SPLITS["test"].stop, help="number of cases, split 70/15/15 %%")
    make.add_argument("--output", type=Path, help="folder (default: data/[width]x[height]-[robots])")
    add_size(make)
    add_workers(make)
    show = actions.add_parser("show", help="verify a data set and print its contents")
    show.add_argument("folder", type=Path)


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from rich.console import Console

    from magat_training.make_data import make, show

    if options.action == "show":
        show(options.folder, Console())
    else:
        folder = options.output or Path("data") / f"{options.width}x{options.height}-{options.robots}"
        make(folder, options.cases, options.seed, size_of(options), console, options.workers)
    return 0
