# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Many cases at once: the same solutions in the same order, however many threads work on them."""

import math
from collections import namedtuple

import numpy as np
import pytest

from magat_expert import InvalidInstanceError, SolveStatus, check_paths, solve, solve_many

Case = namedtuple("Case", "obstacles starts goals")

HOPELESS = Case(np.zeros((2, 2), bool), [(0, 0), (1, 0), (1, 1), (0, 1)], [(1, 0), (0, 0), (1, 1), (0, 1)])
EASY = Case(np.zeros((1, 3), bool), [(0, 0)], [(2, 0)])


def cases(count):
    generator = np.random.default_rng(7)
    for _ in range(count):
        side = int(generator.integers(6, 16))
        cells = [(int(c) % side, int(c) // side) for c in generator.permutation(side * side)[: 2 * side]]
        yield Case(np.zeros((side, side), bool), cells[:side], cells[side:])


def test_the_number_of_workers_changes_nothing():
    expected = [solve(case.obstacles, case.starts, case.goals) for case in cases(60)]

    for workers in (1, 2, 3):
        found = list(solve_many(cases(60), workers))
        assert len(found) == 60
        for solution, reference in zip(found, expected, strict=True):
            assert np.array_equal(solution.paths, reference.paths)
            assert solution.expansions_low == reference.expansions_low


def test_solutions_come_in_the_order_of_the_cases():
    for case, solution in zip(cases(40), solve_many(cases(40), workers=2), strict=True):
        assert check_paths(case.obstacles, case.starts, case.goals, solution.paths) == []


def test_a_slow_case_holds_its_place():
    found = list(solve_many([HOPELESS, EASY, EASY], workers=2, node_limit=500))
    assert [s.status for s in found] == [SolveStatus.NODE_LIMIT, SolveStatus.SOLVED, SolveStatus.SOLVED]


def test_cases_are_drawn_as_they_are_needed():
    drawn = 0

    def endless():
        nonlocal drawn
        while True:
            drawn += 1
            yield EASY

    solutions = solve_many(endless(), workers=1)
    assert next(solutions).solved
    assert drawn < 100
    solutions.close()


def test_leaving_early_ends_the_searches_under_way():
    for solution in solve_many([EASY, HOPELESS, HOPELESS], workers=1, time_limit=math.inf):
        assert solution.solved
        break  # were the searches not stopped, this would wait for ever


def test_an_invalid_case_is_named():
    bad = Case(np.zeros((1, 3), bool), [(5, 0)], [(0, 0)])
    with pytest.raises(InvalidInstanceError, match=r"case 2: the start of robot 0, cell \(5, 0\)"):
        list(solve_many([EASY, EASY, bad, EASY], workers=2))


def test_parameters_are_checked_before_the_first_solution():
    with pytest.raises(InvalidInstanceError, match="w is 0"):
        solve_many([EASY], w=0.5)
    with pytest.raises(ValueError, match="workers is 0"):
        solve_many([EASY], workers=0)
