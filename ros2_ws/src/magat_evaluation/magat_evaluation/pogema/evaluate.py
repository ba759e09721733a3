# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat pogema``: a policy scored in POGEMA's world, by POGEMA's metrics."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from magat_evaluation.cases import solved_cases
from magat_evaluation.pogema.world import score
from magat_evaluation.sets import CaseSet, set_name
from magat_node.progress import progress_bars
from magat_robot.policy.backends import load_computed
from magat_robot.policy.config import ModelError
from magat_sim.case import InvalidCaseError
from magat_sim.measures import wilson

#: Metrics that are averaged over the cases; CSR, a rate, also has an interval.
METRICS = ("CSR", "ISR", "SoC", "makespan", "ep_length")


def evaluate_in_pogema(folder: Path, cases: CaseSet, console: Console) -> dict[str, Any]:
    """Score the policy in ``folder`` on ``cases``, see `world.score`.

    Args:
        folder: of the policy.
        cases: on what.
        console: shows the progress.

    Returns:
        Plain JSON values: what ran on which cases, the mean of each metric, and CSR's 95 % interval.

    Raises:
        InvalidCaseError: no such cases can be drawn, or the expert solves none of them.
        ModelError: the policy cannot be used, or POGEMA is not installed.
    """
    policy = load_computed(folder)
    solved = list(solved_cases(cases.numbers, cases.seed, **cases.size))
    if not solved:
        raise InvalidCaseError(f"the expert solves none of the {cases.cases} cases: ask for more, or for easier ones")
    with progress_bars(console) as progress:
        task = progress.add_task("episodes", total=len(solved))
        try:
            metrics = score(policy, solved, cases.seed, lambda: progress.advance(task))
        except ModuleNotFoundError as error:
            raise ModelError(f"{error}: pip install --no-deps -r requirements-pogema.txt") from error
    means = {name: sum(one[name] for one in metrics) / len(metrics) for name in METRICS}
    interval = wilson(round(sum(one["CSR"] for one in metrics)), len(metrics))
    named = {"policy": policy.config.name, "digest": policy.digest, "temperature": policy.config.temperature}
    numbers = {"seed": cases.seed, "first_case": cases.numbers[0], "cases": len(metrics)}
    return {**named, **cases.size, **numbers, **means, "CSR_interval": interval}


def table(report: dict[str, Any]) -> Table:
    """``report`` for the terminal."""
    place = set_name(report["width"], report["height"], report["robots"])
    title = f"{report['policy']}, T = {report['temperature']:g}, in POGEMA: {report['cases']} cases of {place}"
    result = Table(title=title, title_justify="left")
    for heading in ("metric", "mean", "95 % interval"):
        result.add_column(heading, justify="right", overflow="fold")
    for name in METRICS:
        low, high = report["CSR_interval"]
        result.add_row(name, f"{report[name]:.3f}", f"{low:.3f} to {high:.3f}" if name == "CSR" else "")
    return result
