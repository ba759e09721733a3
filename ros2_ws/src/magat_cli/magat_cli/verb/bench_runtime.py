# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measure ticks per second of a team by radio, backend and processes."""

import argparse
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_policy, own_network, positive, team_shape

if TYPE_CHECKING:
    from rich.console import Console

NEEDS_ROS = True
TEAMS = [(10, 1), (20, 1), (40, 1), (4, 10), (4, 50), (2, 500)]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    from magat_robot.policy.config import BACKENDS

    add_policy(parser)
    shapes = " ".join(f"{processes}x{crew}" for processes, crew in TEAMS)
    parser.add_argument(
        "--teams",
        type=team_shape,
        nargs="+",
        metavar="PxM",
        default=TEAMS,
        help=f"processes x robots in each (default: {shapes})",
    )
    parser.add_argument(
        "--radios", choices=["direct", "relayed"], nargs="+", default=["direct", "relayed"], help="(default: both)"
    )
    more = parser.add_mutually_exclusive_group()
    more.add_argument("--record", action="store_true", help="measure each team also with recording")
    more.add_argument("--view", action="store_true", help="measure each team with the page and without it")
    parser.add_argument("--backends", choices=BACKENDS, nargs="+", default=list(BACKENDS), help="(default: all)")
    parser.add_argument(
        "--ticks", type=positive, default=100, help="measured ticks of each team, at least (default: 100)"
    )
    parser.add_argument("--repeat", type=positive, default=1, help="number of repetitions, for medians (default: 1)")


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    own_network()
    from rich.console import Console

    from magat_bench.runtime import RuntimeSetting, bench_runtime, inference, summary, table
    from magat_cli.verb.export import exported_policy

    policy = exported_policy(options.policy, console)
    settings = [
        RuntimeSetting(processes, crew, radio, backend, recorded)
        for processes, crew in options.teams
        for radio in options.radios
        for backend in options.backends
        for recorded in [False, *([True] * options.record)]
    ]
    results = list(bench_runtime(settings, policy, options.ticks, options.repeat, options.view, console))
    printer = Console()
    printer.print(table(results))
    printer.print(summary(results, {backend: inference(policy, backend) for backend in ("torch", "onnx")}))
    return 0
