# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Train a policy by imitation of the expert; run again to resume."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options, positive

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument(
        "recipe", nargs="?", default="MAGAT-F-128", help="name of a policy, or a YAML file (models/NAME/training.yaml)"
    )
    parser.add_argument("--steps", type=positive, help="optimiser steps")
    parser.add_argument(
        "--online", choices=["off", "failures", "states"], help="states that the online expert corrects"
    )
    parser.add_argument("--temperature", type=float, help="sampling temperature for validation and use")
    parser.add_argument("--seed", type=int, help="of the initial weights and of all random streams")
    parser.add_argument("--threads", type=positive, default=2, help="of torch in each process (default: 2)")
    parser.add_argument(
        "--data",
        type=Path,
        default=Path("data/20x20-10"),
        help="data set; made if there is none (default: data/20x20-10)",
    )
    parser.add_argument("--output", type=Path, help="folder for the run and its policy (default: runs/[name])")
    parser.add_argument("--no-measure", action="store_true", help="do not measure the policy on the standard sets")


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from magat_training.train_policy import train_policy

    chosen = {name: getattr(options, name) for name in ("steps", "online", "temperature", "seed")}
    changes = {name: value for name, value in chosen.items() if value is not None}
    measures = not options.no_measure
    train_policy(options.recipe, changes, options.data, options.output, options.threads, measures, console)
    return 0
