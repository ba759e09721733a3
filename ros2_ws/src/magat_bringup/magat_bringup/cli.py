"""The ``magat`` command."""

import argparse
import dataclasses
import json
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from magat_bringup import interruption
from magat_bringup.bag import BagError
from magat_bringup.environment import Network, NetworkError, NoDomainError
from magat_bringup.models import all_policies, find_policy
from magat_bringup.processes import TeamError
from magat_bringup.sets import STANDARD_SETS, TEST_SETS
from magat_bringup.team import TeamFileError
from magat_robot.policy.config import ENCODINGS, ModelError
from magat_robot.policy.deployment import BACKENDS
from magat_sim.case import InvalidCaseError
from magat_sim.shield import SHIELDS
from magat_training.cases import SET_SEED, SPLITS
from magat_training.data import DataSetError

if TYPE_CHECKING:
    from magat_bringup.evaluation import Setting

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
    ) as error:
        console.print(f"[bold red]magat:[/] {escape(str(error))}", highlight=False)
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="magat", description="Learned, decentralised multi-robot path planning on ROS 2."
    )
    commands = parser.add_subparsers(dest="command", required=True)

    run = commands.add_parser("run", help="start a team, one process a robot, and run episodes on it")
    run.set_defaults(execute=_run)
    run.add_argument("--episodes", type=_positive, default=10)
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
    run.add_argument("--view", action="store_true", help="publish map, markers, tf and diagnostics for RViz, Foxglove")
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
    environment.set_defaults(execute=_env)
    environment.add_argument("--domain", type=_domain, default=0, help="ROS domain of the team (default: 0)")
    environment.add_argument(
        "--server", default="", metavar="HOST", help="of the team's discovery server (default: none, on this host only)"
    )
    environment.add_argument("--tools", action="store_true", help="for tools that list topics and nodes")

    record = commands.add_parser("record", help="join a team that runs, and write all that it says to a rosbag2 folder")
    record.set_defaults(execute=_record)
    record.add_argument("folder", type=Path, help="of the bag; it must not be there yet")
    record.add_argument("--namespace", help="of the team, such as /warehouse (default: that of the only one)")

    recover = commands.add_parser("recover", help="finish a bag whose recorder was killed, or save what is undamaged")
    recover.set_defaults(execute=_recover)
    recover.add_argument("bag", type=Path)
    recover.add_argument("--output", type=Path, help="folder of the bag to write (default: BAG_recovered)")

    analyze = commands.add_parser("analyze", help="measures, timing, attention and deadlocks of a recorded team")
    analyze.set_defaults(execute=_analyze)
    analyze.add_argument("bag", type=Path)
    analyze.add_argument(
        "--policy", help="name or folder of the policy that the robots carried (default: by its digest)"
    )
    analyze.add_argument("--output", type=Path, metavar="FOLDER", help="for pictures and tables (default: none)")
    analyze.add_argument("--json", action="store_true", help="print one JSON object and nothing else")

    replay = commands.add_parser(
        "replay", help="publish what was to be seen of a recorded team again, for RViz and the like"
    )
    replay.set_defaults(execute=_replay)
    replay.add_argument("bag", type=Path)
    replay.add_argument("--rate", type=_factor, default=1.0, help="times as fast as it was (default: 1)")
    replay.add_argument(
        "--delay", type=_seconds, default=1.0, metavar="SECONDS", help="wait so long for tools to find it (default: 1)"
    )
    replay.add_argument("--view", action="store_true", help="start a view, in place of what a recorded one published")

    for joining in (record, replay):
        joining.add_argument("--domain", type=_domain, help="ROS domain of the team (default: the environment's)")
        joining.add_argument(
            "--server",
            default="",
            metavar="HOST",
            help="of the team's discovery server, in that domain (default: none)",
        )

    evaluate = commands.add_parser("evaluate", help="score a policy on many cases, in one process")
    evaluate.set_defaults(execute=_evaluate)
    evaluate.add_argument("--cases", type=_positive, help="how many (default: 300, or all of a set)")
    which = evaluate.add_mutually_exclusive_group()
    which.add_argument("--split", choices=sorted(SPLITS), default="test")
    which.add_argument(
        "--set", choices=TEST_SETS, help="one of the paper's, size by size, kept in runs/sets; run again to resume"
    )
    evaluate.add_argument("--workers", type=_positive, default=1, help="processes")
    evaluate.add_argument("--temperature", type=float, help="sampling temperature instead of the policy's own")
    evaluate.add_argument("--json", action="store_true", help="print one JSON object and nothing else")

    data = commands.add_parser("data", help="data sets: cases for training, validation and tests, with their solutions")
    actions = data.add_subparsers(dest="action", required=True)
    make_data = actions.add_parser("make", help="draw cases and solve them by the expert; run again to resume")
    make_data.set_defaults(execute=_make_data)
    make_data.add_argument("--cases", type=_positive, default=SPLITS["test"].stop, help="how many in all, 70/15/15 %%")
    make_data.add_argument("--output", type=Path, help="folder (default: data/[width]x[height]-[robots])")
    show_data = actions.add_parser("show", help="print what a data set holds, and verify it")
    show_data.set_defaults(execute=_show_data)
    show_data.add_argument("folder", type=Path)

    measure = commands.add_parser(
        "measure", help="score a policy on the standard sets, and keep the measures in its folder, for `magat models`"
    )
    measure.set_defaults(execute=_measure)
    measure.add_argument("--cases", type=_positive, metavar="N", help="at most N of each set (default: all)")
    measure.add_argument("--temperature", type=float, help="sampling temperature instead of the policy's own")

    models = commands.add_parser("models", help="list the policies in models/: what they are, and how good")
    models.set_defaults(execute=_models)
    models.add_argument("--json", action="store_true", help="print one JSON list and nothing else")

    frontier = commands.add_parser("frontier", help="success against flowtime, over sampling temperatures")
    frontier.set_defaults(execute=_frontier)
    frontier.add_argument("--policy", nargs="+", help="names of policies in models/, or folders (default: all there)")
    frontier.add_argument("--temperatures", type=float, nargs="+", metavar="T", help="(default: 7 from 0.25 to 2)")
    frontier.add_argument("--cases", type=_positive, default=300, help="of the validation split (default: 300)")
    frontier.add_argument("--output", type=Path, default=Path("runs"), help="folder for frontier.csv and frontier.png")

    for command in (run, evaluate):
        command.add_argument("--encoding", choices=ENCODINGS, default="", help="of messages (default: the policy's)")
        command.add_argument(
            "--link-loss", type=_share, default=0.0, metavar="SHARE", help="of the radio links, lost in each tick"
        )
        command.add_argument("--shield", choices=SHIELDS, default="idle", help="what keeps robots from colliding")
    for command in (run, evaluate, measure):
        command.add_argument("--policy", default="MAGAT-F-128", help="name of a policy in models/, or its folder")
    evaluate.epilog = "instead of a policy: HCA, Replan or PIBT, which plan without learning"
    for command in (run, evaluate, frontier, make_data):
        command.add_argument("--robots", type=_positive, default=10)
        command.add_argument("--width", type=_positive, default=20, help="cells")
        command.add_argument("--height", type=_positive, default=20, help="cells")
        command.add_argument("--density", type=float, default=0.1, help="share of obstacle cells")
        command.add_argument("--seed", type=int, default=SET_SEED, help="of the cases and of every random stream")

    results = commands.add_parser("results", help="measure the studies of docs/results.md, and write it; resumes")
    results.set_defaults(execute=_results)
    results.add_argument("--policy", nargs="+", help="names of policies in models/, or folders (default: all there)")
    results.add_argument("--study", nargs="+", metavar="NAME", help="what to measure (default: all)")
    results.add_argument("--cases", type=_positive, metavar="N", help="at most N of each set (default: all)")
    results.add_argument("--workers", type=_positive, default=1, help="processes")
    results.add_argument("--output", type=Path, default=Path("docs"), help="folder of the page (default: docs)")

    train = commands.add_parser("train", help="train a policy by imitation of the expert; run again to resume")
    train.set_defaults(execute=_train)
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
    bench.set_defaults(execute=_bench_expert)
    bench.add_argument("--cases", type=_positive, default=100, help="of each set")
    bench.add_argument("--large", action="store_true", help="also maps of up to 200x200 cells with up to 1000 robots")
    bench.add_argument("--large-cases", type=_positive, default=5, metavar="CASES", help="of each large set")
    bench.add_argument("--seed", type=int, default=SET_SEED, help="of the cases")
    bench.add_argument("--time-limit", type=_seconds, default=60.0, metavar="SECONDS", help="of each search")

    export = commands.add_parser("export", help="make a policy's form for onnxruntime, which robots run without torch")
    export.set_defaults(execute=_export)
    export.add_argument("policy", help="name of a policy in models/, or its folder")

    runtime = commands.add_parser("bench-runtime", help="how fast a team ticks, by radio and processes")
    runtime.set_defaults(execute=_bench_runtime)
    runtime.add_argument("--policy", default="MAGAT-F-128", help="name of a policy in models/, or its folder")
    runtime.add_argument(
        "--teams", type=_team, nargs="+", metavar="PxM", help="processes x robots in each", default=[(10, 1), (20, 1),
        (40, 1), (4, 10), (4, 50), (2, 500)]
    )  # fmt: skip
    runtime.add_argument("--radios", choices=["direct", "relayed"], nargs="+", default=["direct", "relayed"])
    runtime.add_argument("--record", action="store_true", help="time each team a second time, while it is recorded")
    runtime.add_argument("--ticks", type=_positive, default=100, help="of each team, at least")

    bench_sim = commands.add_parser("bench-sim", help="how fast the batched simulator is, and what takes how long")
    bench_sim.set_defaults(execute=_bench_sim)
    bench_sim.add_argument("--policy", default="MAGAT-B-32-P4", help="name of a policy in models/, or its folder")
    bench_sim.add_argument("--sets", nargs="+", metavar="NAME", help='such as "200x200 (1000)" (default: all)')
    bench_sim.add_argument("--shield", choices=SHIELDS, default="idle", help="what keeps robots from colliding")
    bench_sim.add_argument("--threads", type=_positive, default=1)

    bench_training = commands.add_parser(
        "bench-training", help="observations a second in training, and what takes how long"
    )
    bench_training.set_defaults(execute=_bench_training)
    bench_training.add_argument("--policy", default="MAGAT-F-128", help="name of a policy")
    bench_training.add_argument("--threads", type=_positive, default=1)
    bench_training.add_argument("--steps", type=_positive, default=100, help="to be timed")
    bench_training.add_argument("--cases", type=_positive, default=2_000, help="training cases")
    return parser


def _run(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.run import RunPlan, run  # ROS is not needed, nor looked for, by the other commands
    from magat_bringup.team import TeamFile, TeamPlan

    plan = RunPlan(**{field.name: getattr(options, field.name) for field in dataclasses.fields(RunPlan)})
    team = TeamPlan(
        TeamFile.read(options.team) if options.team else TeamFile.numbered(options.robots, options.crew),
        _exported(options.policy, console).parent if options.backend == "onnx" else find_policy(options.policy),
        robots=options.start_robots,
        **{
            name: getattr(options, name)
            for name in (
                "radio",
                "link_loss",
                "shield",
                "encoding",
                "backend",
                "params",
                "view",
                "respawn",
                "ready_timeout",
            )
        },
        # Path() is what --record alone gives.
        record=options.output / "bag" if options.record == Path() else options.record,
    )
    results = run(plan, team, console)
    complete = sum(result.success for result in results)
    if complete < options.require:
        console.print(
            f"[bold red]magat:[/] only {complete} of {len(results)} episodes are complete, {options.require} required"
        )
        return 1
    return 0


def _env(options: argparse.Namespace, _: Console) -> int:
    network = Network(options.domain, options.server)
    for name, value in (network.tool_variables if options.tools else network.variables).items():
        print(f"export {name}={shlex.quote(value)}")
    return 0


def _record(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.join import record

    _join(options.domain, options.server)
    return record(options.folder, options.namespace, console)


def _recover(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.bag import recover

    bag: Path = options.bag
    output = options.output or bag.with_name(f"{bag.resolve().stem}_recovered")
    with console.status(f"reading {bag}"):
        messages, damaged = recover(bag, output)
    chunks = f"; {damaged} damaged chunks, of at most a quarter of a second, are lost" if damaged else ""
    console.print(f"{messages} messages are in {output}{chunks}", highlight=False)
    return 0


def _analyze(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.analyze import analyze, report, save, show

    findings = analyze(options.bag, options.policy, console)
    if options.output is not None:
        save(findings, options.output, console)
    if options.json:
        print(json.dumps(report(findings)))
    else:
        show(findings, Console())
    return 0


def _replay(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.replay import replay

    _join(options.domain, options.server)
    replay(options.bag, options.rate, options.view, options.delay, console)
    return 0


def _join(domain: int | None, server: str) -> None:
    """From now on speak where a team does: in the environment's ROS domain if ``domain`` is None."""
    if domain is not None:
        os.environ.update(Network(domain, server).tool_variables)


def _exported(policy: str, console: Console) -> Path:
    """The folder of the policy for onnxruntime, made if it is not there."""
    from magat_robot.policy.export import exported

    with console.status(f"exporting {policy} for onnxruntime"):
        return exported(find_policy(policy))


def _export(options: argparse.Namespace, console: Console) -> int:
    console.print(str(_exported(options.policy, console)), highlight=False)
    return 0


def _bench_runtime(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.bench_runtime import Setting, bench_runtime, inference, summary, table

    policy = find_policy(options.policy)
    _exported(options.policy, console)
    settings = [
        Setting(processes, crew, radio, backend, recorded)
        for processes, crew in options.teams
        for radio in options.radios
        for backend in ("torch", "onnx", "echo")
        for recorded in ((False, True) if options.record else (False,))
    ]
    results = list(bench_runtime(settings, policy, options.ticks, console))
    printer = Console()
    printer.print(table(results))
    printer.print(summary(results, {backend: inference(policy, backend) for backend in ("torch", "onnx")}))
    return 0


def _evaluate(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.evaluation import (  # torch takes a second to import
        Setting,
        evaluate_baseline,
        evaluate_policy,
        table,
    )
    from magat_sim.simulator import Rules
    from magat_training.baselines import BASELINES

    setting = Setting(options.temperature, options.encoding, Rules(options.link_loss, options.shield))
    if options.set:
        return _evaluate_set(options, setting, console)
    size = {name: getattr(options, name) for name in ("width", "height", "robots", "density")}
    numbers = _case_numbers(options.split, options.cases or 300)
    last = (size, console, options.workers)
    if options.policy in BASELINES:
        report = evaluate_baseline(options.policy, numbers, options.seed, *last)
    else:
        report = evaluate_policy(find_policy(options.policy), numbers, options.seed, setting, *last)
    if options.json:
        print(json.dumps(report))
    else:
        Console().print(table(report))
    return 0


def _evaluate_set(options: argparse.Namespace, setting: "Setting", console: Console) -> int:
    from magat_bringup import results
    from magat_training.baselines import BASELINES

    baseline = options.policy in BASELINES
    folders = [] if baseline else [find_policy(options.policy)]
    policies = {folder.name: folder for folder in folders}
    study = results.test_set(options.set, policies, [setting], [options.policy] if baseline else [])
    if options.cases:
        study = results.with_cases(study, options.cases)
    reports = results.measured(study, Path("runs/sets") / f"{options.set}.csv", console, options.workers)
    if options.json:
        print(json.dumps(reports))
    else:
        Console().print(results.table(study, reports))
    return 0


def _measure(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.measured import measure, table

    most = options.cases or max(which.cases for which in STANDARD_SETS)
    sets = [dataclasses.replace(which, cases=min(which.cases, most)) for which in STANDARD_SETS]
    reports = measure(find_policy(options.policy), sets, console, options.temperature)
    Console().print(table((options.policy, report["digest"], report) for report in reports))
    return 0


def _models(options: argparse.Namespace, _: Console) -> int:
    from magat_bringup.models import all_policies, describe, listing

    policies = [describe(name, folder) for name, folder in all_policies().items()]
    if options.json:
        print(json.dumps(policies))
    else:
        Console().print(listing(policies))
    return int(any(policy["error"] is not None for policy in policies))


def _frontier(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.frontier import TEMPERATURES, draw, frontier, table, write_csv

    size = {name: getattr(options, name) for name in ("width", "height", "robots", "density")}
    numbers = _case_numbers("valid", options.cases)
    reports = frontier(
        _policies(options.policy), options.temperatures or TEMPERATURES, numbers, options.seed, size, console
    )
    options.output.mkdir(parents=True, exist_ok=True)
    write_csv(reports, options.output / "frontier.csv")
    draw(reports, options.output / "frontier.png")
    Console().print(table(reports))
    console.print(f"frontier.csv and frontier.png are in {options.output}")
    return 0


def _results(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.results import STUDIES, results, with_cases

    unknown = [name for name in options.study or () if name not in STUDIES]
    if unknown:
        raise InvalidCaseError(f"there is no study {unknown[0]!r}: it is one of {', '.join(STUDIES)}")
    policies = _policies(options.policy)
    studies = [study(policies) for study in STUDIES.values()]
    if options.cases:
        studies = [with_cases(study, options.cases) for study in studies]
    page = results(studies, options.study or list(STUDIES), options.output, console, options.workers)
    console.print(f"{page}, its pictures and files are in {options.output}")
    return 0


def _policies(names: list[str] | None) -> dict[str, Path]:
    """Folders of the policies ``names``, of all that are there if None."""
    return {name: find_policy(name) for name in names} if names else all_policies()


def _make_data(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.data import make

    size = {name: getattr(options, name) for name in ("width", "height", "robots", "density")}
    folder = options.output or Path("data") / f"{options.width}x{options.height}-{options.robots}"
    make(folder, options.cases, options.seed, size, console)
    return 0


def _show_data(options: argparse.Namespace, _: Console) -> int:
    from magat_bringup.data import show

    show(options.folder, Console())
    return 0


def _train(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.training import train_policy

    given = {name: getattr(options, name) for name in ("steps", "online", "temperature", "seed")}
    changes = {name: value for name, value in given.items() if value is not None}
    train_policy(
        options.recipe, changes, options.data, options.output, options.threads, not options.no_measure, console
    )
    return 0


def _bench_expert(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.bench_expert import LARGE_SETS, SETS, bench_expert, table

    counts = [(which, options.cases) for which in SETS]
    if options.large:
        counts += [(which, options.large_cases) for which in LARGE_SETS]
    Console().print(table(counts, bench_expert(counts, options.seed, options.time_limit, console)))
    return 0


def _case_numbers(split: str, cases: int) -> range:
    numbers = SPLITS[split]
    if cases > len(numbers):
        raise InvalidCaseError(f"the split {split} has {len(numbers)} cases, not {cases}")
    return numbers[:cases]


def _bench_sim(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.bench_sim import SETS, bench_sim, table
    from magat_sim.simulator import Rules

    known = {which.map_name: which for which in SETS}
    unknown = [name for name in options.sets or () if name not in known]
    if unknown:
        raise InvalidCaseError(f"there is no set {unknown[0]!r}: it is one of {', '.join(known)}")
    sets = [known[name] for name in options.sets or known]
    rules = Rules(shield=options.shield)
    speeds = list(bench_sim(find_policy(options.policy), sets, rules, options.threads, console))
    Console().print(table(options.policy, speeds))
    return 0


def _bench_training(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.bench_training import bench_training, table

    bench = bench_training(options.policy, options.threads, options.steps, options.cases, console)
    Console().print(table(bench))
    return 0


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
