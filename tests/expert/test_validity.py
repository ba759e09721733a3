# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The checker of paths: it finds each kind of violation, and only violations."""

import numpy as np
import pytest

from magat_expert import check_paths

FREE = np.zeros((3, 4), bool)


def check(*paths, obstacles=FREE, starts=None, goals=None):
    """Checks paths given robot by robot; starts and goals are their ends unless given."""
    starts = [path[0] for path in paths] if starts is None else starts
    goals = [path[-1] for path in paths] if goals is None else goals
    return check_paths(obstacles, starts, goals, np.array(paths).transpose(1, 0, 2))


@pytest.mark.parametrize(
    "paths",
    [
        ([(0, 0), (1, 0), (1, 0), (1, 1)],),
        ([(0, 0), (1, 0)], [(1, 0), (2, 0)]),  # following
        ([(0, 0), (1, 0)], [(1, 0), (1, 1)], [(1, 1), (0, 1)], [(0, 1), (0, 0)]),  # a ring turns
        ([(0, 0), (1, 0)], [(0, 1), (1, 1)]),  # side by side
    ],
)
def test_valid_paths_pass(paths):
    assert check(*paths) == []


@pytest.mark.parametrize(
    ("paths", "violation"),
    [
        (([(0, 0), (1, 1)],), "robot 0 jumps from (0, 0) to (1, 1) after time 0"),
        (([(0, 0), (0, 0), (2, 0)],), "robot 0 jumps from (0, 0) to (2, 0) after time 1"),
        (([(0, 0), (1, 0)], [(2, 0), (1, 0)]), "robots 0 and 1 are both on (1, 0) at time 1"),
        (([(0, 0), (1, 0)], [(1, 0), (0, 0)]), "robots 0 and 1 swap (0, 0) and (1, 0) after time 0"),
        (
            ([(0, 0), (0, 1)], [(3, 2), (3, 2)], [(0, 1), (0, 0)]),
            "robots 0 and 2 swap (0, 0) and (0, 1) after time 0",
        ),
        (([(3, 2), (4, 2)],), "robot 0 is off the map at time 1, on (4, 2)"),
        (([(0, 0), (0, -1)],), "robot 0 is off the map at time 1, on (0, -1)"),
    ],
)
def test_a_violation_is_found_and_named(paths, violation):
    assert check(*paths) == [violation]


def test_a_robot_on_an_obstacle_is_found():
    obstacles = FREE.copy()
    obstacles[2, 1] = True  # [y, x]
    assert check([(0, 2), (1, 2)], obstacles=obstacles) == ["robot 0 is on an obstacle at time 1, on (1, 2)"]


def test_wrong_ends_are_found():
    assert check([(0, 0), (1, 0)], starts=[(0, 1)]) == ["robot 0 begins on (0, 0), and its start is (0, 1)"]
    assert check([(0, 0), (1, 0)], goals=[(2, 0)]) == ["robot 0 ends on (1, 0), and its goal is (2, 0)"]


def test_a_robot_at_rest_is_still_in_the_way():
    rest = [(1, 0), (1, 0), (1, 0)]
    assert check(rest, [(0, 0), (1, 0), (2, 0)]) == ["robots 0 and 1 are both on (1, 0) at time 1"]


def test_everything_wrong_is_reported_together():
    paths = ([(0, 0), (1, 0), (3, 0)], [(1, 0), (0, 0), (3, 0)])
    assert check(*paths) == [
        "robot 0 jumps from (1, 0) to (3, 0) after time 1",
        "robot 1 jumps from (0, 0) to (3, 0) after time 1",
        "robots 0 and 1 are both on (3, 0) at time 2",
        "robots 0 and 1 swap (0, 0) and (1, 0) after time 0",
    ]


def test_three_robots_on_one_edge_still_swap():
    paths = ([(0, 0), (1, 0)], [(0, 0), (1, 0)], [(1, 0), (0, 0)])
    assert any("swap" in violation for violation in check(*paths))


@pytest.mark.parametrize(
    ("shape", "dtype"),
    [((3, 1), int), ((0, 1, 2), int), ((3, 2, 2), int), ((3, 1, 3), int), ((3, 1, 2), float)],
)
def test_paths_of_a_wrong_form_are_refused(shape, dtype):
    (violation,) = check_paths(FREE, [(0, 0)], [(0, 0)], np.zeros(shape, dtype))
    assert violation.startswith("paths have")


def test_a_hopeless_set_of_paths_gives_a_short_report():
    paths = np.zeros((100, 50, 2), int)
    violations = check_paths(FREE, np.zeros((50, 2), int), np.zeros((50, 2), int), paths)
    assert len(violations) == 20
