# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Start a team, one process a robot, and run episodes on it."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import (
    Options,
    add_policy,
    add_size,
    add_world,
    bound,
    domain,
    namespace,
    own_network,
    positive,
    seconds,
)

if TYPE_CHECKING:
    from rich.console import Console

NEEDS_ROS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    from magat_evaluation.splits import EXPERT_W, SPLITS
    from magat_robot.policy.config import BACKENDS

    parser.add_argument(
        "--episodes", type=positive, default=10, help="how many (default: 10; with --scen, one for each file)"
    )
    parser.add_argument(
        "--first", type=int, default=SPLITS["test"].start, help="number of the first case (default: an unseen one)"
    )
    parser.add_argument(
        "--output",
        type=Path,
        help="folder for results, pictures and logs (default: a new one in runs/, to which runs/latest leads)",
    )
    robots = parser.add_mutually_exclusive_group()
    robots.add_argument("--team", type=Path, metavar="FILE", help="YAML file that names the robots")
    robots.add_argument("--crew", type=positive, default=1, metavar="M", help="robots in each process (default: 1)")
    parser.add_argument(
        "--radio",
        choices=["direct", "relayed"],
        default="direct",
        help="robots hear each other, or what the simulator relays (default: direct)",
    )
    parser.add_argument("--backend", choices=BACKENDS, default="onnx", help="what computes the policy (default: onnx)")
    parser.add_argument("--params", type=Path, metavar="FILE", help="ROS parameter file for every process")
    parser.add_argument("--view", action="store_true", help="show the team in a browser on this machine")
    parser.add_argument(
        "--rviz", action="store_true", help="publish map, markers, tf and diagnostics for RViz, Foxglove"
    )
    parser.add_argument(
        "--respawn",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="restart processes that a signal has killed (default: yes)",
    )
    parser.add_argument("--verbose", action="store_true", help="show all log lines of the processes, not only warnings")
    parser.add_argument(
        "--interface",
        default="",
        metavar="NAME",
        help="open the team to the network of this interface, a name or an IPv4 address (default: this machine only)",
    )
    parser.add_argument("--domain", type=domain, help="ROS domain (default: one that nobody else on this machine uses)")
    parser.add_argument(
        "--namespace",
        type=namespace,
        default="",
        help="ROS namespace of the team, such as red, so that teams can share a --domain (default: the root)",
    )
    parser.add_argument(
        "--no-robots", dest="start_robots", action="store_false", help="wait for robots that are started elsewhere"
    )
    parser.add_argument(
        "--ready-timeout", type=seconds, metavar="SECONDS", help="how long to wait for robots (default: 60 or more)"
    )
    parser.add_argument(
        "--record",
        type=Path,
        nargs="?",
        const=Path(),
        metavar="FOLDER",
        help="write all messages of the team to a rosbag2 folder (default: bag in the output folder)",
    )
    parser.add_argument("--require", type=int, default=0, metavar="N", help="fail unless N episodes are complete")
    parser.add_argument(
        "--expert-w",
        type=bound,
        default=EXPERT_W,
        metavar="W",
        help=f"bound of the expert's cost over the optimum, from which T_max follows (default: {EXPERT_W:g})",
    )
    parser.add_argument("--map", type=Path, metavar="FILE", help="MovingAI's .map, with --scen, instead of drawn cases")
    parser.add_argument(
        "--secret",
        type=_secret,
        metavar="HEX",
        help="from the results of an earlier run, to repeat its episode (default: a new one for each episode)",
    )
    add_world(parser)
    add_policy(parser)
    add_size(parser)


def _secret(text: str) -> bytes:
    """The secret of an episode, from hexadecimal digits."""
    from magat_sim.streams import InvalidSecretError, check_secret

    try:
        return check_secret(bytes.fromhex(text))
    except (ValueError, InvalidSecretError) as error:
        raise argparse.ArgumentTypeError(
            f"{text} is not a secret: give the 64 hexadecimal digits of one in results.json"
        ) from error


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    own_network()
    from rich.console import Console

    from magat_bringup.run import run
    from magat_bringup.run_plan import RunPlan
    from magat_bringup.team import TeamFile, TeamPlan
    from magat_cli.verb.export import exported_policy
    from magat_node.errors import MagatError
    from magat_robot.policy.models import find_policy
    from magat_sim.scenarios import Scenarios
    from magat_viewer.address import free_port

    if options.team:
        options.without_effect("--team", "robots")
    team = TeamPlan(
        TeamFile.read(options.team) if options.team else TeamFile.numbered(options.robots, options.crew),
        exported_policy(options.policy, console) if options.backend == "onnx" else find_policy(options.policy),
        robots=options.start_robots,
        **{
            name: getattr(options, name)
            for name in (
                *("radio", "link_loss", "shield", "encoding", "backend", "params", "rviz", "respawn"),
                *("ready_timeout", "namespace"),
            )
        },
        view=free_port() if options.view else None,
    )
    given = {name: value for name, value in vars(options).items() if name in RunPlan.__dataclass_fields__}
    scenarios = None
    if options.map or options.scen:
        options.without_effect("--map and --scen", "width", "height", "density", "episodes", "first")
        scenarios = Scenarios.read(options.map, options.scen, len(team.team.robots))
        given |= {name: scenarios.size[name] for name in ("width", "height", "density")}
        given["episodes"] = len(scenarios.cases)
    plan = RunPlan(**given, scenarios=scenarios)
    if options.require > plan.episodes:
        raise MagatError(f"--require {options.require} cannot be met by {plan.episodes} episodes: lower it")
    results = run(plan, team, Console())
    complete = sum(result.success for result in results)
    if complete < options.require:
        console.print(
            f"[bold red]magat:[/] only {complete} of {len(results)} episodes are complete, {options.require} required"
        )
        return 1
    return 0
