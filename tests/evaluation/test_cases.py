# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The scenario sets: disjoint splits, and the expert's solutions of their cases."""

import hashlib

import numpy as np
import pytest

from magat_evaluation import cases
from magat_evaluation.cases import SolvedCase, solved_cases
from magat_evaluation.splits import SET_SEED, SPLITS
from magat_expert import check_paths
from magat_sim.case import draw_case
from magat_sim.measures import Flowtime


def fingerprint(number: int) -> bytes:
    case = draw_case(SET_SEED, number)
    parts = (case.obstacles, case.starts, case.goals)
    return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).digest()


def test_the_splits_are_70_15_and_15_percent_of_30000_and_disjoint() -> None:
    assert {name: len(numbers) for name, numbers in SPLITS.items()} == {
        "train": 21_000,
        "valid": 4_500,
        "test": 4_500,
    }
    assert sorted(number for numbers in SPLITS.values() for number in numbers) == list(range(30_000))


@pytest.mark.parametrize("take", [slice(None, 150), slice(-150, None)], ids=["first", "last"])
def test_no_case_is_in_two_splits(take: slice) -> None:
    prints = [fingerprint(number) for numbers in SPLITS.values() for number in numbers[take]]
    assert len(set(prints)) == len(prints) == 450


def test_solutions_are_valid_and_belong_to_the_cases_of_their_numbers(solved: list[SolvedCase]) -> None:
    assert [s.number for s in solved] == list(range(8))
    for s in solved:
        assert check_paths(s.case.obstacles, s.case.starts, s.case.goals, s.paths) == []
        drawn = draw_case(SET_SEED, s.number, 9, 9, 5, 0.15)
        assert drawn.obstacles.tolist() == s.case.obstacles.tolist()
        assert drawn.goals.tolist() == s.case.goals.tolist()


def test_cases_of_the_set_are_solved_as_the_paper_has_them() -> None:
    (solved,) = solved_cases([21_000], workers=1)
    assert solved.number == 21_000
    assert solved.case.obstacles.shape == (20, 20)
    assert solved.case.obstacles.sum() == 40
    assert solved.case.robots == 10
    assert check_paths(solved.case.obstacles, solved.case.starts, solved.case.goals, solved.paths) == []


def test_the_steps_a_team_gets_are_three_times_the_experts(solved: list[SolvedCase]) -> None:
    for s in solved:
        assert s.t_max == 3 * (len(s.paths) - 1)


def test_the_experts_flowtime_is_that_of_its_paths(solved: list[SolvedCase]) -> None:
    for s in solved:
        on_goal = (s.paths == s.case.goals).all(axis=2)
        first = [column.index(True) for column in on_goal.T.tolist()]
        last = [max((t + 1 for t, there in enumerate(column) if not there), default=0) for column in on_goal.T.tolist()]
        assert s.flowtime == Flowtime(sum(first), sum(last))
        # A lower bound that needs no search.
        assert s.flowtime.first_visit >= np.abs(s.case.starts - s.case.goals).sum()


def test_another_seed_names_another_series_of_cases(solved: list[SolvedCase]) -> None:
    (other,) = solved_cases([3], seed=1, workers=1, width=9, height=9, robots=5, density=0.15)
    drawn = draw_case(1, 3, 9, 9, 5, 0.15)
    assert other.number == solved[3].number
    assert other.case.starts.tolist() == drawn.starts.tolist() != solved[3].case.starts.tolist()


def test_the_number_of_workers_changes_nothing(solved: list[SolvedCase]) -> None:
    again = list(solved_cases(range(8), workers=3, width=9, height=9, robots=5, density=0.15))
    assert [s.paths.tolist() for s in again] == [s.paths.tolist() for s in solved]


def test_cases_that_the_expert_cannot_solve_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases, "EXPERT_NODE_LIMIT", 50)
    # In a corridor without a siding, two robots can only keep their order.
    solved = list(solved_cases(range(30), workers=1, width=5, height=1, robots=2, density=0.0))
    drawn = [draw_case(SET_SEED, number, 5, 1, 2, 0.0) for number in range(30)]
    in_order = [n for n, c in enumerate(drawn) if np.prod(np.diff(c.starts[:, 0]) * np.diff(c.goals[:, 0])) > 0]
    assert 0 < len(in_order) < 30
    assert [s.number for s in solved] == in_order
    for s in solved:
        assert s.case.starts.tolist() == drawn[s.number].starts.tolist()
        assert check_paths(s.case.obstacles, s.case.starts, s.case.goals, s.paths) == []
