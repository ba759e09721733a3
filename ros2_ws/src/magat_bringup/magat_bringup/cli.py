"""The ``magat`` command."""

import argparse
import dataclasses
import json
import sys
from pathlib import Path

from rich.console import Console

from magat_bringup import interruption
from magat_bringup.environment import NoDomainError
from magat_bringup.models import find_policy
from magat_bringup.processes import TeamError
from magat_robot.policy.config import ModelError
from magat_sim.case import InvalidCaseError
from magat_training.cases import SET_SEED, SPLITS

#: Exit status of a process that Ctrl-C ended.
INTERRUPTED = 130


def main(args: list[str] | None = None) -> int:
    """Run the command line ``args`` (that of the process if None); returns the exit status."""
    options = _parser().parse_args(args)
    interruption.watch()
    console = Console(stderr=options.command != "run")
    try:
        return options.execute(options, console)
    except KeyboardInterrupt:
        console.print("interrupted: every process has ended")
        return INTERRUPTED
    except (TeamError, ModelError, NoDomainError, InvalidCaseError) as error:
        console.print(f"[bold red]magat:[/] {error}", highlight=False)
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
    run.add_argument("--require", type=int, default=0, metavar="N", help="fail unless N episodes are complete")

    evaluate = commands.add_parser("evaluate", help="score a policy on many cases, in one process")
    evaluate.set_defaults(execute=_evaluate)
    evaluate.add_argument("--cases", type=_positive, default=300)
    evaluate.add_argument("--split", choices=sorted(SPLITS), default="test")
    evaluate.add_argument("--temperature", type=float, help="sampling temperature instead of the policy's own")
    evaluate.add_argument("--json", action="store_true", help="print one JSON object and nothing else")

    data = commands.add_parser("data", help="draw cases, solve them by the expert, and write them to a file")
    data.set_defaults(execute=_data)
    data.add_argument("--cases", type=_positive, default=SPLITS["test"].stop, help="how many, from number 0")
    data.add_argument("--output", type=Path, required=True, help="file to write (.npz, see magat_training/data.py)")

    for command in (run, evaluate):
        command.add_argument("--policy", default="MAGAT-F-128", help="name of a policy in models/, or its folder")
    for command in (run, evaluate, data):
        command.add_argument("--robots", type=_positive, default=10)
        command.add_argument("--width", type=_positive, default=20, help="cells")
        command.add_argument("--height", type=_positive, default=20, help="cells")
        command.add_argument("--density", type=float, default=0.1, help="share of obstacle cells")
        command.add_argument("--seed", type=int, default=SET_SEED, help="of the cases and of every random stream")

    train = commands.add_parser("train", help="train a policy by imitation of the expert; run again to resume")
    train.set_defaults(execute=_train)
    train.add_argument("--policy", default="MAGAT-F-128", help="name of the policy")
    train.add_argument("--steps", type=_positive, help="optimiser steps (default: those of the shipped policy)")
    train.add_argument("--cases", type=_positive, help="training cases")
    train.add_argument("--valid-cases", type=_positive, help="validation cases")
    train.add_argument("--temperature", type=float, help="sampling temperature for validation and use")
    train.add_argument("--threads", type=_positive, default=2)
    train.add_argument("--output", type=Path, required=True, help="folder for checkpoints, the log and the policy")

    bench = commands.add_parser("bench-expert", help="time the expert on the scenario sets")
    bench.set_defaults(execute=_bench_expert)
    bench.add_argument("--cases", type=_positive, default=100, help="of each set")
    bench.add_argument("--large", action="store_true", help="also maps of up to 200x200 cells with up to 1000 robots")
    bench.add_argument("--large-cases", type=_positive, default=5, metavar="CASES", help="of each large set")
    bench.add_argument("--seed", type=int, default=SET_SEED, help="of the cases")
    bench.add_argument("--time-limit", type=_seconds, default=60.0, metavar="SECONDS", help="of each search")
    return parser


def _run(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.run import RunPlan, run  # ROS is not needed, nor looked for, by the other commands

    plan = RunPlan(**{field.name: getattr(options, field.name) for field in dataclasses.fields(RunPlan)})
    results = run(plan, console)
    complete = sum(result.success for result in results)
    if complete < options.require:
        console.print(
            f"[bold red]magat:[/] only {complete} of {len(results)} episodes are complete, {options.require} required"
        )
        return 1
    return 0


def _evaluate(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.evaluation import evaluate_policy, table  # torch takes a second to import

    size = {name: getattr(options, name) for name in ("width", "height", "robots", "density")}
    split = SPLITS[options.split]
    if options.cases > len(split):
        raise InvalidCaseError(f"the split {options.split} has {len(split)} cases, not {options.cases}")
    folder = find_policy(options.policy)
    report = evaluate_policy(folder, split[: options.cases], options.seed, options.temperature, size, console)
    if options.json:
        print(json.dumps(report))
    else:
        Console().print(table(report))
    return 0


def _data(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.training import make_data

    size = {name: getattr(options, name) for name in ("width", "height", "robots", "density")}
    make_data(options.output, options.cases, options.seed, size, console)
    return 0


def _train(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.training import train_policy

    given = {"steps": options.steps, "train_cases": options.cases, "valid_cases": options.valid_cases}
    changes = {name: value for name, value in given.items() if value is not None}
    train_policy(options.policy, options.temperature, changes, options.threads, options.output, console)
    return 0


def _bench_expert(options: argparse.Namespace, console: Console) -> int:
    from magat_bringup.bench_expert import LARGE_SETS, SETS, bench_expert, table

    counts = [(which, options.cases) for which in SETS]
    if options.large:
        counts += [(which, options.large_cases) for which in LARGE_SETS]
    Console().print(table(counts, bench_expert(counts, options.seed, options.time_limit, console)))
    return 0


def _seconds(text: str) -> float:
    value = float(text)
    if not value > 0.0:
        raise argparse.ArgumentTypeError(f"{text} is no time above 0 seconds")
    return value


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is not a positive number")
    return value


if __name__ == "__main__":
    sys.exit(main())
