# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Evaluations: episodes of a candidate on many cases, in the batched simulator, with progress."""

import dataclasses
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from typing import Any

from rich.console import Console
from rich.table import Table

from magat_evaluation.candidates import Candidate
from magat_evaluation.cases import SolvedCase, solve_cases, solved_cases
from magat_evaluation.executor import Workers, executor
from magat_evaluation.outcomes import Outcomes
from magat_evaluation.planners import evaluate_planner
from magat_evaluation.report import EvaluationKey, Report
from magat_evaluation.sets import CaseSet
from magat_evaluation.splits import EXPERT_W
from magat_node.progress import progress_bars, tracked
from magat_sim.case import InvalidCaseError
from magat_sim.measures import EpisodeMeasures, summarise
from magat_sim.scenarios import Scenarios

#: Robots that are simulated in lockstep; those of one case at least. More take more memory and are not faster.
BATCH_ROBOTS = 1000


def evaluate_candidate(
    candidate: Candidate, cases: CaseSet, console: Console, workers: Workers = 1, expert_time: float = math.inf
) -> Report:
    """Run ``candidate`` on ``cases``.

    Args:
        candidate: what is evaluated.
        cases: on what.
        console: shows the progress, and names the cases that the expert does not solve.
        workers: see `executor`; the measures do not depend on them. If there is one, this process does the work.
        expert_time: see `solved_cases`.

    Raises:
        InvalidCaseError: no such cases can be drawn, or the expert solves none of them.
        ModelError: the policy cannot be used.
    """
    solved = _solved(cases.numbers, cases.seed, expert_time, tuple(cases.size.items()), console)
    _list_unsolved({number: f"case {number} of seed {cases.seed}" for number in cases.numbers}, solved, console)
    return _evaluate(candidate, solved, candidate.key(cases), console, workers)


def evaluate_scenarios(
    candidate: Candidate,
    scenarios: Scenarios,
    seed: int,
    console: Console,
    workers: Workers = 1,
    expert_w: float = EXPERT_W,
    expert_time: float = math.inf,
) -> Report:
    """Run ``candidate`` on cases from MovingAI's files, whose numbers are 0, 1, ...

    Args:
        candidate: what is evaluated.
        scenarios: the cases.
        seed: of the random streams.
        console: shows the progress, and names the cases that the expert does not solve.
        workers: see `evaluate_candidate`.
        expert_w: the expert's suboptimality bound.
        expert_time: see `solved_cases`.

    Raises:
        InvalidCaseError: the expert solves none of the cases.
        ModelError: the policy cannot be used.
    """
    numbers = range(len(scenarios.cases))
    found = solve_cases(scenarios.cases, numbers, expert_w=expert_w, expert_time=expert_time)
    solved = list(tracked(found, "expert", len(numbers), console))
    last = scenarios.cases[0].robots + 1
    _list_unsolved({number: f"{scenarios.files[number]}:2-{last}" for number in numbers}, solved, console)
    size: dict[str, Any] = {**scenarios.size}
    key = dataclasses.replace(
        candidate.key(CaseSet(cases=1, seed=seed, expert_w=expert_w, **size)), first_case=numbers[0], cases=len(numbers)
    )
    return dataclasses.replace(_evaluate(candidate, solved, key, console, workers), map=scenarios.map.name)


@lru_cache(maxsize=2)  # several candidates in a row are run on the same cases, some of them on more than others
def _solved(
    numbers: range, seed: int, expert_time: float, size: tuple[tuple[str, Any], ...], console: Console
) -> list[SolvedCase]:
    found = solved_cases(numbers, seed, expert_time=expert_time, **dict(size))
    return list(tracked(found, "expert", len(numbers), console))


def _list_unsolved(names: Mapping[int, str], solved: Sequence[SolvedCase], console: Console) -> None:
    """Say which of the cases in ``names`` are not among the ``solved`` ones."""
    for number in sorted(names.keys() - {one.number for one in solved}):
        console.print(
            f"{names[number]}: the expert does not solve this case, so it is left out: allow more by --expert-time, or "
            "a larger --expert-w",
            markup=False,
            highlight=False,
            soft_wrap=True,
        )


def _evaluate(
    candidate: Candidate, solved: Sequence[SolvedCase], key: EvaluationKey, console: Console, workers: Workers
) -> Report:
    if not solved:
        raise InvalidCaseError(f"the expert solves none of the {key.cases} cases: ask for more, or for easier ones")
    started = time.monotonic()
    batch = max(1, BATCH_ROBOTS // key.robots)
    batches = [solved[start : start + batch] for start in range(0, len(solved), batch)]
    run = partial(evaluate_planner, candidate.make_planner(), seed=key.seed, rules=candidate.rules)
    episodes = _here(run, batches, console) if workers == 1 else _elsewhere(run, batches, workers, console)
    elapsed = time.monotonic() - started
    measures = dataclasses.asdict(summarise(episodes))
    if math.isnan(measures["delta_ft_half_width"]):
        measures["delta_ft_half_width"] = None
    return Report(
        **dataclasses.asdict(key)
        | measures
        | {
            "unsolved_by_expert": key.cases - len(solved),
            "bytes_per_step": candidate.bytes_per_step,
            "seconds": round(elapsed, 1),
            "outcomes": Outcomes.of(episodes),
        }
    )


_Run = Callable[..., list[EpisodeMeasures]]


def _here(run: _Run, batches: Sequence[Sequence[SolvedCase]], console: Console) -> list[EpisodeMeasures]:
    episodes: list[EpisodeMeasures] = []
    count = sum(map(len, batches))
    with progress_bars(console) as progress:
        for batch in batches:
            first = len(episodes) + 1
            task = progress.add_task(f"steps of episodes {first} to {first + len(batch) - 1} of {count}")
            progress.update(task, total=max(case.t_max for case in batch))
            episodes += run(batch, on_step=lambda _, task=task: progress.advance(task))
            progress.remove_task(task)
    return episodes


def _elsewhere(
    run: _Run, batches: Sequence[Sequence[SolvedCase]], workers: Workers, console: Console
) -> list[EpisodeMeasures]:
    with executor(workers) as pool:
        found: Iterator[list[EpisodeMeasures]] = pool.map(run, batches)
        shown = tracked(found, "batches of episodes", len(batches), console)
        return [measures for batch in shown for measures in batch]


def table(report: Report) -> Table:
    """``report`` for the terminal."""
    title = (
        f"{report.policy}, T = {report.temperature:g}, {report.encoding}, {report.link_loss:.0%} of links lost, "
        + (f"visit memory {report.visit_memory:g}, " if report.visit_memory else "")
        + f"{report.shield} shield: {report.cases} cases of {report.set_name}"
        + (f" on {report.map}" if report.map is not None else "")
    )
    result = Table(title=title, title_justify="left")
    for heading in ("measure", "value", "95 % interval"):
        result.add_column(heading, justify="right", overflow="fold")

    def interval(low: float, high: float) -> str:
        return f"{low:.3f} to {high:.3f}"

    half = report.delta_ft_half_width
    rows = (
        ("alpha", report.alpha, interval(*report.alpha_interval)),
        ("alpha, strict", report.alpha_strict, interval(*report.alpha_strict_interval)),
        (
            "delta_FT, first visit",
            report.delta_ft,
            "" if half is None else interval(report.delta_ft - half, report.delta_ft + half),
        ),
        ("delta_FT, last arrival", report.delta_ft_strict, ""),
        ("p_rg", report.p_rg, ""),
        ("makespan", report.makespan, ""),
        ("blocked moves per case", report.moves_blocked, ""),
    )
    for name, value, bounds in rows:
        result.add_row(name, f"{value:.3f}", bounds)
    return result
