# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measure a policy or a baseline on many cases, in the batched simulator."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_policy, add_size, add_workers, add_world, bound, positive, seconds, size_of

if TYPE_CHECKING:
    from rich.console import Console

    from magat_evaluation.candidates import Candidate

#: Default number of drawn cases.
CASES = 300


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    from magat_evaluation.sets import TEST_SETS
    from magat_evaluation.splits import EXPERT_W, SPLITS

    parser.epilog = (
        "--policy also takes the baselines expert, HCA, Replan and PIBT, which plan without learning, and greedy, "
        "which walks towards the goal by its field of view alone"
    )
    parser.add_argument("--cases", type=positive, help=f"number of cases (default: {CASES}, or all cases of a set)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--split", choices=sorted(SPLITS), default="test", help="of drawn cases (default: test)")
    which.add_argument("--map", type=Path, metavar="FILE", help="MovingAI's .map, with --scen, instead of drawn cases")
    which.add_argument(
        "--set",
        choices=TEST_SETS,
        help="one of the paper's test sets; reports are kept in runs/sets: run again to resume",
    )
    add_workers(parser)
    parser.add_argument(
        "--expert-w", type=bound, default=EXPERT_W, metavar="W", help=f"bound of the expert (default: {EXPERT_W:g})"
    )
    parser.add_argument(
        "--expert-time",
        type=seconds,
        default=math.inf,
        metavar="SECONDS",
        help="of each search of the expert (default: a number of steps that is the same on every machine)",
    )
    parser.add_argument("--temperature", type=float, help="sampling temperature (default: the policy's own)")
    parser.add_argument(
        "--visit-memory",
        type=float,
        metavar="PENALTY",
        help="robots subtract it from log-probabilities for each earlier visit (default: the policy's own)",
    )
    parser.add_argument(
        "--json", action="store_true", help="print JSON and nothing else: an object, or a list with --set"
    )
    add_world(parser)
    add_policy(parser)
    add_size(parser)


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from rich.console import Console

    from magat_cli.output import print_json
    from magat_evaluation.baselines import BASELINES
    from magat_evaluation.candidates import Candidate, Setting
    from magat_evaluation.evaluate import evaluate_candidate, evaluate_scenarios, table
    from magat_evaluation.sets import CaseSet
    from magat_robot.policy.models import find_policy
    from magat_sim.scenarios import Scenarios
    from magat_sim.simulator import Rules

    if options.policy in BASELINES:
        fixed = ["shield"] if len(BASELINES[options.policy].shields) == 1 else []
        useless = ("link_loss", "temperature", "visit_memory", "encoding", *fixed)
        options.without_effect(f"the baseline {options.policy}", *useless)
        candidate = Candidate.of_baseline(options.policy, None if fixed else options.shield)
    else:
        folder = find_policy(options.policy)
        rules = Rules(options.link_loss, options.shield)
        setting = Setting(options.temperature, options.encoding, rules, options.visit_memory)
        candidate = Candidate.of_policy(folder, setting, folder.name if options.set else "")
    if options.set:
        options.without_effect(
            "--set", "seed", "robots", "width", "height", "density", "scen", "expert_w", "expert_time"
        )
        return _evaluate_set(options, candidate, console)
    if options.map or options.scen:
        options.without_effect("--map and --scen", "width", "height", "density", "cases", "split")
        scenarios = Scenarios.read(options.map, options.scen, options.robots)
        expert = (options.expert_w, options.expert_time)
        report = evaluate_scenarios(candidate, scenarios, options.seed, console, options.workers, *expert)
    else:
        chosen = {"cases": options.cases or CASES, "split": options.split, "seed": options.seed}
        cases = CaseSet(**size_of(options), **chosen, expert_w=options.expert_w)
        report = evaluate_candidate(candidate, cases, console, options.workers, options.expert_time)
    if options.json:
        print_json(report.to_json())
    else:
        Console().print(table(report))
    return 0


def _evaluate_set(options: Options, candidate: "Candidate", console: "Console") -> int:
    from rich.console import Console

    from magat_cli.output import print_json
    from magat_evaluation.points import measure_points
    from magat_evaluation.studies.test_sets import set_points, test_set

    study = test_set(options.set, set_points(options.set, [candidate]))
    path = study.file(Path("runs/sets"))
    points = study.select([candidate.name], most=options.cases)
    reports = measure_points(points, path, console, options.workers, study.title)
    if options.json:
        print_json([report.to_json() for report in reports])
    else:
        Console().print(study.table(reports))
    return 0
