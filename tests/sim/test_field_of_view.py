# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The input tensor, against an implementation by definition: slow, cell by cell, in exact fractions."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_sim.case import Case
from magat_sim.field_of_view import CENTRE, GOAL, OBSTACLES, RADIUS, ROBOTS, SIZE, field_of_view, pad
from magat_training import symmetry

seeds = st.integers(0, 2**32 - 1)


def look(cases: list[Case]) -> np.ndarray:
    """The tensors of all robots of ``cases`` (maps of one size) on their starts, world by world."""
    occupied = np.zeros((len(cases), *cases[0].obstacles.shape))
    for grid, case in zip(occupied, cases, strict=True):
        grid[case.starts[:, 1], case.starts[:, 0]] = 1
    return field_of_view(
        pad([case.obstacles for case in cases], 1),
        pad(occupied, 0),
        np.repeat(np.arange(len(cases)), [case.robots for case in cases]),
        np.concatenate([case.starts for case in cases]),
        np.concatenate([case.goals for case in cases]),
    )


def by_definition(case: Case, robot: int) -> np.ndarray:
    """One robot's tensor, from the words of the definition."""
    height, width = case.obstacles.shape
    x, y = case.starts[robot].tolist()
    others = set(map(tuple, case.starts.tolist()))
    tensor = np.zeros((3, 11, 11), dtype=int)
    for dy in range(-4, 5):
        for dx in range(-4, 5):
            cell = (x + dx, y + dy)
            outside = not (0 <= cell[0] < width and 0 <= cell[1] < height)
            tensor[0, 5 + dy, 5 + dx] = outside or case.obstacles[cell[1], cell[0]]
            tensor[1, 5 + dy, 5 + dx] = cell in others
    dx, dy = (case.goals[robot] - case.starts[robot]).tolist()
    if max(abs(dx), abs(dy)) > 4:
        dx, dy = (crossing(component, max(abs(dx), abs(dy))) for component in (dx, dy))
    tensor[2, 5 + dy, 5 + dx] = 1
    return tensor


def crossing(component: int, largest: int) -> int:
    """Where the line to the goal crosses the ring, five cells away; halves are rounded outwards."""
    exact = Fraction(5 * abs(component), largest)
    return (1 if component > 0 else -1) * int(exact + Fraction(1, 2))


def test_the_tensor_has_a_field_of_view_of_nine_cells_and_a_ring() -> None:
    assert (RADIUS, SIZE, CENTRE, (OBSTACLES, ROBOTS, GOAL)) == (4, 11, 5, (0, 1, 2))


@settings(max_examples=150)
@given(
    seed=seeds,
    width=st.integers(1, 16),
    height=st.integers(1, 16),
    robots=st.integers(1, 12),
    worlds=st.integers(1, 3),
)
def test_tensors_are_those_of_the_definition(
    random_case, seed: int, width: int, height: int, robots: int, worlds: int
) -> None:
    rng = np.random.default_rng(seed)
    cases = [random_case(rng, width, height, robots) for _ in range(worlds)]
    tensors = look(cases)
    assert tensors.dtype == np.uint8
    expected = [by_definition(case, robot) for case in cases for robot in range(case.robots)]
    assert tensors.tolist() == np.stack(expected).tolist()


@pytest.mark.parametrize("dx", range(-13, 14))
def test_each_goal_is_marked_where_the_definition_says(dx: int) -> None:
    for dy in range(-13, 14):
        case = Case(np.zeros((27, 27), bool), np.array([[13, 13]]), np.array([[13 + dx, 13 + dy]]))
        assert look([case])[0, GOAL].tolist() == by_definition(case, 0)[2].tolist(), (dx, dy)


@settings(max_examples=60)
@given(seed=seeds)
def test_the_ring_holds_nothing_but_goals_out_of_view(random_case, seed: int) -> None:
    case = random_case(np.random.default_rng(seed), 13, 13, 8, density=0.5)
    ring = np.ones((11, 11), dtype=bool)
    ring[1:-1, 1:-1] = False
    tensors = look([case])
    assert not tensors[:, [OBSTACLES, ROBOTS]][..., ring].any()
    in_view = np.abs(case.goals - case.starts).max(axis=1) <= 4
    assert (tensors[:, GOAL].sum(axis=(1, 2)) == 1).all()
    assert (tensors[:, GOAL][:, ring].any(axis=1) == ~in_view).all()


def test_a_robot_sees_itself_at_the_centre_and_walls_outside_the_map() -> None:
    tensor = look([Case(np.zeros((20, 20), bool), np.array([[0, 19]]), np.array([[0, 19]]))])[0]
    assert tensor[ROBOTS].sum() == 1 == tensor[ROBOTS, 5, 5]
    assert tensor[GOAL, 5, 5] == 1
    assert tensor[OBSTACLES, 1:10, 1:5].all()  # left of x = 0
    assert tensor[OBSTACLES, 6:10, 1:10].all()  # above y = 19
    assert not tensor[OBSTACLES, 1:6, 5:10].any()


@settings(max_examples=60)
@given(seed=seeds, turn=st.integers(0, 7))
def test_turning_the_world_turns_what_each_robot_sees(random_case, seed: int, turn: int) -> None:
    side = 14
    case = random_case(np.random.default_rng(seed), side, side, 9)
    turned = Case(
        symmetry.turn_arrays(case.obstacles, turn),
        *((symmetry.turn_cells(2 * cells - (side - 1), turn) + side - 1) // 2 for cells in (case.starts, case.goals)),
    )
    assert look([turned]).tolist() == symmetry.turn_arrays(look([case]), turn).tolist()


def test_padding_surrounds_every_map_with_its_value() -> None:
    padded = pad(np.full((2, 3, 5), 7), 1)
    assert padded.shape == (2, 11, 13)
    assert (padded[:, 4:7, 4:9] == 7).all()
    assert (padded == 1).sum() == padded.size - 2 * 3 * 5
