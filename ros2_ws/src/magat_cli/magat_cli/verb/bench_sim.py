# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measure the speed of the batched simulator, and the time of each part of a step."""

import argparse
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_policy, positive

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    from magat_sim.shield import SHIELDS

    add_policy(parser, "MAGAT-B-32-P4")
    parser.add_argument("--sets", nargs="+", metavar="NAME", help='such as "200x200 (1000)" (default: all)')
    parser.add_argument(
        "--shield", choices=SHIELDS, default="idle", help="what keeps robots from colliding (default: idle)"
    )
    parser.add_argument("--threads", type=positive, default=1, help="(default: 1)")


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from rich.console import Console

    from magat_bench.sim import SETS, bench_sim, table
    from magat_node.errors import MagatError
    from magat_robot.policy.models import find_policy
    from magat_sim.simulator import Rules

    known = {which.map_name: which for which in SETS}
    unknown = [name for name in options.sets or () if name not in known]
    if unknown:
        raise MagatError(f"there is no set {unknown[0]!r}: it is one of {', '.join(known)}")
    sets = [known[name] for name in options.sets or known]
    rules = Rules(shield=options.shield)
    speeds = list(bench_sim(find_policy(options.policy), sets, rules, options.threads, console))
    Console().print(table(options.policy, speeds))
    return 0
