"""``magat evaluate``: a policy on many cases, in the batched simulator, with progress."""

import dataclasses
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from rich.progress import Progress, track
from rich.table import Table

from magat_robot.policy.policy import Policy
from magat_robot.policy.store import load
from magat_sim.case import InvalidCaseError
from magat_sim.measures import EpisodeMeasures, summarise
from magat_sim.simulator import DEFAULT_RULES, Rules
from magat_training.baselines import BASELINES
from magat_training.cases import SolvedCase, solved_cases
from magat_training.evaluate import Planner, carried, evaluate_planner

#: Robots simulated in lockstep, those of one case at least: more of them take more memory, and no less time each.
BATCH_ROBOTS = 1000


@dataclass(frozen=True)
class Setting:
    """How a policy is run, whatever the cases."""

    #: For sampling; the policy's own if None.
    temperature: float | None = None
    #: Of messages; the policy's own if empty.
    encoding: str = ""
    #: Of the worlds.
    rules: Rules = DEFAULT_RULES

    def load(self, folder: Path) -> Policy:
        """The policy in ``folder`` as it is run.

        Raises:
            ModelError: it cannot be used, or not so.
        """
        given = {"temperature": self.temperature, "encoding": self.encoding or None}
        return load(folder, **{name: value for name, value in given.items() if value is not None})


DEFAULT_SETTING = Setting()


def evaluate_policy(
    folder: Path,
    numbers: Sequence[int],
    seed: int,
    setting: Setting,
    size: dict[str, Any],
    console: Console,
    workers: int = 1,
) -> dict[str, Any]:
    """Score the policy in ``folder`` on the cases ``numbers`` under ``seed``.

    Args:
        folder: of the policy.
        numbers: of the cases.
        seed: of cases and random streams.
        setting: how the policy is run.
        size: width, height, robots and density of the cases, and whatever else `solved_cases` takes.
        console: shows the progress.
        workers: processes, of one thread each if there are several; their number changes no measure.

    Returns:
        Plain JSON values: what was measured, on what, with 95 % intervals.

    Raises:
        InvalidCaseError: no such cases can be drawn, or the expert solves none of them.
        ModelError: the policy cannot be used, or not in this setting.
    """
    policy = setting.load(folder)
    named = {
        "policy": policy.config.name,
        "digest": policy.digest,
        "temperature": policy.config.temperature,
        "encoding": policy.config.encoding,
    }
    return named | _evaluate(partial(carried, policy), setting.rules, numbers, seed, size, console, workers)


def evaluate_baseline(
    name: str, numbers: Sequence[int], seed: int, size: dict[str, Any], console: Console, workers: int = 1
) -> dict[str, Any]:
    """Score one of the `BASELINES` in the same way; it has no weights, messages and temperature."""
    planner, shield = BASELINES[name]
    named = {"policy": name, "digest": "", "temperature": 0.0, "encoding": ""}
    return named | _evaluate(planner, Rules(shield=shield), numbers, seed, size, console, workers)


def _evaluate(
    planner: Planner,
    rules: Rules,
    numbers: Sequence[int],
    seed: int,
    size: dict[str, Any],
    console: Console,
    workers: int,
) -> dict[str, Any]:
    solved = _solved(tuple(numbers), seed, tuple(size.items()), console)
    if not solved:
        raise InvalidCaseError(f"the expert solves none of the {len(numbers)} cases: ask for more, or for easier ones")
    started = time.monotonic()
    batch = max(1, BATCH_ROBOTS // solved[0].case.robots)
    batches = [solved[start : start + batch] for start in range(0, len(solved), batch)]
    score = partial(evaluate_planner, planner, seed=seed, rules=rules)
    episodes = _in_processes(score, batches, workers, console) if workers > 1 else _here(score, batches, console)
    elapsed = time.monotonic() - started
    return {
        **dataclasses.asdict(rules),
        **size,
        "seed": seed,
        "first_case": numbers[0],
        "unsolved_by_expert": len(numbers) - len(solved),
        **dataclasses.asdict(summarise(episodes)),
        "seconds": round(elapsed, 1),
    }


@lru_cache(maxsize=1)  # one planner after the other is scored on the same cases
def _solved(
    numbers: tuple[int, ...], seed: int, size: tuple[tuple[str, Any], ...], console: Console
) -> list[SolvedCase]:
    solving = solved_cases(numbers, seed, **dict(size))
    # Where nobody watches, each bar would leave an empty line.
    hidden = not console.is_interactive
    return list(track(solving, "expert", total=len(numbers), console=console, transient=True, disable=hidden))


def _here(score: Any, batches: list[list[SolvedCase]], console: Console) -> list[EpisodeMeasures]:
    episodes: list[EpisodeMeasures] = []
    count = sum(map(len, batches))
    with Progress(console=console, transient=True, disable=not console.is_interactive) as progress:
        for batch in batches:
            first = len(episodes) + 1
            task = progress.add_task(f"episodes {first} to {first + len(batch) - 1} of {count}")
            progress.update(task, total=max(case.t_max for case in batch))
            episodes += score(batch, on_step=lambda _, task=task: progress.advance(task))
            progress.remove_task(task)
    return episodes


def _in_processes(score: Any, batches: list[list[SolvedCase]], workers: int, console: Console) -> list[EpisodeMeasures]:
    # Started anew: torch's threads do not survive a fork.
    pool = ProcessPoolExecutor(workers, get_context("spawn"), torch.set_num_threads, (1,))
    try:
        found = pool.map(score, batches)
        hidden = not console.is_interactive
        shown = track(found, "episodes", total=len(batches), console=console, transient=True, disable=hidden)
        return [measures for batch in shown for measures in batch]
    finally:
        pool.shutdown(cancel_futures=True)  # interrupted, it ends with the batches that are under way


def set_name(report: dict[str, Any]) -> str:
    """What ``report`` was measured on, e.g. 20x20 (10): cells and robots."""
    return f"{report['width']}x{report['height']} ({report['robots']})"


def table(report: dict[str, Any]) -> Table:
    """``report`` for people."""
    title = (
        f"{report['policy']}, T = {report['temperature']:g}, {report['encoding']}, {report['link_loss']:.0%} of links "
        f"lost, {report['shield']} shield: {report['cases']} cases of {set_name(report)}"
    )
    result = Table(title=title, title_justify="left")
    for heading in ("measure", "value", "95 % interval"):
        result.add_column(heading, justify="right")
    for name in ("alpha", "alpha_strict"):
        low, high = report[f"{name}_interval"]
        result.add_row(name, f"{report[name]:.3f}", f"{low:.3f} to {high:.3f}")
    half = report["delta_ft_half_width"]
    result.add_row(
        "delta_FT",
        f"{report['delta_ft']:.3f}",
        f"{report['delta_ft'] - half:.3f} to {report['delta_ft'] + half:.3f}",
    )
    for name, label in (("delta_ft_strict", "delta_FT, strict"), ("p_rg", "p_rg"), ("makespan", "makespan"),
                        ("moves_blocked", "moves blocked a case")):  # fmt: skip
        result.add_row(label, f"{report[name]:.3f}", "")
    return result
