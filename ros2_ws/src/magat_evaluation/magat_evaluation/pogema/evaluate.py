"""``magat pogema``: a policy scored in POGEMA's world, by POGEMA's metrics."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from magat_evaluation.cases import solved_cases
from magat_evaluation.evaluate import set_name
from magat_evaluation.pogema.world import score
from magat_robot.policy.config import ModelError
from magat_robot.policy.store import load
from magat_sim.case import InvalidCaseError
from magat_sim.measures import wilson

#: What is averaged over the cases; CSR, a rate, has an interval, too.
METRICS = ("CSR", "ISR", "SoC", "makespan", "ep_length")


def evaluate_in_pogema(
    folder: Path, numbers: Sequence[int], seed: int, size: dict[str, Any], console: Console
) -> dict[str, Any]:
    """Score the policy in ``folder`` on the cases ``numbers`` under ``seed``, see `world.score`.

    Args:
        folder: of the policy.
        numbers: of the cases.
        seed: of cases and random streams.
        size: width, height, robots and density of the cases.
        console: shows the progress.

    Returns:
        Plain JSON values: the mean of each metric, on what, and CSR's 95 % interval.

    Raises:
        InvalidCaseError: no such cases can be drawn, or the expert solves none of them.
        ModelError: the policy cannot be used, or POGEMA is not installed.
    """
    policy = load(folder)
    solved = list(solved_cases(numbers, seed, **size))
    if not solved:
        raise InvalidCaseError(f"the expert solves none of the {len(numbers)} cases: ask for more, or for easier ones")
    with Progress(console=console, transient=True, disable=not console.is_interactive) as progress:
        task = progress.add_task("episodes", total=len(solved))
        try:
            metrics = score(policy, solved, seed, lambda: progress.advance(task))
        except ModuleNotFoundError as error:
            raise ModelError(f"{error}: pip install --no-deps -r requirements-pogema.txt") from error
    means = {name: sum(one[name] for one in metrics) / len(metrics) for name in METRICS}
    interval = wilson(round(sum(one["CSR"] for one in metrics)), len(metrics))
    named = {"policy": policy.config.name, "digest": policy.digest, "temperature": policy.config.temperature}
    return {**named, **size, "seed": seed, "first_case": numbers[0], "cases": len(metrics), **means,
            "CSR_interval": interval}  # fmt: skip


def table(report: dict[str, Any]) -> Table:
    """``report`` for people."""
    title = (
        f"{report['policy']}, T = {report['temperature']:g}, in POGEMA: {report['cases']} cases of {set_name(report)}"
    )
    result = Table(title=title, title_justify="left")
    for heading in ("metric", "mean", "95 % interval"):
        result.add_column(heading, justify="right")
    for name in METRICS:
        low, high = report["CSR_interval"]
        result.add_row(name, f"{report[name]:.3f}", f"{low:.3f} to {high:.3f}" if name == "CSR" else "")
    return result
