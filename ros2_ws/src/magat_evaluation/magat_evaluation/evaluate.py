"""``magat evaluate``: a policy on many cases, in the batched simulator, with progress."""

import dataclasses
import time
from collections.abc import Iterator, Sequence
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

from magat_evaluation.baselines import BASELINES
from magat_evaluation.cases import SolvedCase, solve_cases, solved_cases
from magat_evaluation.planners import Planner, carried, evaluate_planner
from magat_robot.policy.policy import Policy
from magat_robot.policy.store import load
from magat_sim.case import InvalidCaseError
from magat_sim.measures import EpisodeMeasures, summarise
from magat_sim.scenarios import Scenarios
from magat_sim.simulator import DEFAULT_RULES, Rules

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


@dataclass(frozen=True)
class Contender:
    """What is scored: a policy in a setting, or a baseline."""

    #: What reports call it: policy, digest, temperature and encoding.
    named: dict[str, Any]
    planner: Planner
    rules: Rules

    @classmethod
    def of_policy(cls, folder: Path, setting: Setting = DEFAULT_SETTING) -> "Contender":
        """The policy in ``folder``.

        Raises:
            ModelError: it cannot be used, or not in this setting.
        """
        policy = setting.load(folder)
        config = policy.config
        carried_by = {"temperature": config.temperature, "encoding": config.encoding}
        named = {"policy": config.name, "digest": policy.digest, **carried_by}
        return cls(named, partial(carried, policy), setting.rules)

    @classmethod
    def of_baseline(cls, name: str) -> "Contender":
        """One of the `BASELINES`; it has no weights, messages and temperature."""
        planner, shield = BASELINES[name]
        named = {"policy": name, "digest": "", "temperature": 0.0, "encoding": ""}
        return cls(named, planner, Rules(shield=shield))


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
    return _evaluate(Contender.of_policy(folder, setting), numbers, seed, size, console, workers)


def evaluate_baseline(
    name: str, numbers: Sequence[int], seed: int, size: dict[str, Any], console: Console, workers: int = 1
) -> dict[str, Any]:
    """Score one of the `BASELINES` in the same way."""
    return _evaluate(Contender.of_baseline(name), numbers, seed, size, console, workers)


def evaluate_scenarios(
    contender: Contender, scenarios: Scenarios, seed: int, console: Console, workers: int = 1
) -> dict[str, Any]:
    """Score ``contender`` in the same way on cases out of files, whose numbers are 0, 1, ...

    Args:
        contender: what is scored.
        scenarios: the cases.
        seed: of the random streams.
        console: shows the progress.
        workers: processes.

    Raises:
        InvalidCaseError: the expert solves none of the cases.
    """
    numbers = range(len(scenarios.cases))
    solved = _shown(solve_cases(scenarios.cases, numbers), len(numbers), console)
    return {"map": scenarios.map.name} | _score(contender, solved, numbers, seed, scenarios.size, console, workers)


def _evaluate(
    contender: Contender, numbers: Sequence[int], seed: int, size: dict[str, Any], console: Console, workers: int
) -> dict[str, Any]:
    solved = _solved(tuple(numbers), seed, tuple(size.items()), console)
    return _score(contender, solved, numbers, seed, size, console, workers)


@lru_cache(maxsize=1)  # one contender after the other is scored on the same cases
def _solved(
    numbers: tuple[int, ...], seed: int, size: tuple[tuple[str, Any], ...], console: Console
) -> list[SolvedCase]:
    return _shown(solved_cases(numbers, seed, **dict(size)), len(numbers), console)


def _shown(solving: Iterator[SolvedCase], count: int, console: Console) -> list[SolvedCase]:
    # Where nobody watches, each bar would leave an empty line.
    hidden = not console.is_interactive
    return list(track(solving, "expert", total=count, console=console, transient=True, disable=hidden))


def _score(
    contender: Contender,
    solved: Sequence[SolvedCase],
    numbers: Sequence[int],
    seed: int,
    size: dict[str, Any],
    console: Console,
    workers: int,
) -> dict[str, Any]:
    if not solved:
        raise InvalidCaseError(f"the expert solves none of the {len(numbers)} cases: ask for more, or for easier ones")
    started = time.monotonic()
    batch = max(1, BATCH_ROBOTS // solved[0].case.robots)
    batches = [solved[start : start + batch] for start in range(0, len(solved), batch)]
    score = partial(evaluate_planner, contender.planner, seed=seed, rules=contender.rules)
    episodes = _in_processes(score, batches, workers, console) if workers > 1 else _here(score, batches, console)
    elapsed = time.monotonic() - started
    return {
        **contender.named,
        **dataclasses.asdict(contender.rules),
        **size,
        "seed": seed,
        "first_case": numbers[0],
        "unsolved_by_expert": len(numbers) - len(solved),
        **dataclasses.asdict(summarise(episodes)),
        "seconds": round(elapsed, 1),
    }


def _here(score: Any, batches: Sequence[Sequence[SolvedCase]], console: Console) -> list[EpisodeMeasures]:
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


def _in_processes(
    score: Any, batches: Sequence[Sequence[SolvedCase]], workers: int, console: Console
) -> list[EpisodeMeasures]:
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
        + (f" on {report['map']}" if "map" in report else "")
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
