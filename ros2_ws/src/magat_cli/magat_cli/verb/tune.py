# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Choose a policy's sampling temperature for each shield, on validation cases; run again to resume."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_policies, add_workers, policies_of, positive

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    from magat_sim.shield import SHIELDS

    add_policies(parser)
    parser.add_argument("--shield", choices=SHIELDS, nargs="+", default=list(SHIELDS), help="(default: all)")
    parser.add_argument("--temperatures", type=float, nargs="+", metavar="T", help="(default: 5 from 0.25 to 1)")
    parser.add_argument("--cases", type=positive, metavar="N", help="at most N of each map (default: all)")
    add_workers(parser)
    parser.add_argument("--output", type=Path, default=Path("runs/tune"), help="folder (default: runs/tune)")


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    import dataclasses

    from rich.console import Console

    from magat_evaluation.tune import TEMPERATURES, TUNING_SETS, tune

    most = options.cases or max(cases.cases for cases in TUNING_SETS)
    sets = [dataclasses.replace(cases, cases=min(cases.cases, most)) for cases in TUNING_SETS]
    temperatures = options.temperatures or TEMPERATURES
    for name, folder in policies_of(options).items():
        output = options.output / f"{Path(name).name}.csv"
        chosen = tune(Path(name).name, folder, options.shield, temperatures, sets, output, console, options.workers)
        shown = ", ".join(f"{temperature:g} with {shield}" for shield, temperature in chosen.items())
        Console(soft_wrap=True).print(f"{Path(name).name}: T = {shown}, kept in {folder / 'config.json'}")
    return 0
