# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The measures of an episode and of a set of them (MAGAT paper, Sec. VI-A)."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from magat_sim.grid import BoolArray, IntArray

#: Quantile of the normal distribution for two-sided 95 % intervals.
Z_95 = 1.959964


@dataclass(frozen=True)
class Flowtime:
    """Flowtime FT: steps until the goals, summed over robots."""

    #: By the first visit of each robot (for alpha).
    first_visit: int
    #: By the last arrival of each robot, after which it stays (for alpha_strict).
    last_arrival: int


@dataclass(frozen=True)
class EpisodeMeasures:
    """The measures of one episode. Steps are ticks of the simulation."""

    success: bool
    success_strict: bool
    #: Share of robots that reached their goals.
    p_rg: float
    #: Robots that never reached their goals.
    stranded: int
    flowtime: Flowtime
    expert_flowtime: Flowtime | None
    makespan: int
    t_max: int
    ticks: int
    moves_blocked: int

    @property
    def delta_ft(self) -> float:
        """(FT - FT*) / FT* by first visits; NaN without an expert's solution."""
        return _increase(self.flowtime.first_visit, self.expert_flowtime.first_visit if self.expert_flowtime else None)

    @property
    def delta_ft_strict(self) -> float:
        """(FT - FT*) / FT* by last arrivals; NaN without an expert's solution."""
        return _increase(
            self.flowtime.last_arrival, self.expert_flowtime.last_arrival if self.expert_flowtime else None
        )


def expert_flowtime(paths: npt.ArrayLike, goals: IntArray) -> Flowtime:
    """FT* of the expert's ``paths`` (``[T + 1, N, 2]`` cells, ending on ``goals`` ``[N, 2]``), measured as FT is."""
    on_goal = (np.asarray(paths) == goals).all(axis=2)
    return Flowtime(int(first_visits(on_goal).sum()), int(last_arrivals(on_goal).sum()))


def walk_measures(
    on_goal: BoolArray, t_max: int, moves_blocked: int, expert_flowtime: Flowtime | None
) -> EpisodeMeasures:
    """The measures of an episode from the robots' positions.

    Args:
        on_goal: ``[T + 1, N]`` bool, which robots stood on their goals at the start and after each step.
        t_max: T_max, steps.
        moves_blocked: moves that robots sampled and the shield did not let them make.
        expert_flowtime: FT*; None without an expert's solution.
    """
    first = np.where(on_goal.any(axis=0), first_visits(on_goal), -1)
    last = np.where(on_goal[-1], last_arrivals(on_goal), -1)
    strict = bool(on_goal.all(axis=1).any())
    return episode_measures(first, last, strict, t_max, len(on_goal) - 1, moves_blocked, expert_flowtime)


def episode_measures(
    first: IntArray,
    last: IntArray,
    strict: bool,
    t_max: int,
    ticks: int,
    moves_blocked: int,
    expert_flowtime: Flowtime | None,
) -> EpisodeMeasures:
    """The measures of an episode.

    Args:
        first: ``[N]`` steps until each robot's first visit to its goal; -1 if it never visited it.
        last: ``[N]`` steps until its last arrival; -1 if it is not there at the end.
        strict: whether all robots stood on their goals at one instant.
        t_max: T_max, steps.
        ticks: steps that it took.
        moves_blocked: moves that robots sampled and the shield did not let them make.
        expert_flowtime: FT*; None without an expert's solution.
    """
    success = bool((first >= 0).all())
    return EpisodeMeasures(
        success=success,
        success_strict=strict,
        p_rg=float((first >= 0).mean()),
        stranded=int((first < 0).sum()),
        flowtime=Flowtime(int(np.where(first >= 0, first, t_max).sum()), int(np.where(last >= 0, last, t_max).sum())),
        expert_flowtime=expert_flowtime,
        makespan=int(first.max()) if success else t_max,
        t_max=t_max,
        ticks=ticks,
        moves_blocked=moves_blocked,
    )


def first_visits(on_goal: BoolArray) -> IntArray:
    """``[N]`` first step of each robot on its goal. ``on_goal`` is ``[T + 1, N]``; each robot visits it."""
    return on_goal.argmax(axis=0)


def last_arrivals(on_goal: BoolArray) -> IntArray:
    """``[N]`` step from which each robot stays on its goal to the end; T + 1 if it is not there at the end."""
    away = ~on_goal[::-1]
    return np.where(away.any(axis=0), len(on_goal) - away.argmax(axis=0), 0)


def wilson(successes: int, cases: int, z: float = Z_95) -> tuple[float, float]:
    """The score interval of a rate (Wilson, JASA 1927); 95 % with the default ``z``.

    Raises:
        ValueError: no cases, or more successes than cases.
    """
    if not 0 <= successes <= cases or cases == 0:
        raise ValueError(f"{successes} successes of {cases} cases are not a rate")
    rate = successes / cases
    centre = rate + z * z / (2 * cases)
    half = z * math.sqrt(rate * (1 - rate) / cases + z * z / (4 * cases * cases))
    scale = 1 + z * z / cases
    return max(0.0, (centre - half) / scale), min(1.0, (centre + half) / scale)


@dataclass(frozen=True)
class SetMeasures:
    """Measures over a set of episodes; rates with their 95 % intervals."""

    cases: int
    alpha: float
    alpha_interval: tuple[float, float]
    alpha_strict: float
    alpha_strict_interval: tuple[float, float]
    delta_ft: float
    delta_ft_strict: float
    #: Half width of the 95 % interval of the mean delta_ft (normal approximation).
    delta_ft_half_width: float
    p_rg: float
    #: Number of cases by the number of robots that never reached their goals, e.g. ``{0: 47, 2: 3}``.
    stranded: Mapping[int, int]
    makespan: float
    moves_blocked: float


def summarise(episodes: Sequence[EpisodeMeasures]) -> SetMeasures:
    """The measures over ``episodes`` (at least one)."""
    cases = len(episodes)
    successes = sum(e.success for e in episodes)
    strict = sum(e.success_strict for e in episodes)
    increase = np.array([e.delta_ft for e in episodes])
    return SetMeasures(
        cases=cases,
        alpha=successes / cases,
        alpha_interval=wilson(successes, cases),
        alpha_strict=strict / cases,
        alpha_strict_interval=wilson(strict, cases),
        delta_ft=float(increase.mean()),
        delta_ft_strict=float(np.mean([e.delta_ft_strict for e in episodes])),
        delta_ft_half_width=float(Z_95 * increase.std(ddof=1) / math.sqrt(cases)) if cases > 1 else math.nan,
        p_rg=float(np.mean([e.p_rg for e in episodes])),
        stranded=dict(sorted(Counter(e.stranded for e in episodes).items())),
        makespan=float(np.mean([e.makespan for e in episodes])),
        moves_blocked=float(np.mean([e.moves_blocked for e in episodes])),
    )


def _increase(flowtime: int, best: int | None) -> float:
    if best is None:
        return math.nan
    # FT* is 0 if every robot starts on its goal.
    return (flowtime - best) / best if best > 0 else float(flowtime > 0)
