"""Score a policy or a baseline on many cases, in one process."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from magat_cli.options import Options, add_policy, add_size, add_world, case_numbers, positive, size_of

if TYPE_CHECKING:
    from rich.console import Console

    from magat_evaluation.evaluate import Setting

#: Of each evaluation that names no number of cases.
CASES = 300


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    from magat_evaluation.sets import TEST_SETS
    from magat_evaluation.splits import SPLITS

    parser.epilog = "instead of a policy: HCA, Replan or PIBT, which plan without learning"
    parser.add_argument("--cases", type=positive, help=f"how many (default: {CASES}, or all cases of a set)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--split", choices=sorted(SPLITS), default="test", help="of drawn cases (default: test)")
    which.add_argument("--map", type=Path, metavar="FILE", help="MovingAI's .map, with --scen, instead of drawn cases")
    which.add_argument(
        "--set",
        choices=TEST_SETS,
        help="one of the paper's test sets; results are kept in runs/sets: run again to resume",
    )
    parser.add_argument("--workers", type=positive, default=1, help="processes (default: 1)")
    parser.add_argument("--temperature", type=float, help="sampling temperature (default: the policy's own)")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    add_world(parser)
    add_policy(parser)
    add_size(parser)


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from rich.console import Console

    from magat_cli.output import print_json
    from magat_evaluation.baselines import BASELINES
    from magat_evaluation.evaluate import (
        Contender,
        Setting,
        evaluate_baseline,
        evaluate_policy,
        evaluate_scenarios,
        table,
    )
    from magat_robot.policy.models import find_policy
    from magat_sim.scenarios import Scenarios
    from magat_sim.simulator import Rules

    baseline = options.policy in BASELINES
    if baseline:
        options.without_effect(f"the baseline {options.policy}", "shield", "link_loss", "temperature", "encoding")
    setting = Setting(options.temperature, options.encoding, Rules(options.link_loss, options.shield))
    if options.set:
        unused = ("seed", "robots", "width", "height", "density", "scen")
        options.without_effect("--set", *unused)
        return _evaluate_set(options, setting, console)
    last = (console, options.workers)
    if options.map or options.scen:
        options.without_effect("--map and --scen", "width", "height", "density", "cases", "split")
        scenarios = Scenarios.read(options.map, options.scen, options.robots)
        contender = (
            Contender.of_baseline(options.policy)
            if baseline
            else Contender.of_policy(find_policy(options.policy), setting)
        )
        report = evaluate_scenarios(contender, scenarios, options.seed, *last)
    else:
        numbers = case_numbers(options.split, options.cases or CASES)
        size: dict[str, Any] = size_of(options)
        if baseline:
            report = evaluate_baseline(options.policy, numbers, options.seed, size, *last)
        else:
            report = evaluate_policy(find_policy(options.policy), numbers, options.seed, setting, size, *last)
    if options.json:
        print_json(report)
    else:
        Console().print(table(report))
    return 0


def _evaluate_set(options: Options, setting: "Setting", console: "Console") -> int:
    from rich.console import Console

    from magat_cli.output import print_json
    from magat_evaluation.baselines import BASELINES
    from magat_evaluation.points import measured
    from magat_evaluation.results_page import table
    from magat_evaluation.studies.studies import test_set, with_cases
    from magat_robot.policy.models import find_policy

    baseline = options.policy in BASELINES
    folders = [] if baseline else [find_policy(options.policy)]
    policies = {folder.name: folder for folder in folders}
    study = test_set(options.set, policies, [setting], [options.policy] if baseline else [])
    if options.cases:
        study = with_cases(study, options.cases)
    path = Path("runs/sets") / f"{options.set}.csv"
    reports = measured(study.points, path, console, options.workers, study.title)
    if options.json:
        print_json(reports)
    else:
        Console().print(table(study, reports))
    return 0
