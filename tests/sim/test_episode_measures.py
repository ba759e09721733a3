# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The measures of episodes that are stepped by hand, on a map of 4 x 2 free cells."""

import math

import numpy as np

from magat_sim.case import Case
from magat_sim.grid import Primitive
from magat_sim.measures import EpisodeMeasures, Flowtime
from magat_sim.simulator import Simulator
from magat_sim.streams import episode_streams

IDLE, UP, DOWN, LEFT, RIGHT = Primitive
BEST = Flowtime(4, 5)


def played(starts: list, goals: list, t_max: int, steps: list, best: Flowtime | None = BEST) -> EpisodeMeasures:
    """The measures after ``steps``, which must last exactly until the world is done."""
    case = Case(np.zeros((2, 4), dtype=bool), np.array(starts), np.array(goals))
    simulator = Simulator([case], [t_max], [episode_streams(0, 0, len(starts))])
    for actions in steps:
        assert not simulator.done
        simulator.step(actions)
    assert simulator.done
    return simulator.measures([best])[0]


def test_first_visits_and_last_arrivals_are_told_apart() -> None:
    measures = played(
        [(0, 0), (3, 1)],
        [(1, 0), (3, 0)],
        10,
        # Robot 0 arrives at 1, leaves at 2, is back at 3; robot 1 arrives at 4.
        [[RIGHT, LEFT], [UP, IDLE], [DOWN, RIGHT], [IDLE, DOWN]],
    )
    assert measures == EpisodeMeasures(
        success=True,
        success_strict=True,
        p_rg=1.0,
        stranded=0,
        flowtime=Flowtime(first_visit=1 + 4, last_arrival=3 + 4),
        expert_flowtime=BEST,
        makespan=4,
        t_max=10,
        ticks=4,
        moves_blocked=0,
    )
    assert measures.delta_ft == (5 - 4) / 4
    assert measures.delta_ft_strict == (7 - 5) / 5


def test_a_robot_that_never_arrives_counts_t_max() -> None:
    measures = played(
        [(0, 0), (3, 1)], [(1, 0), (3, 0)], 3, [[RIGHT, IDLE], [IDLE, IDLE], [IDLE, LEFT]], Flowtime(2, 2)
    )
    assert (measures.success, measures.success_strict, measures.p_rg, measures.stranded) == (False, False, 0.5, 1)
    assert measures.flowtime == Flowtime(1 + 3, 1 + 3)
    assert (measures.makespan, measures.ticks) == (3, 3)
    assert measures.delta_ft == measures.delta_ft_strict == 1.0


def test_goals_visited_but_never_all_at_once_are_a_success_that_is_not_strict() -> None:
    measures = played(
        [(0, 0), (3, 1)],
        [(1, 0), (3, 0)],
        3,
        # Robot 0 leaves its goal in the step in which robot 1 arrives, and does not come back.
        [[RIGHT, IDLE], [UP, DOWN], [IDLE, IDLE]],
    )
    assert (measures.success, measures.success_strict, measures.p_rg) == (True, False, 1.0)
    assert measures.flowtime == Flowtime(first_visit=1 + 2, last_arrival=3 + 2)
    assert (measures.makespan, measures.ticks) == (2, 3)


def test_arriving_in_the_very_last_step_counts() -> None:
    measures = played([(0, 0)], [(2, 0)], 2, [[RIGHT], [RIGHT]])
    assert (measures.success, measures.success_strict) == (True, True)
    assert measures.flowtime == Flowtime(2, 2)


def test_a_team_that_starts_on_its_goals_is_done_before_the_first_step() -> None:
    measures = played([(0, 0), (1, 1)], [(0, 0), (1, 1)], 0, [], Flowtime(0, 0))
    assert (measures.success, measures.success_strict, measures.p_rg) == (True, True, 1.0)
    assert measures.flowtime == Flowtime(0, 0)
    assert (measures.makespan, measures.ticks, measures.delta_ft, measures.delta_ft_strict) == (
        0,
        0,
        0.0,
        0.0,
    )


def test_a_robot_that_starts_on_its_goal_has_visited_it_and_may_still_lose_it() -> None:
    measures = played([(0, 0), (3, 1)], [(0, 0), (3, 0)], 2, [[RIGHT, DOWN], [IDLE, IDLE]])
    assert measures.success
    assert not measures.success_strict
    assert measures.flowtime == Flowtime(first_visit=0 + 1, last_arrival=2 + 1)
    assert measures.makespan == 1


def test_without_time_no_robot_arrives() -> None:
    measures = played([(0, 0), (1, 1)], [(0, 0), (3, 1)], 0, [], None)
    assert (measures.success, measures.p_rg, measures.ticks) == (False, 0.5, 0)
    assert math.isnan(measures.delta_ft)
    assert math.isnan(measures.delta_ft_strict)


def test_blocked_moves_are_counted_and_idling_is_none() -> None:
    measures = played(
        [(0, 0), (1, 0)],
        [(0, 1), (2, 0)],
        9,
        # Off the map and onto each other (3 blocked), then a swap (2), then both arrive.
        [[LEFT, DOWN], [RIGHT, IDLE], [RIGHT, LEFT], [IDLE, IDLE], [UP, RIGHT]],
    )
    assert measures.moves_blocked == 5
    assert measures.success_strict
