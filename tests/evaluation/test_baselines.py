# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What plans without learning: its paths are walked as planned, and judged as a policy's are."""

from collections import deque
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_evaluation.baselines import BASELINES, distances, hca, pibt, replan
from magat_evaluation.cases import SolvedCase, solved_cases
from magat_evaluation.planners import evaluate_planner, simulator_for
from magat_expert import solve_hca, solve_replan
from magat_sim.case import Case
from magat_sim.measures import expert_flowtime, summarise
from magat_sim.rollout import run_recorded
from magat_sim.simulator import Rules

PIBT = Rules(shield="pibt")


def steps_from(obstacles: np.ndarray, goal: tuple[int, int]) -> np.ndarray:
    """Breadth-first search, cell by cell."""
    away = np.full(obstacles.shape, np.inf)
    away[goal[1], goal[0]] = 0
    queue = deque([goal])
    while queue:
        x, y = queue.popleft()
        for p, q in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
            inside = 0 <= p < obstacles.shape[1] and 0 <= q < obstacles.shape[0]
            if inside and not obstacles[q, p] and away[q, p] == np.inf:
                away[q, p] = away[y, x] + 1
                queue.append((p, q))
    return away


@settings(max_examples=50)
@given(seed=st.integers(0, 2**32 - 1), width=st.integers(1, 9), height=st.integers(1, 9), density=st.floats(0, 0.6))
def test_distances_are_those_of_breadth_first_search(
    random_case: Callable, seed: int, width: int, height: int, density: float
) -> None:
    case = random_case(np.random.default_rng(seed), width, height, 3, density)
    found = distances(case)
    assert found.shape == (case.robots, height + 2, width + 2)
    for robot, goal in enumerate(case.goals.tolist()):
        assert (found[robot, 1:-1, 1:-1] == steps_from(case.obstacles, tuple(goal))).all()
    assert np.isinf(found[:, [0, -1]]).all()
    assert np.isinf(found[:, :, [0, -1]]).all()


@pytest.mark.parametrize("planner", [hca, replan])
def test_what_is_planned_is_walked(planner: Callable, solved: list[SolvedCase]) -> None:
    for one in solved:
        case = one.case
        if planner is hca:
            paths = solve_hca(case.obstacles, case.starts, case.goals, seed=one.number).paths
        else:
            paths = solve_replan(case.obstacles, case.starts, case.goals, max_steps=one.t_max, seed=one.number).paths
        simulator = simulator_for([one])
        walked = run_recorded(simulator, planner([one], simulator))
        steps = min(len(walked), len(paths))
        assert (walked[:steps] == paths[:steps]).all()
        assert (walked[steps:] == paths[-1]).all()
        if (paths[-1] == case.goals).all() and len(paths) - 1 <= one.t_max:
            (measures,) = simulator.measures([one.flowtime])
            assert measures.flowtime.first_visit == expert_flowtime(paths, case.goals).first_visit
            assert measures.moves_blocked == 0


def test_where_there_is_no_plan_nobody_moves() -> None:
    # A corridor in which two would have to change places.
    case = Case(np.zeros((1, 4), dtype=bool), np.array([(0, 0), (3, 0)]), np.array([(3, 0), (0, 0)]))
    stuck = SolvedCase(0, case, np.stack([case.starts] * 5))
    (measures,) = evaluate_planner(hca, [stuck])
    assert (measures.success, measures.p_rg, measures.ticks) == (False, 0.0, stuck.t_max)


@pytest.mark.parametrize("name", BASELINES)
def test_a_case_scores_alone_as_among_others_of_other_sizes(name: str, solved: list[SolvedCase]) -> None:
    planner, (shield, *_) = BASELINES[name]
    mixed = [*solved[:4], *solved_cases(range(100, 102), workers=1, width=6, height=11, robots=3)]
    together = evaluate_planner(planner, mixed, rules=Rules(shield=shield))
    assert [evaluate_planner(planner, [s], rules=Rules(shield=shield))[0] for s in mixed] == together


def test_pibt_brings_robots_home_where_there_is_room() -> None:
    solved = list(solved_cases(range(40), workers=1, width=14, height=14, robots=10))
    reached = summarise(evaluate_planner(pibt, solved, rules=PIBT))
    assert reached.p_rg > 0.98
    assert 0 <= reached.delta_ft < 0.1
