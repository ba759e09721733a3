# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every invalid instance is refused with a message that names the robot, the cell and the way out."""

import numpy as np
import pytest

from magat_expert import InvalidInstanceError, solve

FREE = np.zeros((3, 4), bool)  # 4 cells wide, 3 high
WALL = np.array([[0, 0, 1, 0]] * 3, bool)  # an obstacle in column x = 2
CELL = [(0, 0)]


@pytest.mark.parametrize(
    ("obstacles", "starts", "goals", "message"),
    [
        (FREE, [(0, 0), (4, 1)], [(1, 0), (2, 0)], r"start of robot 1, cell \(4, 1\), is outside .* 4 x 3"),
        (
            FREE,
            [(0, 0), (1, 0)],
            [(0, 3), (2, 0)],
            r"goal of robot 0, cell \(0, 3\), is outside .* y from 0 to 2",
        ),
        (FREE, [(0, -1)], CELL, r"start of robot 0, cell \(0, -1\), is outside"),
        (
            WALL,
            [(0, 0), (2, 1)],
            [(0, 1), (1, 1)],
            r"start of robot 1, cell \(2, 1\), is on an obstacle: move it",
        ),
        (WALL, CELL, [(2, 0)], r"goal of robot 0, cell \(2, 0\), is on an obstacle"),
        (
            FREE,
            [(1, 2), (0, 0), (1, 2)],
            [(0, 0), (1, 0), (2, 0)],
            r"robots 0 and 2 have the same start, cell \(1, 2\)",
        ),
        (
            FREE,
            [(0, 0), (1, 0)],
            [(3, 2), (3, 2)],
            r"robots 0 and 1 have the same goal, cell \(3, 2\): give every",
        ),
        (
            WALL,
            [(0, 0), (0, 1)],
            [(1, 0), (3, 1)],
            r"robot 1 cannot reach its goal, cell \(3, 1\), .* cell \(0, 1\)",
        ),
        (FREE, [(0, 0), (1, 0)], CELL, r"2 starts and 1 goals: give one of each"),
        (FREE, np.zeros((0, 2), int), np.zeros((0, 2), int), r"there are 0 starts: give 1 to"),
        (FREE, [0, 0], CELL, r"starts have shape \(2,\): give \[N, 2\]"),
        (FREE, CELL, [(0, 0, 0)], r"goals have shape \(1, 3\)"),
        (FREE, [(0, 0), (1,)], CELL, r"starts are not an array"),
        (FREE, [(0.0, 1.0)], CELL, r"starts have dtype float64: cells are integers"),
        (FREE[0], CELL, CELL, r"obstacles have shape \(4,\): give a map of shape \[H, W\]"),
        (FREE[:0], CELL, CELL, r"obstacles have shape \(0, 4\)"),
        (FREE.astype(float), CELL, CELL, r"obstacles have dtype float64: give bool"),
        (np.full((3, 4), 2), CELL, CELL, r"integers other than 0 and 1"),
        (np.zeros((1, 40_000), bool), CELL, CELL, r"at most 32767 cells a side"),
    ],
)
def test_an_invalid_instance_is_refused(obstacles, starts, goals, message):
    with pytest.raises(InvalidInstanceError, match=message):
        solve(obstacles, starts, goals)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"w": 0.99}, r"w is 0.99: .* choose w from 1"),
        ({"w": 1e4}, r"w is 10000.0"),
        ({"w": float("nan")}, r"w is NaN"),
        ({"w": float("inf")}, r"w is inf"),
        ({"w": None}, r"w is None: give a number"),
        ({"time_limit": 0}, r"time_limit is 0.0: give the search more than 0 seconds"),
        ({"time_limit": -1.0}, r"time_limit is -1.0"),
        ({"time_limit": float("nan")}, r"time_limit is NaN"),
        ({"node_limit": -1}, r"node_limit is -1: give 0 or more"),
        ({"node_limit": 2**70}, r"node_limit is"),
        ({"node_limit": 1.5}, r"node_limit is 1.5: give a whole number"),
    ],
)
def test_senseless_limits_are_refused(limits, message):
    with pytest.raises(InvalidInstanceError, match=message):
        solve(FREE, CELL, CELL, **limits)


def test_an_invalid_instance_is_a_value_error():
    assert issubclass(InvalidInstanceError, ValueError)


@pytest.mark.parametrize("dtype", [np.int8, np.int16, np.uint16, np.int64])
def test_any_integers_will_do(dtype):
    solution = solve(FREE.astype(np.uint8), np.array([[0, 0]], dtype), np.array([[3, 2]], dtype), w=1)
    assert solution.cost == 5


def test_arrays_need_not_be_contiguous():
    obstacles = np.asfortranarray(WALL)[:, ::-1]  # the wall is in column x = 1
    cells = np.array([[2, 3], [0, 2]], np.int32).T  # columns become rows: (2, 0) and (3, 2)

    solution = solve(obstacles, cells[:1], cells[1:])

    assert solution.paths[-1].tolist() == [[3, 2]]


def test_arguments_are_left_as_they_were():
    obstacles, starts, goals = WALL.copy(), np.array([[0, 0]]), np.array([[1, 2]])
    solve(obstacles, starts, goals)

    assert np.array_equal(obstacles, WALL)
    assert (starts.tolist(), goals.tolist()) == ([[0, 0]], [[1, 2]])
