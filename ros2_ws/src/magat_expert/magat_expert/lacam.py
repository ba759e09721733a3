# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""LaCAM*: finds paths on crowded maps, where the tree of ECBS grows beyond its limits."""

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


def solve_lacam(
    obstacles: ArrayLike,
    starts: ArrayLike,
    goals: ArrayLike,
    time_limit: float = 1.0,
    node_limit: int | None = None,
    seed: int = 0,
    stop: StopFlag | None = None,
    memory_limit: int = DEFAULT_MEMORY_LIMIT,
) -> Solution:
    """LaCAM*: a depth-first search over the cells of all robots, with PIBT as the generator of successors.

    Okumura: "Improving LaCAM for Scalable Eventually Optimal Multi-Agent Pathfinding", IJCAI 2023. The first solution
    often takes milliseconds, also in dense teams and mazes, but its paths are longer than those of ECBS. The search
    then improves it until a limit: it lowers the sum of losses, which are the steps of all robots that do not begin and
    end on the goal. With enough time, which only small teams have, that sum becomes optimal. `Solution.cost`, the sum
    of the last arrivals, is at least as high.

    The status is SOLVED with a solution, also if a limit ended its improvement; else NO_SOLUTION (proven), TIMED_OUT,
    NODE_LIMIT, MEMORY_LIMIT or STOPPED as in `solve`. The search releases the GIL.

    Args:
        obstacles: bool `[H, W]`, indexed `[y, x]`, True on obstacles.
        starts: int `[N, 2]`, cells `(x, y)`, x to the right, y up.
        goals: int `[N, 2]`, cells `(x, y)`.
        time_limit: seconds; infinity for none.
        node_limit: expansions, or None. Unlike a time limit, it ends every run at the same point.
        seed: of the ties between equally good steps, 0 to 2^64 - 1. The same arguments give the same paths, unless the
            time limit ends the search.
        stop: once set, by any thread, the search ends; with the status STOPPED if there is no solution yet.
        memory_limit: as in `solve`, MiB.

    Raises:
        InvalidInstanceError: the instance or a parameter is invalid; the message says what to do.
    """
    time_limit = validate_time_limit(time_limit)
    nodes = -1 if node_limit is None else validate_count(node_limit, "node_limit", 0, 2**63 - 1, " (None: no limit)")
    seed = validate_count(seed, "seed", 0, MAX_SEED)
    most_bytes = validate_memory_limit(memory_limit)
    instance = validate_instance(obstacles, starts, goals)
    outcome = _core.solve_lacam(
        instance.obstacles, instance.starts, instance.goals, time_limit, nodes, seed, most_bytes, stop
    )
    return solution_of(outcome, instance)
