"""The online expert: a failed episode becomes a case that begins where it got stuck."""

from collections.abc import Callable

import numpy as np
import pytest

from magat_expert import check_paths
from magat_robot.policy.policy import Decision
from magat_sim.case import Case
from magat_sim.grid import Primitive
from magat_training import online
from magat_training.cases import SolvedCase
from magat_training.evaluate import evaluate, run_policy, simulator_for
from magat_training.online import solve, stuck_cases

IDLE, UP, _, _, RIGHT = Primitive


def test_stuck_cases_begin_where_failed_episodes_ended(solved: list[SolvedCase], small_policy: Callable) -> None:
    policy = small_policy("MAGAT-F-16")
    solved = solved[2:]  # numbers that are not places in the list
    failed = [s for s, m in zip(solved, evaluate(policy, solved, seed=3), strict=True) if not m.success]
    stuck = stuck_cases(policy, solved, seed=3)
    assert [s.number for s in stuck] == [s.number for s in failed] != []
    for origin, case in zip(failed, stuck, strict=True):
        simulator = simulator_for([origin], seed=3)
        run_policy(policy, simulator)
        assert case.case.starts.tolist() == simulator.position.tolist() != origin.case.starts.tolist()
        assert case.case.goals.tolist() == origin.case.goals.tolist()
        assert case.case.obstacles.tolist() == origin.case.obstacles.tolist()
        assert case.paths.shape == (0, 5, 2)


def test_episodes_that_visit_all_goals_are_left_alone(solved: list[SolvedCase], small_policy: Callable) -> None:
    at_home = [SolvedCase(s.number, Case(s.case.obstacles, s.case.goals, s.case.goals), s.paths) for s in solved]
    assert stuck_cases(small_policy("MAGAT-F-16"), at_home, seed=3) == []


class Scripted:
    """Carried by two robots: one walks away from its goal, the other reaches its own, and both stay."""

    def decide_together(self, view: object, heard: object, streams: object, tick: int) -> Decision:
        return Decision(np.ones((2, 5)), np.array([UP, RIGHT] if tick == 0 else [IDLE, IDLE]))


def test_goals_that_were_visited_and_left_again_are_no_failure() -> None:
    case = Case(np.zeros((2, 4), dtype=bool), np.array([[0, 0], [2, 0]]), np.array([[0, 0], [3, 0]]))
    origin = SolvedCase(0, case, np.array([case.starts, case.goals]))
    assert not evaluate(Scripted(), [origin])[0].success_strict
    assert stuck_cases(Scripted(), [origin], seed=3) == []


def test_the_expert_solves_what_got_stuck(solved: list[SolvedCase], small_policy: Callable) -> None:
    stuck = stuck_cases(small_policy("MAGAT-F-16"), solved, seed=3)
    again = solve(stuck)
    assert [s.number for s in again] == [s.number for s in stuck]
    for s, origin in zip(again, stuck, strict=True):
        assert s.case.starts.tolist() == origin.case.starts.tolist()
        assert check_paths(s.case.obstacles, s.case.starts, s.case.goals, s.paths) == []


def test_what_the_expert_cannot_solve_either_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(online, "EXPERT_NODE_LIMIT", 50)
    corridor, nowhere = np.zeros((1, 5), dtype=bool), np.zeros((0, 2, 2), dtype=np.int64)
    ends = np.array([[0, 0], [4, 0]])
    passing = SolvedCase(1, Case(corridor, ends, ends[::-1]), nowhere)
    closing = SolvedCase(2, Case(corridor, ends, np.array([[1, 0], [2, 0]])), nowhere)
    assert [s.number for s in solve([passing, closing, passing])] == [2]
    assert solve([]) == []
