# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The control that walks by its own field of view, without a network and without messages."""

import numpy as np
import pytest

from magat_cli.main import main
from magat_evaluation.baselines import BASELINES
from magat_evaluation.candidates import Candidate
from magat_evaluation.cases import solved_cases
from magat_evaluation.greedy import distances_in_view, greedy
from magat_evaluation.planners import evaluate_planner
from magat_sim.field_of_view import CENTRE, GOAL, OBSTACLES, SIZE
from magat_sim.grid import DELTAS
from magat_sim.measures import summarise
from magat_sim.shield import SHIELDS
from magat_sim.simulator import Rules

IDLE, UP, DOWN, LEFT, RIGHT = range(5)


def view(goal: tuple[int, int], *walls: tuple[int, int]) -> np.ndarray:
    """``[1, 3, 11, 11]``: goal and walls are offsets ``(x, y)`` from the robot."""
    made = np.zeros((1, 3, SIZE, SIZE), np.uint8)
    made[0, GOAL, CENTRE + goal[1], CENTRE + goal[0]] = 1
    for x, y in walls:
        made[0, OBSTACLES, CENTRE + y, CENTRE + x] = 1
    return made


def test_distances_without_obstacles_are_those_of_the_grid() -> None:
    for goal in ((0, 0), (3, 0), (-2, 4), (5, 5), (0, -5)):
        (found,) = distances_in_view(view(goal))
        assert found.tolist() == [np.abs(np.array(goal) - delta).sum() for delta in DELTAS]


def test_the_way_leads_around_a_wall() -> None:
    (found,) = distances_in_view(view((2, 0), (1, -1), (1, 0), (1, 1)))
    assert found[RIGHT] >= SIZE * SIZE, "an obstacle"
    assert found[IDLE] == 6 and found[UP] == found[DOWN] == 5 and found[LEFT] == 7


def test_a_goal_that_is_walled_in_is_as_far_from_everywhere() -> None:
    around = [(3 + x, y) for x, y in ((-1, 0), (1, 0), (0, 1), (0, -1))]
    (found,) = distances_in_view(view((3, 0), *around))
    assert (found >= SIZE * SIZE).all()


def test_each_row_is_computed_alone() -> None:
    rng = np.random.default_rng(0)
    views = np.concatenate([view((rng.integers(-5, 6), rng.integers(-5, 6))) for _ in range(20)])
    views[:, OBSTACLES, 1:-1, 1:-1] = rng.random((20, SIZE - 2, SIZE - 2)) < 0.3
    alone = np.concatenate([distances_in_view(one[None]) for one in views])
    assert (distances_in_view(views) == alone).all()


def test_the_planning_shield_needs_no_policy_where_there_is_room() -> None:
    solved = list(solved_cases(range(40), workers=1, width=14, height=14, robots=8))
    reached = {
        shield: summarise(evaluate_planner(greedy, solved, rules=Rules(shield=shield))) for shield in ("idle", "pibt")
    }
    assert reached["pibt"].p_rg > 0.95
    assert reached["idle"].alpha < reached["pibt"].alpha


@pytest.mark.parametrize("shield", SHIELDS)
def test_it_can_be_run_with_every_shield(shield: str) -> None:
    assert shield in BASELINES["greedy"].shields
    assert Candidate.of_baseline("greedy", shield).rules == Rules(shield=shield)


def test_the_command_takes_a_shield_for_it(capfd) -> None:
    size = ["--robots", "3", "--width", "8", "--height", "8", "--cases", "2"]
    assert main(["evaluate", "--policy", "greedy", "--shield", "pibt-memory", *size]) == 0
    assert "pibt-memory" in capfd.readouterr().out
    assert main(["evaluate", "--policy", "greedy", "--link-loss", "0.5", *size]) == 1
    assert "--link-loss has no effect with the baseline greedy" in capfd.readouterr().err
