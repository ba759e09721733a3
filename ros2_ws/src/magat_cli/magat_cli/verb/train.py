# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Train a policy by imitation of the expert, or all policies of the paper; run again to resume."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_workers, positive

if TYPE_CHECKING:
    from rich.console import Console

    from magat_training.train_policy import Options as Means


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument(
        "recipe", nargs="?", help="name of a policy, or a YAML file (models/NAME/training.yaml); default: MAGAT-F-128"
    )
    parser.add_argument(
        "--all",
        action="store_true",
        help="train the paper's 20 policies, the control with K = 1 and further seeds, one after another",
    )
    parser.add_argument("--install", action="store_true", help="with --all: copy the paper's policies into models/")
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
    parser.add_argument(
        "--output", type=Path, help="folder of the run (default: runs/[name]); with --all, of all runs (default: runs)"
    )
    parser.add_argument("--no-measure", action="store_true", help="do not measure the policy on the standard sets")
    add_workers(parser)


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from magat_training.train_policy import Options as Means

    chosen = {name: getattr(options, name) for name in ("steps", "online", "temperature", "seed")}
    changes = {name: value for name, value in chosen.items() if value is not None}
    means = Means(options.data, options.threads, not options.no_measure, options.workers)
    if options.all:
        return _all(options, changes, means, console)
    from magat_training.recipe import read_recipe
    from magat_training.train_policy import changed, train_policy, training_of

    options.without_effect("a single policy (give --all as well)", "install")
    config = changed(read_recipe(options.recipe or "MAGAT-F-128"), changes)
    train_policy(config, options.output or Path("runs") / training_of(config).name, means, console)
    return 0


def _all(options: Options, changes: dict, means: "Means", console: "Console") -> int:
    import os

    from rich.markup import escape

    from magat_node.errors import MagatError
    from magat_training.train_all import train_all

    options.without_effect("--all", "seed")
    if options.recipe:
        raise MagatError(f"--all trains by one recipe: remove {options.recipe}")
    if os.environ.get("WORLD_SIZE", "1") != "1":
        raise MagatError("--all does not run under torchrun: start the command several times instead")
    models = Path("models") if options.install else None
    failed = train_all(changes, options.output or Path("runs"), models, means, console)
    for name, error in failed.items():
        console.print(f"[bold red]{name} failed:[/] {escape(error)}", highlight=False, soft_wrap=True)
    return 1 if failed else 0
