"""The ``magat`` command."""

import argparse
import sys
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from magat_bringup import execution, interruption
from magat_bringup.bag import BagError
from magat_bringup.environment import NetworkError, NoDomainError
from magat_bringup.processes import TeamError
from magat_bringup.sets import TEST_SETS
from magat_bringup.team import TeamFileError
from magat_robot.policy.config import ENCODINGS, ModelError
from magat_robot.policy.deployment import BACKENDS
from magat_sim.case import InvalidCaseError
from magat_sim.shield import SHIELDS
from magat_training.cases import SET_SEED, SPLITS
from magat_training.data import DataSetError
from magat_viewer.address import HOST, PORT, ServerError
from magat_viewer.browser import BrowserError

#: Beyond it, a domain's ports are among those that systems hand out by themselves.
LAST_DOMAIN = 101
#: Exit status of a process that Ctrl-C ended.
INTERRUPTED = 130


def main(args: list[str] | None = None) -> int:
    """Run the command line ``args`` (that of the process if None); returns the exit status."""
    options = _parser().parse_args(args)
    interruption.watch()
    console = Console(stderr=options.command != "run")
    try:
        return options.execute(options, console)
    except KeyboardInterrupt as interrupt:
        console.print(f"interrupted: {str(interrupt) or 'every process has ended'}")
        return INTERRUPTED
    except (
        TeamError,
        TeamFileError,
        ModelError,
        NoDomainError,
        NetworkError,
        InvalidCaseError,
        DataSetError,
        BagError,
        ServerError,
        BrowserError,
    ) as error:
        console.print(f"[bold red]magat:[/] {escape(str(error))}", highlight=False)
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="magat", description="Learned, decentralised multi-robot path planning on ROS 2."
    )
    commands = parser.add_subparsers(dest="command", required=True)

    run = commands.add_parser("run", help="start a team, one process a robot, and run episodes on it")
    run.set_defaults(execute=execution.run_command)
    run.add_argument("--episodes", type=_positive, default=10, help="as many as --scen has files, if that is given")
    run.add_argument(
        "--first", type=int, default=SPLITS["test"].start, help="number of the first case (default: unseen)"
    )
    run.add_argument("--output", type=Path, default=Path("runs/latest"), help="folder for results, pictures and logs")
    robots = run.add_mutually_exclusive_group()
    robots.add_argument("--team", type=Path, metavar="FILE", help="YAML file that names the robots")
    robots.add_argument("--crew", type=_positive, default=1, metavar="M", help="robots in each process (default: 1)")
    run.add_argument("--radio", choices=["direct", "relayed"], default="direct", help="relayed: by the simulator")
    run.add_argument("--backend", choices=BACKENDS, default="torch", help="what computes the policy")
    run.add_argument("--params", type=Path, metavar="FILE", help="ROS parameter file for every process")
    run.add_argument("--view", action="store_true", help="show the team in a browser of this machine")
    run.add_argument("--rviz", action="store_true", help="publish map, markers, tf and diagnostics for RViz, Foxglove")
    run.add_argument(
        "--respawn",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="start processes again that a signal has killed (default: yes)",
    )
    run.add_argument("--verbose", action="store_true", help="show all that the processes say, not only warnings")
    run.add_argument(
        "--interface",
        default="",
        metavar="NAME",
        help="open the team to this interface's network, given by name or IPv4 address (default: to nobody)",
    )
    run.add_argument("--domain", type=_domain, help="ROS domain (default: one that no other run has)")
    run.add_argument(
        "--no-robots", dest="start_robots", action="store_false", help="wait for robots that are started elsewhere"
    )
    run.add_argument(
        "--ready-timeout", type=_seconds, metavar="SECONDS", help="wait so long for robots (default: 60 or more)"
    )
    run.add_argument(
        "--record",
        type=Path,
        nargs="?",
        const=Path(),
        metavar="FOLDER",
        help="write all that the team says to a rosbag2 folder (default: bag in the output folder)",
    )
    run.add_argument("--require", type=int, default=0, metavar="N", help="fail unless N episodes are complete")

    environment = commands.add_parser("env", help="print the environment in which processes join a team, for eval")
    environment.set_defaults(execute=execution.env_command)
    environment.add_argument("--domain", type=_domain, default=0, help="ROS domain of the team (default: 0)")
    environment.add_argument(
        "--server", default="", metavar="HOST", help="of the team's discovery server (default: none, on this host only)"
    )
    environment.add_argument("--tools", action="store_true", help="for tools that list topics and nodes")

    record = commands.add_parser("record", help="join a team that runs, and write all that it says to a rosbag2 folder")
    record.set_defaults(execute=execution.record_command)
    record.add_argument("folder", type=Path, help="of the bag; it must not be there yet")

    deploy = commands.add_parser(
        "deploy", help="send a policy to the robots of a team that runs: all switch between two episodes, or none does"
    )
    deploy.set_defaults(execute=execution.deploy_command)
    deploy.add_argument("policy", help="name of a policy in models/, or its folder")

    for joining in (record, deploy):
        joining.add_argument("--namespace", help="of the team, such as /warehouse (default: that of the only one)")

    recover = commands.add_parser("recover", help="finish a bag whose recorder was killed, or save what is undamaged")
    recover.set_defaults(execute=execution.recover_command)
    recover.add_argument("bag", type=Path)
    recover.add_argument("--output", type=Path, help="folder of the bag to write (default: BAG_recovered)")

    analyze = commands.add_parser("analyze", help="measures, timing, attention and deadlocks of a recorded team")
    analyze.set_defaults(execute=execution.analyze_command)
    analyze.add_argument("bag", type=Path)
    analyze.add_argument(
        "--policy", help="name or folder of the policy that the robots carried (default: by its digest)"
    )
    analyze.add_argument("--output", type=Path, metavar="FOLDER", help="for pictures and tables (default: none)")
    analyze.add_argument("--json", action="store_true", help="print one JSON object and nothing else")

    replay = commands.add_parser(
        "replay", help="publish what was to be seen of a recorded team again, for RViz and the like"
    )
    replay.set_defaults(execute=execution.replay_command)
    replay.add_argument("bag", type=Path)
    replay.add_argument("--rate", type=_factor, default=1.0, help="times as fast as it was (default: 1)")
    replay.add_argument(
        "--delay", type=_seconds, default=1.0, metavar="SECONDS", help="wait so long for tools to find it (default: 1)"
    )
    replay.add_argument("--view", action="store_true", help="show it in a browser of this machine, as if it were live")
    replay.add_argument("--rviz", action="store_true", help="start a view, in place of what a recorded one published")

    view = commands.add_parser("view", help="show a team that runs, or a recorded one, in a browser")
    view.set_defaults(execute=execution.view_command)
    view.add_argument("bag", type=Path, nargs="?", help="of the recorded team (default: join one that runs)")
    view.add_argument("--host", default=HOST, help=f"name or address to listen on (default: {HOST}, this machine only)")
    view.add_argument("--port", type=_port, help=f"to listen on (default: the first free one from {PORT} on)")
    view.add_argument("--namespace", help="of the team that runs, such as /warehouse (default: that of the only one)")
    view.add_argument("--policy", help="name or folder of what recorded robots carried (default: by its digest)")
    view.add_argument(
        "--at",
        default="",
        metavar="PLACE",
        help='what is shown first, such as "episode=1&tick=20&robot=robot_3&theme=dark"',
    )
    view.add_argument(
        "--screenshot",
        type=Path,
        metavar="FILE",
        help="write a recorded team's page to a PNG file by Chromium, and end",
    )

    plot = commands.add_parser("plot", help="draw a recorded episode: paths, links and attention, or an animation")
    plot.set_defaults(execute=execution.plot_command)
    plot.add_argument("bag", type=Path)
    plot.add_argument("--episode", type=int, default=0, metavar="K", help="number, from 0 (default: the first)")
    plot.add_argument("--tick", type=int, metavar="N", help="whose links are drawn (default: that with most links)")
    plot.add_argument("--robot", metavar="NAME", help="draw the attention of this one alone (default: of all)")
    plot.add_argument("--policy", help="name or folder of what the robots carried (default: by its digest)")
    plot.add_argument(
        "--output", type=Path, default=Path("plot.svg"), metavar="FILE", help="SVG, PNG, PDF, or a GIF, which moves"
    )

    for joining in (record, deploy, replay, view):
        joining.add_argument("--domain", type=_domain, help="ROS domain of the team (default: the environment's)")
        joining.add_argument(
            "--server",
            default="",
            metavar="HOST",
            help="of the team's discovery server, in that domain (default: none)",
        )

    evaluate = commands.add_parser("evaluate", help="score a policy on many cases, in one process")
    evaluate.set_defaults(execute=execution.evaluate_command)
    evaluate.add_argument("--cases", type=_positive, help="how many (default: 300, or all of a set)")
    which = evaluate.add_mutually_exclusive_group()
    which.add_argument("--split", choices=sorted(SPLITS), default="test")
    which.add_argument("--map", type=Path, metavar="FILE", help="MovingAI's .map, with --scen, instead of drawn cases")
    which.add_argument(
        "--set", choices=TEST_SETS, help="one of the paper's, size by size, kept in runs/sets; run again to resume"
    )
    evaluate.add_argument("--workers", type=_positive, default=1, help="processes")
    evaluate.add_argument("--temperature", type=float, help="sampling temperature instead of the policy's own")
    evaluate.add_argument("--json", action="store_true", help="print one JSON object and nothing else")

    pogema = commands.add_parser("pogema", help="score a policy in POGEMA's world (an extra: requirements-pogema.txt)")
    pogema.set_defaults(execute=execution.pogema_command)
    pogema.add_argument("--cases", type=_positive, default=100, help="of the test split (default: 100)")
    pogema.add_argument("--json", action="store_true", help="print one JSON object and nothing else")

    data = commands.add_parser("data", help="data sets: cases for training, validation and tests, with their solutions")
    actions = data.add_subparsers(dest="action", required=True)
    make_data = actions.add_parser("make", help="draw cases and solve them by the expert; run again to resume")
    make_data.set_defaults(execute=execution.make_data_command)
    make_data.add_argument("--cases", type=_positive, default=SPLITS["test"].stop, help="how many in all, 70/15/15 %%")
    make_data.add_argument("--output", type=Path, help="folder (default: data/[width]x[height]-[robots])")
    show_data = actions.add_parser("show", help="print what a data set holds, and verify it")
    show_data.set_defaults(execute=execution.show_data_command)
    show_data.add_argument("folder", type=Path)

    measure = commands.add_parser(
        "measure", help="score a policy on the standard sets, and keep the measures in its folder, for `magat models`"
    )
    measure.set_defaults(execute=execution.measure_command)
    measure.add_argument("--cases", type=_positive, metavar="N", help="at most N of each set (default: all)")
    measure.add_argument("--temperature", type=float, help="sampling temperature instead of the policy's own")

    models = commands.add_parser("models", help="list the policies in models/: what they are, and how good")
    models.set_defaults(execute=execution.models_command)
    models.add_argument("--json", action="store_true", help="print one JSON list and nothing else")

    frontier = commands.add_parser("frontier", help="success against flowtime, over sampling temperatures")
    frontier.set_defaults(execute=execution.frontier_command)
    frontier.add_argument("--policy", nargs="+", help="names of policies in models/, or folders (default: all there)")
    frontier.add_argument("--temperatures", type=float, nargs="+", metavar="T", help="(default: 7 from 0.25 to 2)")
    frontier.add_argument("--shield", choices=SHIELDS, nargs="+", default=list(SHIELDS), help="(default: all)")
    frontier.add_argument("--cases", type=_positive, default=300, help="of the validation split (default: 300)")
    frontier.add_argument("--output", type=Path, default=Path("runs"), help="folder for frontier.csv and frontier.png")

    for command in (run, evaluate):
        command.add_argument("--encoding", choices=ENCODINGS, default="", help="of messages (default: the policy's)")
        command.add_argument(
            "--link-loss", type=_share, default=0.0, metavar="SHARE", help="of the radio links, lost in each tick"
        )
        command.add_argument("--shield", choices=SHIELDS, default="idle", help="what keeps robots from colliding")
    run.add_argument("--map", type=Path, metavar="FILE", help="MovingAI's .map, with --scen, instead of drawn cases")
    for command in (run, evaluate):
        command.add_argument(
            "--scen", type=Path, nargs="+", metavar="FILE", help=".scen files, one case of the first robots of each"
        )
    for command in (run, evaluate, pogema, measure):
        command.add_argument("--policy", default="MAGAT-F-128", help="name of a policy in models/, or its folder")
    evaluate.epilog = "instead of a policy: HCA, Replan or PIBT, which plan without learning"
    for command in (run, evaluate, pogema, frontier, make_data):
        command.add_argument("--robots", type=_positive, default=10)
        command.add_argument("--width", type=_positive, default=20, help="cells")
        command.add_argument("--height", type=_positive, default=20, help="cells")
        command.add_argument("--density", type=float, default=0.1, help="share of obstacle cells")
        command.add_argument("--seed", type=int, default=SET_SEED, help="of the cases and of every random stream")

    results = commands.add_parser("results", help="measure the studies of docs/results.md, and write it; resumes")
    results.set_defaults(execute=execution.results_command)
    results.add_argument("--policy", nargs="+", help="names of policies in models/, or folders (default: all there)")
    results.add_argument("--study", nargs="+", metavar="NAME", help="what to measure (default: all)")
    results.add_argument("--cases", type=_positive, metavar="N", help="at most N of each set (default: all)")
    results.add_argument("--workers", type=_positive, default=1, help="processes")
    results.add_argument("--output", type=Path, default=Path("docs"), help="folder of the page (default: docs)")

    train = commands.add_parser("train", help="train a policy by imitation of the expert; run again to resume")
    train.set_defaults(execute=execution.train_command)
    train.add_argument(
        "recipe", nargs="?", default="MAGAT-F-128", help="name of a policy, or a YAML file (models/NAME/training.yaml)"
    )
    train.add_argument("--steps", type=_positive, help="optimiser steps")
    train.add_argument("--online", choices=["off", "failures", "states"], help="what the online expert corrects")
    train.add_argument("--temperature", type=float, help="sampling temperature for validation and use")
    train.add_argument("--seed", type=int, help="of the weights and of every draw")
    train.add_argument("--threads", type=_positive, default=2, help="of each process")
    train.add_argument("--data", type=Path, default=Path("data/20x20-10"), help="data set; made if there is none")
    train.add_argument("--output", type=Path, help="folder for the run and its policy (default: runs/[name])")
    train.add_argument("--no-measure", action="store_true", help="do not measure the policy on the standard sets")

    bench = commands.add_parser("bench-expert", help="time the expert on the scenario sets")
    bench.set_defaults(execute=execution.bench_expert_command)
    bench.add_argument("--cases", type=_positive, default=100, help="of each set")
    bench.add_argument("--large", action="store_true", help="also maps of up to 200x200 cells with up to 1000 robots")
    bench.add_argument("--large-cases", type=_positive, default=5, metavar="CASES", help="of each large set")
    bench.add_argument("--seed", type=int, default=SET_SEED, help="of the cases")
    bench.add_argument("--time-limit", type=_seconds, default=60.0, metavar="SECONDS", help="of each search")

    export = commands.add_parser("export", help="make a policy's form for onnxruntime, which robots run without torch")
    export.set_defaults(execute=execution.export_command)
    export.add_argument("policy", help="name of a policy in models/, or its folder")

    runtime = commands.add_parser("bench-runtime", help="how fast a team ticks, by radio and processes")
    runtime.set_defaults(execute=execution.bench_runtime_command)
    runtime.add_argument("--policy", default="MAGAT-F-128", help="name of a policy in models/, or its folder")
    runtime.add_argument(
        "--teams", type=_team, nargs="+", metavar="PxM", help="processes x robots in each", default=[(10, 1), (20, 1),
        (40, 1), (4, 10), (4, 50), (2, 500)]
    )  # fmt: skip
    runtime.add_argument("--radios", choices=["direct", "relayed"], nargs="+", default=["direct", "relayed"])
    more = runtime.add_mutually_exclusive_group()
    more.add_argument("--record", action="store_true", help="time each team a second time, while it is recorded")
    more.add_argument("--view", action="store_true", help="time each team by turns with the page, and without it")
    runtime.add_argument(
        "--backends", choices=BACKENDS, nargs="+", default=list(BACKENDS), help="what computes (default: each in turn)"
    )
    runtime.add_argument("--ticks", type=_positive, default=100, help="of each team, at least")
    runtime.add_argument("--repeat", type=_positive, default=1, help="measure all so many times, and compare medians")

    bench_view = commands.add_parser("bench-view", help="how smoothly the page draws, and what its server takes")
    bench_view.set_defaults(execute=execution.bench_view_command)
    bench_view.add_argument("--seconds", type=_seconds, default=10.0, help="of each team (default: 10)")

    bench_sim = commands.add_parser("bench-sim", help="how fast the batched simulator is, and what takes how long")
    bench_sim.set_defaults(execute=execution.bench_sim_command)
    bench_sim.add_argument("--policy", default="MAGAT-B-32-P4", help="name of a policy in models/, or its folder")
    bench_sim.add_argument("--sets", nargs="+", metavar="NAME", help='such as "200x200 (1000)" (default: all)')
    bench_sim.add_argument("--shield", choices=SHIELDS, default="idle", help="what keeps robots from colliding")
    bench_sim.add_argument("--threads", type=_positive, default=1)

    bench_training = commands.add_parser(
        "bench-training", help="observations a second in training, and what takes how long"
    )
    bench_training.set_defaults(execute=execution.bench_training_command)
    bench_training.add_argument("--policy", default="MAGAT-F-128", help="name of a policy")
    bench_training.add_argument("--threads", type=_positive, default=1)
    bench_training.add_argument("--steps", type=_positive, default=100, help="to be timed")
    bench_training.add_argument("--cases", type=_positive, default=2_000, help="training cases")
    return parser


def _seconds(text: str) -> float:
    value = float(text)
    if not value > 0.0:
        raise argparse.ArgumentTypeError(f"{text} is no time above 0 seconds")
    return value


def _domain(text: str) -> int:
    value = int(text)
    if not 0 <= value <= LAST_DOMAIN:
        raise argparse.ArgumentTypeError(f"{value} is no ROS domain: there are 0 to {LAST_DOMAIN}")
    return value


def _port(text: str) -> int:
    value = int(text)
    if not 0 < value < 2**16:
        raise argparse.ArgumentTypeError(f"{value} is no TCP port: there are 1 to {2**16 - 1}")
    return value


def _factor(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is no rate above 0")
    return value


def _share(text: str) -> float:
    value = float(text)
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text} is no share: give a number from 0 to 1")
    return value


def _team(text: str) -> tuple[int, int]:
    try:
        processes, crew = (_positive(part) for part in text.split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text} is no team: give processes x robots in each, such as 4x10") from None
    return processes, crew


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is not a positive number")
    return value


if __name__ == "__main__":
    sys.exit(main())
