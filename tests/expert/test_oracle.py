# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""ECBS and HCA against another implementation: CBS (optimal) and HCA* of w9-pathfinding."""

from typing import Any

import numpy as np
import pytest
from w9_pathfinding.envs import Grid
from w9_pathfinding.mapf import CBS, HCAStar

from magat_expert import solve, solve_hca
from magat_sim.case import Case, draw_case

CASES = range(30)


def grid_of(case: Case) -> Grid:
    """The map, with collisions on edges: without them, robots of the other implementation may swap."""
    return Grid(np.where(case.obstacles, -1.0, 1.0).tolist(), edge_collision=True)


def cost_of(paths: list[list[tuple[int, int]]]) -> int:
    """The sum of the times after which each robot stays where it is."""
    cost = 0
    for path in paths:
        moves = [time for time in range(1, len(path)) if path[time] != path[time - 1]]
        cost += max(moves, default=0)
    return cost


def others_cost(algorithm: type, case: Case, **limits: Any) -> int | None:
    """The cost of the other implementation's paths, None if it finds none within its limits."""
    ends = [[tuple(cell) for cell in cells.tolist()] for cells in (case.starts, case.goals)]
    paths = algorithm(grid_of(case)).mapf(*ends, max_length=1000, **limits)
    return cost_of(paths) if paths else None


@pytest.mark.parametrize("w", [1.0, 1.1, 1.5])
def test_the_optimum_lies_between_the_bound_and_the_cost(w):
    compared = 0
    for number in CASES:
        case = draw_case(99, number, 20, 20, 10, 0.1)
        optimum = others_cost(CBS, case, max_time=0.2)
        if optimum is None:
            continue
        solution = solve(case.obstacles, case.starts, case.goals, w)
        assert solution.lower_bound <= optimum <= solution.cost <= w * solution.lower_bound
        compared += 1
    assert compared >= 0.8 * len(CASES)


def test_hca_costs_as_much_as_the_other_one():
    """Path by path both are the earliest, but of several earliest paths each has its own choice."""
    ours, theirs = [], []
    for number in CASES:
        case = draw_case(99, number, 20, 20, 20, 0.1)
        solution = solve_hca(case.obstacles, case.starts, case.goals, orders=1)
        other = others_cost(HCAStar, case)
        if solution.solved and other is not None:
            ours.append(solution.cost)
            theirs.append(other)
    assert len(ours) >= 0.8 * len(CASES)
    assert sum(ours) == pytest.approx(sum(theirs), rel=0.01)


def test_hca_of_one_robot_and_of_two_agrees_exactly():
    """The second path depends on the choice of the first one only where they meet."""
    same = 0
    for number in CASES:
        case = draw_case(98, number, 20, 20, 2, 0.1)
        first = solve_hca(case.obstacles, case.starts[:1], case.goals[:1])
        assert first.cost == others_cost(HCAStar, Case(case.obstacles, case.starts[:1], case.goals[:1]))
        both = solve_hca(case.obstacles, case.starts, case.goals, orders=1)
        same += both.cost == others_cost(HCAStar, case)
    assert same >= 0.9 * len(CASES)
