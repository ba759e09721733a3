"""What the ``magat`` command does, one function a subcommand: options in, exit status out.

Each imports what it needs when it runs: torch takes a second, and ROS is not needed, nor looked for, by most.
"""

import argparse
import dataclasses
import json
import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from magat_bringup.bag import BagError
from magat_bringup.environment import Network
from magat_bringup.models import all_policies, find_policy
from magat_bringup.sets import STANDARD_SETS
from magat_sim.case import InvalidCaseError
from magat_training.cases import SPLITS

if TYPE_CHECKING:
    from magat_bringup.evaluation import Setting


def run_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.run import RunPlan, run  # ROS is not needed, nor looked for, by the other commands
    from magat_bringup.scenarios import Scenarios
    from magat_bringup.team import TeamFile, TeamPlan
    from magat_viewer.address import free_port

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
                "rviz",
                "respawn",
                "ready_timeout",
            )
        },
        view=free_port() if options.view else None,
        # Path() is what --record alone gives.
        record=options.output / "bag" if options.record == Path() else options.record,
    )
    robots = len(team.team.robots)
    scenarios = Scenarios.read(options.map, options.scen, robots) if options.map or options.scen else None
    given = {name: value for name, value in vars(options).items() if name in RunPlan.__dataclass_fields__}
    if scenarios is not None:
        of_map = {name: scenarios.size[name] for name in ("width", "height", "density")}
        given |= {"episodes": len(scenarios.cases), **of_map}
    plan = RunPlan(**given, scenarios=scenarios)
    results = run(plan, team, console)
    complete = sum(result.success for result in results)
    if complete < options.require:
        console.print(
            f"[bold red]magat:[/] only {complete} of {len(results)} episodes are complete, {options.require} required"
        )
        return 1
    return 0


def env_command(options: argparse.Namespace, _: Console) -> int:
    network = Network(options.domain, options.server)
    for name, value in (network.tool_variables if options.tools else network.variables).items():
        print(f"export {name}={shlex.quote(value)}")
    return 0


def record_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.join import record

    _join(options.domain, options.server)
    return record(options.folder, options.namespace, console)


def deploy_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.deploy import deploy

    _join(options.domain, options.server)
    deploy(find_policy(options.policy), options.namespace, console)
    return 0


def recover_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.bag import recover

    bag: Path = options.bag
    output = options.output or bag.with_name(f"{bag.resolve().stem}_recovered")
    with console.status(f"reading {bag}"):
        messages, damaged = recover(bag, output)
    chunks = f"; {damaged} damaged chunks, of at most a quarter of a second, are lost" if damaged else ""
    console.print(f"{messages} messages are in {output}{chunks}", highlight=False)
    return 0


def analyze_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.analyze import analyze, report, save, show

    findings = analyze(options.bag, options.policy, console)
    if options.output is not None:
        save(findings, options.output, console)
    if options.json:
        print(json.dumps(report(findings)))
    else:
        show(findings, Console())
    return 0


def plot_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.plot import plot

    plot(options.bag, options.episode, options.tick, options.robot, options.policy, options.output, console)
    return 0


def replay_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.replay import replay

    _join(options.domain, options.server)
    replay(options.bag, options.rate, options.rviz, options.view, options.delay, console)
    return 0


def view_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.view import save_screenshot, view_bag, view_team

    if options.bag is None:
        if options.screenshot is not None:
            raise BagError("a screenshot shows a recorded team: name its bag")
        _join(options.domain, options.server)
        view_team(options.namespace, options.host, options.port, console)
    elif options.screenshot is not None:
        save_screenshot(options.bag, options.policy, options.at, options.screenshot, console)
    else:
        view_bag(options.bag, options.policy, options.host, options.port, options.at, console)
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


def export_command(options: argparse.Namespace, console: Console) -> int:
    console.print(str(_exported(options.policy, console)), highlight=False)
    return 0


def bench_runtime_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.bench_runtime import Setting, bench_runtime, inference, summary, table

    policy = find_policy(options.policy)
    _exported(options.policy, console)
    settings = [
        Setting(processes, crew, radio, backend, recorded)
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


def bench_view_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.bench_view import CROWDS, bench_view, table

    Console().print(table(list(bench_view(CROWDS, options.seconds, console))))
    return 0


def evaluate_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.evaluation import (  # torch takes a second to import
        Contender,
        Setting,
        evaluate_baseline,
        evaluate_policy,
        evaluate_scenarios,
        table,
    )
    from magat_bringup.scenarios import Scenarios
    from magat_sim.simulator import Rules
    from magat_training.baselines import BASELINES

    setting = Setting(options.temperature, options.encoding, Rules(options.link_loss, options.shield))
    if options.set:
        return _evaluate_set(options, setting, console)
    size = {name: getattr(options, name) for name in ("width", "height", "robots", "density")}
    numbers = _case_numbers(options.split, options.cases or 300)
    last = (size, console, options.workers)
    baseline = options.policy in BASELINES
    if options.map or options.scen:
        scenarios = Scenarios.read(options.map, options.scen, options.robots)
        of = (
            Contender.of_baseline(options.policy)
            if baseline
            else Contender.of_policy(find_policy(options.policy), setting)
        )
        report = evaluate_scenarios(of, scenarios, options.seed, console, options.workers)
    elif baseline:
        report = evaluate_baseline(options.policy, numbers, options.seed, *last)
    else:
        report = evaluate_policy(find_policy(options.policy), numbers, options.seed, setting, *last)
    if options.json:
        print(json.dumps(report))
    else:
        Console().print(table(report))
    return 0


def _evaluate_set(options: argparse.Namespace, setting: "Setting", console: Console) -> int:
    from magat_bringup.points import measured
    from magat_bringup.results import table
    from magat_bringup.studies import test_set, with_cases
    from magat_training.baselines import BASELINES

    baseline = options.policy in BASELINES
    folders = [] if baseline else [find_policy(options.policy)]
    policies = {folder.name: folder for folder in folders}
    study = test_set(options.set, policies, [setting], [options.policy] if baseline else [])
    if options.cases:
        study = with_cases(study, options.cases)
    path = Path("runs/sets") / f"{options.set}.csv"
    reports = measured(study.points, path, console, options.workers, study.title)
    if options.json:
        print(json.dumps(reports))
    else:
        Console().print(table(study, reports))
    return 0


def pogema_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.pogema import evaluate_in_pogema, table

    size = {name: getattr(options, name) for name in ("width", "height", "robots", "density")}
    numbers = _case_numbers("test", options.cases)
    report = evaluate_in_pogema(find_policy(options.policy), numbers, options.seed, size, console)
    if options.json:
        print(json.dumps(report))
    else:
        Console().print(table(report))
    return 0


def measure_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.measured import measure, table

    most = options.cases or max(which.cases for which in STANDARD_SETS)
    sets = [dataclasses.replace(which, cases=min(which.cases, most)) for which in STANDARD_SETS]
    reports = measure(find_policy(options.policy), sets, console, options.temperature)
    Console().print(table((options.policy, report["digest"], report) for report in reports))
    return 0


def models_command(options: argparse.Namespace, _: Console) -> int:
    from magat_bringup.models import all_policies, describe, listing

    policies = [describe(name, folder) for name, folder in all_policies().items()]
    if options.json:
        print(json.dumps(policies))
    else:
        Console().print(listing(policies))
    return int(any(policy["error"] is not None for policy in policies))


def frontier_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.evaluation import Setting
    from magat_bringup.frontier import TEMPERATURES, draw, frontier, table
    from magat_sim.simulator import Rules

    size = {name: getattr(options, name) for name in ("width", "height", "robots", "density")}
    numbers = _case_numbers("valid", options.cases)
    temperatures = options.temperatures or TEMPERATURES
    settings = [Setting(one, rules=Rules(shield=shield)) for shield in options.shield for one in temperatures]
    path = options.output / "frontier.csv"
    reports = frontier(_policies(options.policy), settings, numbers, options.seed, size, path, console)
    draw(reports, options.output / "frontier.png")
    Console().print(table(reports))
    console.print(f"frontier.csv and frontier.png are in {options.output}")
    return 0


def results_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.results import results
    from magat_bringup.studies import STUDIES, with_cases

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


def make_data_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.data import make

    size = {name: getattr(options, name) for name in ("width", "height", "robots", "density")}
    folder = options.output or Path("data") / f"{options.width}x{options.height}-{options.robots}"
    make(folder, options.cases, options.seed, size, console)
    return 0


def show_data_command(options: argparse.Namespace, _: Console) -> int:
    from magat_bringup.data import show

    show(options.folder, Console())
    return 0


def train_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.training import train_policy

    given = {name: getattr(options, name) for name in ("steps", "online", "temperature", "seed")}
    changes = {name: value for name, value in given.items() if value is not None}
    train_policy(
        options.recipe, changes, options.data, options.output, options.threads, not options.no_measure, console
    )
    return 0


def bench_expert_command(options: argparse.Namespace, console: Console) -> int:
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


def bench_sim_command(options: argparse.Namespace, console: Console) -> int:
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


def bench_training_command(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.bench_training import bench_training, table

    bench = bench_training(options.policy, options.threads, options.steps, options.cases, console)
    Console().print(table(bench))
    return 0
