# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The paper's planners without learning: HCA and Replan. Neither is complete or has a bound on its cost."""

from numpy.typing import ArrayLike

from magat_expert import _core
from magat_expert.instance import (
    DEFAULT_MEMORY_LIMIT,
    MAX_SEED,
    validate_count,
    validate_instance,
    validate_memory_limit,
    validate_time_limit,
)
from magat_expert.solver import Solution, StopFlag, solution_of

#: Limits the memory of paths of robots that circle each other without end.
_MOST_STEPS = 1_000_000


def solve_hca(
    obstacles: ArrayLike,
    starts: ArrayLike,
    goals: ArrayLike,
    time_limit: float = 10.0,
    orders: int = 20,
    seed: int = 0,
    stop: StopFlag | None = None,
    memory_limit: int = DEFAULT_MEMORY_LIMIT,
) -> Solution:
    """Hierarchical Cooperative A*: robots plan one after another and avoid the paths of the earlier ones.

    Silver: "Cooperative Pathfinding", AIIDE 2005. Each robot searches space-time with its exact distances (robots
    ignored) as heuristic and takes the path that arrives first. It rests on its goal for ever, so it may arrive only
    when no earlier robot passes the goal any more. The first order is that of the indices. When a robot finds no path,
    all robots plan again, in an order shuffled by `seed` in which that robot is first.

    The status is SOLVED; INCOMPLETE after `orders` orders without a solution, when there may still be one;
    NO_SOLUTION, TIMED_OUT, MEMORY_LIMIT or STOPPED as in `solve`. The search releases the GIL.

    Args:
        obstacles: bool `[H, W]`, indexed `[y, x]`, True on obstacles.
        starts: int `[N, 2]`, cells `(x, y)`, x to the right, y up.
        goals: int `[N, 2]`, cells `(x, y)`.
        time_limit: seconds; infinity for none.
        orders: how many orders to try; 1 is the algorithm without restarts.
        seed: of the orders, 0 to 2^64 - 1. The same arguments give the same paths, unless the time limit ends the
            search.
        stop: once set, by any thread, the search ends with the status STOPPED.
        memory_limit: as in `solve`, MiB.

    Raises:
        InvalidInstanceError: the instance or a parameter is invalid; the message says what to do.
    """
    time_limit = validate_time_limit(time_limit)
    orders = validate_count(orders, "orders", 1, 2**31 - 1)
    seed = validate_count(seed, "seed", 0, MAX_SEED)
    most_bytes = validate_memory_limit(memory_limit)
    instance = validate_instance(obstacles, starts, goals)
    outcome = _core.solve_hca(
        instance.obstacles, instance.starts, instance.goals, time_limit, orders, seed, most_bytes, stop
    )
    return solution_of(outcome, instance)


def solve_replan(
    obstacles: ArrayLike,
    starts: ArrayLike,
    goals: ArrayLike,
    time_limit: float = 10.0,
    max_steps: int | None = None,
    seed: int = 0,
    stop: StopFlag | None = None,
    memory_limit: int = DEFAULT_MEMORY_LIMIT,
) -> Solution:
    """Global re-planning: each robot follows a shortest path, and re-plans when a step is in conflict.

    The paper's baseline `Replan` (after Wang et al., "Mobile Robot Path Planning in Dynamic Environments Through
    Globally Guided Reinforcement Learning", RA-L 2020). In each time step the robots decide one after another, in an
    order shuffled by `seed`. A step is in conflict if another robot moves to its cell, or is there and has not decided
    to leave it. The robot then takes an A* path around the current cells of all others and around the cells that they
    move to in this step, or waits if there is none. Robots that have arrived do not move.

    The status is SOLVED if all have arrived; INCOMPLETE after `max_steps` steps, or as soon as no robot can
    move; NO_SOLUTION, TIMED_OUT, MEMORY_LIMIT or STOPPED as in `solve`. Except for NO_SOLUTION and MEMORY_LIMIT, the
    result holds the paths up to the end, which are free of conflicts, and which robots have `arrived`. The search
    releases the GIL.

    Args:
        obstacles: bool `[H, W]`, indexed `[y, x]`, True on obstacles.
        starts: int `[N, 2]`, cells `(x, y)`, x to the right, y up.
        goals: int `[N, 2]`, cells `(x, y)`.
        time_limit: seconds; infinity for none.
        max_steps: T_max, time steps, 0 to 1,000,000. None is 3 times the longest of the shortest paths: T_max for an
            expert whose robots never wait.
        seed: of the orders, 0 to 2^64 - 1. The same arguments give the same paths, unless the time limit ends the
            search.
        stop: once set, by any thread, the search ends with the status STOPPED.
        memory_limit: as in `solve`, MiB.

    Raises:
        InvalidInstanceError: the instance or a parameter is invalid; the message says what to do.
    """
    time_limit = validate_time_limit(time_limit)
    steps = -1 if max_steps is None else validate_count(max_steps, "max_steps", 0, _MOST_STEPS)
    seed = validate_count(seed, "seed", 0, MAX_SEED)
    most_bytes = validate_memory_limit(memory_limit)
    instance = validate_instance(obstacles, starts, goals)
    outcome = _core.solve_replan(
        instance.obstacles, instance.starts, instance.goals, time_limit, steps, seed, most_bytes, stop
    )
    return solution_of(outcome, instance)
