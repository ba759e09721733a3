# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The shield ``idle``: robots never collide, and no robot waits without a reason."""

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_sim.grid import Primitive
from magat_sim.simulator import Simulator
from magat_sim.streams import episode_streams

IDLE, UP, DOWN, LEFT, RIGHT = Primitive
seeds = st.integers(0, 2**32 - 1)
sides = st.integers(1, 9)


@settings(max_examples=120)
@given(seed=seeds, width=sides, height=sides, share=st.floats(0.05, 1), density=st.floats(0, 0.5))
def test_random_actions_never_collide_and_no_robot_waits_needlessly(
    random_case: Callable, judge: Callable, seed: int, width: int, height: int, share: float, density: float
) -> None:
    rng = np.random.default_rng(seed)
    case = random_case(rng, width, height, max(1, int(share * width * height)), density)
    simulator = Simulator([case], [25], [episode_streams(seed, 0, case.robots)])
    while not simulator.done:
        before = simulator.position.copy()
        actions = rng.integers(5, size=case.robots)
        step = simulator.step(actions)
        after = simulator.position
        assert judge(case.obstacles, before, actions, after) == []
        moved = (before != after).any(axis=1)
        assert step.moved.tolist() == np.where(moved, actions, 0).tolist()
        assert step.blocked.tolist() == (~moved & (actions != 0)).tolist()


@settings(max_examples=120)
@given(seed=seeds, width=sides, height=sides, share=st.floats(0.05, 1))
def test_a_joint_move_without_conflicts_passes_unchanged(
    random_case: Callable, judge: Callable, seed: int, width: int, height: int, share: float
) -> None:
    rng = np.random.default_rng(seed)
    case = random_case(rng, width, height, max(1, int(share * width * height)))
    streams = [episode_streams(seed, number, case.robots) for number in (0, 1)]
    scout, simulator = (Simulator([case], [20], [stream]) for stream in streams)
    while not scout.done:
        # What a shield let through is a joint move without conflicts.
        actions = scout.step(rng.integers(5, size=case.robots)).moved
        step = simulator.step(actions)
        assert step.moved.tolist() == actions.tolist()
        assert not step.blocked.any()
        assert simulator.position.tolist() == scout.position.tolist()


@pytest.mark.parametrize(
    ("starts", "actions"),
    [
        pytest.param([(0, 0), (1, 0), (2, 0)], [RIGHT, RIGHT, RIGHT], id="a row follows its head"),
        pytest.param([(0, 0), (1, 0), (1, 1), (0, 1)], [RIGHT, UP, LEFT, DOWN], id="four turn left"),
        pytest.param([(0, 0), (1, 0), (1, 1), (0, 1)], [UP, LEFT, DOWN, RIGHT], id="four turn right"),
        pytest.param(
            [(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1)],
            [RIGHT, RIGHT, UP, LEFT, LEFT, DOWN],
            id="six go round",
        ),
        pytest.param([(1, 1), (1, 2), (2, 2)], [RIGHT, DOWN, LEFT], id="each into the cell that another leaves"),
    ],
)
def test_following_and_rotating_are_legal(arena: Callable, starts: list, actions: list) -> None:
    assert arena(4, 4, starts).step(actions).moved.tolist() == actions


@pytest.mark.parametrize(("starts", "actions"), [([(1, 1), (2, 1)], [RIGHT, LEFT]), ([(2, 3), (2, 2)], [DOWN, UP])])
def test_two_that_would_swap_both_idle(arena: Callable, starts: list, actions: list) -> None:
    for number in range(20):
        step = arena(4, 4, starts, number=number).step(actions)
        assert step.moved.tolist() == [IDLE, IDLE]
        assert step.blocked.all()


@pytest.mark.parametrize(
    ("start", "actions"),
    [((0, 1), LEFT), ((3, 1), RIGHT), ((1, 2), UP), ((1, 0), DOWN), ((1, 1), RIGHT), ((2, 2), DOWN)],
)
def test_obstacles_and_the_edges_of_the_map_stop_a_robot(
    arena: Callable, start: tuple[int, int], actions: Primitive
) -> None:
    simulator = arena(4, 3, [start], obstacles=[(2, 1)])
    step = simulator.step([actions])
    assert step.moved.tolist() == [IDLE]
    assert step.blocked.tolist() == [True]
    assert simulator.position.tolist() == [list(start)]


@pytest.mark.parametrize(
    ("starts", "actions"),
    [
        pytest.param([(0, 1), (2, 1)], [RIGHT, LEFT], id="two"),
        pytest.param([(0, 1), (2, 1), (1, 0), (1, 2)], [RIGHT, LEFT, UP, DOWN], id="four"),
    ],
)
def test_one_of_several_robots_gets_a_free_cell_and_each_wins_equally_often(
    arena: Callable, starts: list, actions: list
) -> None:
    rounds = 400
    winners = Counter()
    for number in range(rounds):
        moved = arena(3, 3, starts, number=number).step(actions).moved
        assert (moved != IDLE).sum() == 1
        winners[int(np.flatnonzero(moved)[0])] += 1
    expected = rounds / len(starts)
    assert sorted(winners) == list(range(len(starts)))
    assert max(abs(count - expected) for count in winners.values()) < 5 * np.sqrt(expected)


def test_the_draw_is_a_new_one_in_every_step(arena: Callable) -> None:
    simulator = arena(3, 1, [(0, 0), (2, 0)])
    winners = set()
    for _ in range(30):
        moved = simulator.step([RIGHT, LEFT]).moved
        winners.add(int(np.flatnonzero(moved)[0]))
        simulator.step(np.where(moved == RIGHT, LEFT, np.where(moved == LEFT, RIGHT, IDLE)))
    assert winners == {0, 1}


def test_a_cell_that_is_left_goes_to_one_of_the_robots_that_move_to_it(arena: Callable) -> None:
    for number in range(20):
        # Robot 0 leaves the middle; 1 follows it from below, 2 and 3 come from the sides.
        moved = arena(3, 3, [(1, 1), (1, 0), (0, 1), (2, 1)], number=number).step([UP, UP, RIGHT, LEFT]).moved
        assert moved[0] == UP
        assert (moved[1:] != IDLE).sum() == 1


def test_a_waiting_robot_makes_all_behind_it_wait(arena: Callable) -> None:
    row = [(x, 0) for x in range(5)]
    assert arena(6, 1, row, obstacles=[(5, 0)]).step([RIGHT] * 5).moved.tolist() == [IDLE] * 5
    assert arena(6, 1, row).step([RIGHT, RIGHT, IDLE, RIGHT, RIGHT]).moved.tolist() == [
        IDLE,
        IDLE,
        IDLE,
        RIGHT,
        RIGHT,
    ]
    # The last two would swap; the three behind them cannot go on.
    assert arena(6, 1, row).step([RIGHT, RIGHT, RIGHT, RIGHT, LEFT]).moved.tolist() == [IDLE] * 5


def test_losing_a_contest_makes_everyone_behind_the_loser_wait(arena: Callable) -> None:
    lost = set()
    for number in range(30):
        # Two rows of two meet at the free cell in the middle.
        moved = arena(5, 1, [(0, 0), (1, 0), (3, 0), (4, 0)], number=number).step([RIGHT, RIGHT, LEFT, LEFT]).moved
        lost.add(tuple(moved.tolist()))
    assert lost == {(RIGHT, RIGHT, IDLE, IDLE), (IDLE, IDLE, LEFT, LEFT)}


def test_a_third_robot_does_not_get_past_two_that_would_swap(arena: Callable) -> None:
    for number in range(20):
        moved = arena(3, 3, [(1, 1), (2, 1), (1, 2)], number=number).step([RIGHT, LEFT, DOWN]).moved
        assert moved.tolist() == [IDLE, IDLE, IDLE]


def test_a_robot_that_wants_an_obstacle_does_not_take_a_cell_from_anyone(arena: Callable) -> None:
    for number in range(20):
        # Worlds are stored in one array: the cells left of the map and right of it must not be one another's.
        moved = arena(3, 2, [(0, 0), (2, 1), (1, 0)], number=number).step([LEFT, RIGHT, UP]).moved
        assert moved.tolist() == [IDLE, IDLE, UP]
