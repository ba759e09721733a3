# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The expert: ECBS, a bounded-suboptimal solver for multi-agent path finding."""

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from magat_expert import _core
from magat_expert._core import StopFlag
from magat_expert.instance import (
    DEFAULT_MEMORY_LIMIT,
    DEFAULT_W,
    Instance,
    validate_instance,
    validate_limits,
    validate_memory_limit,
)


class SolveStatus(enum.IntEnum):
    """How a search ended. The order is that of the compiled search."""

    SOLVED = 0
    NO_SOLUTION = 1  # proven
    TIMED_OUT = 2
    NODE_LIMIT = 3
    STOPPED = 4  # by a StopFlag
    INCOMPLETE = 5  # a baseline ended without a solution; there may be one
    MEMORY_LIMIT = 6


@dataclass(frozen=True)
class Solution:
    """The outcome of one search.

    Attributes:
        status: how the search ended.
        paths: int16 `[T + 1, N, 2]`, cells `(x, y)` by time step and robot, or None unless solved. T is the
            makespan; robots that arrived earlier rest on their goals. `solve_replan` returns the paths up to its end
            with any status but NO_SOLUTION and MEMORY_LIMIT.
        arrived: bool `[N]`, whether each robot is on its goal at the end of its path; all False without paths.
        cost: steps, the sum over robots of the time after which the robot stays on its goal; 0 unless solved.
        lower_bound: steps. No valid paths cost less, whether solved or not; if solved by `solve`,
            `cost <= w * lower_bound`.
        makespan: steps, the last arrival; 0 unless solved.
        seconds: wall time of the search.
        expansions_high: expanded nodes of the constraint tree (`solve_hca`: orders tried; `solve_replan`:
            re-plannings).
        expansions_low: expanded nodes, summed over the searches of all robots.
    """

    status: SolveStatus
    paths: np.ndarray | None
    arrived: np.ndarray
    cost: int
    lower_bound: int
    makespan: int
    seconds: float
    expansions_high: int
    expansions_low: int

    @property
    def solved(self) -> bool:
        return self.status is SolveStatus.SOLVED


def solve(
    obstacles: ArrayLike,
    starts: ArrayLike,
    goals: ArrayLike,
    w: float = DEFAULT_W,
    time_limit: float = 10.0,
    node_limit: int | None = None,
    stop: StopFlag | None = None,
    memory_limit: int = DEFAULT_MEMORY_LIMIT,
) -> Solution:
    """Find paths without vertex or swap conflicts that cost at most `w` times the optimum.

    Enhanced Conflict-Based Search (Barer, Sharon, Stern, Felner: "Suboptimal Variants of the Conflict-Based
    Search Algorithm for the Multi-Agent Pathfinding Problem", SoCS 2014), with bypasses (Boyarski et al.,
    "Don't Split, Try To Work It Out: Bypassing Conflicts in Multi-Agent Pathfinding", ICAPS 2015).
    The same arguments give the same paths, unless the time limit ends the search. The search releases the GIL.

    The search proves that an instance has no solution only for corridors and for full maps without a cycle; otherwise
    it ends at a limit. Its memory grows with what it searches, besides 4 bytes for each robot and cell of the map.

    Args:
        obstacles: bool `[H, W]`, indexed `[y, x]`, True on obstacles.
        starts: int `[N, 2]`, cells `(x, y)`, x to the right, y up.
        goals: int `[N, 2]`, cells `(x, y)`.
        w: bound on the cost, from 1 (optimal) to 1000.
        time_limit: seconds; infinity for none. Exceeded by a few milliseconds, or by 1 or 2 % in long searches.
        node_limit: high-level expansions, or None. Unlike a time limit, it ends every run at the same point.
        stop: once set, by any thread, the search ends with the status STOPPED.
        memory_limit: MiB that the search may take; beyond it ends with the status MEMORY_LIMIT.

    Raises:
        InvalidInstanceError: the instance or a parameter is invalid; the message says what to do.
    """
    w, time_limit, node_limit = validate_limits(w, time_limit, node_limit)
    most_bytes = validate_memory_limit(memory_limit)
    instance = validate_instance(obstacles, starts, goals)
    outcome = _core.solve(
        instance.obstacles, instance.starts, instance.goals, w, time_limit, node_limit, most_bytes, stop
    )
    return solution_of(outcome, instance)


def solution_of(outcome: tuple[int, np.ndarray | None, int, int, float, int, int], instance: Instance) -> Solution:
    """The solution from the `outcome` of a compiled search on `instance`."""
    status, paths, cost, lower_bound, seconds, high, low = outcome
    solved = status == SolveStatus.SOLVED
    arrived = np.zeros(instance.num_robots, bool) if paths is None else (paths[-1] == instance.goals).all(axis=1)
    return Solution(
        status=SolveStatus(status),
        paths=paths,
        arrived=arrived,
        cost=cost,
        lower_bound=lower_bound,
        makespan=len(paths) - 1 if solved and paths is not None else 0,
        seconds=seconds,
        expansions_high=high,
        expansions_low=low,
    )
