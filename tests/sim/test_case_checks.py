# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `make_case` refuses, and what its messages say."""

import numpy as np
import pytest

from magat_sim.case import InvalidCaseError, make_case

# y = 2 . . .
# y = 1 # # .
# y = 0 . . .
MAP = [[0, 0, 0], [1, 1, 0], [0, 0, 0]]


def test_a_sound_case_is_taken_as_it_is() -> None:
    case = make_case(MAP, [[0, 0], [2, 1]], [[0, 2], [0, 0]])
    assert case.obstacles.dtype == bool
    assert case.obstacles.tolist() == np.array(MAP, dtype=bool).tolist()
    assert case.starts.dtype == case.goals.dtype == np.int64
    assert case.starts.tolist() == [[0, 0], [2, 1]]
    assert case.goals.tolist() == [[0, 2], [0, 0]]
    assert case.robots == 2


def test_whole_floats_are_cells_and_a_robot_may_start_on_its_goal() -> None:
    case = make_case(MAP, [[1.0, 0.0]], np.array([[1, 0]], dtype=np.uint8))
    assert case.starts.tolist() == case.goals.tolist() == [[1, 0]]


@pytest.mark.parametrize(
    ("starts", "goals", "words"),
    [
        ([[0, 0], [3, 0]], [[0, 2], [1, 2]], ["robot 1", "start (3, 0)", "outside", "3x3"]),
        ([[0, 0], [0, 3]], [[0, 2], [1, 2]], ["robot 1", "start (0, 3)", "outside"]),
        ([[-1, 0], [0, 0]], [[0, 2], [1, 2]], ["robot 0", "start (-1, 0)", "outside"]),
        ([[0, 0], [1, 0]], [[0, 2], [1, -1]], ["robot 1", "goal (1, -1)", "outside"]),
        ([[1, 1], [0, 0]], [[0, 2], [1, 2]], ["robot 0", "start (1, 1)", "obstacle"]),
        ([[2, 2], [0, 0]], [[0, 2], [0, 1]], ["robot 1", "goal (0, 1)", "obstacle"]),
        ([[2, 2], [0, 0], [2, 2]], [[0, 2], [1, 2], [0, 0]], ["robots 0 and 2", "start (2, 2)"]),
        ([[0, 0], [1, 0], [2, 0]], [[0, 2], [1, 2], [1, 2]], ["robots 1 and 2", "goal (1, 2)"]),
    ],
)
def test_a_bad_cell_is_named_with_its_robot(starts: list, goals: list, words: list[str]) -> None:
    with pytest.raises(InvalidCaseError) as refusal:
        make_case(MAP, starts, goals)
    assert [word for word in words if word not in str(refusal.value)] == []


def test_cells_are_checked_on_maps_that_are_not_square() -> None:
    wide = np.zeros((2, 5))
    wide[1, 4] = 1
    assert make_case(wide, [[4, 0]], [[3, 1]]).robots == 1
    with pytest.raises(InvalidCaseError, match=r"robot 0: goal \(4, 1\) is an obstacle"):
        make_case(wide, [[4, 0]], [[4, 1]])
    with pytest.raises(InvalidCaseError, match=r"robot 0: start \(1, 4\) lies outside the 5x2 map"):
        make_case(wide, [[1, 4]], [[4, 0]])


@pytest.mark.parametrize("cells", ["row", "diagonal"])
def test_a_goal_behind_obstacles_is_named_with_its_robot(cells: str) -> None:
    walled = np.zeros((3, 3), dtype=bool)
    walled[{"row": ([1, 1, 1], [0, 1, 2]), "diagonal": ([0, 1, 2], [2, 1, 0])}[cells]] = True
    with pytest.raises(InvalidCaseError) as refusal:
        make_case(walled, [[0, 0], [1, 0]], [[1, 0], [2, 2]])
    assert "robot 1: goal (2, 2) cannot be reached from start (1, 0)" in str(refusal.value)


@pytest.mark.parametrize(
    "bad",
    [
        pytest.param([[0, np.nan]], id="nan"),
        pytest.param([[0, np.inf]], id="infinity"),
        pytest.param([[0.5, 0]], id="between two cells"),
        pytest.param([[0, 2.0**70]], id="huge float"),
        pytest.param([[0, 2**70]], id="huge integer"),
        pytest.param([[0, 10**400]], id="integer beyond floats"),
        pytest.param([["a", "b"]], id="text"),
        pytest.param([[None, 0]], id="none"),
        pytest.param([[0, 0], [0]], id="ragged"),
        pytest.param([0, 0], id="not in a list"),
        pytest.param([[0, 0, 0]], id="three coordinates"),
        pytest.param([], id="empty"),
        pytest.param(np.zeros((0, 2)), id="no robots"),
        pytest.param(np.zeros((1, 1, 2)), id="three dimensions"),
    ],
)
@pytest.mark.parametrize("what", ["starts", "goals"])
@pytest.mark.filterwarnings("ignore:invalid value encountered in cast")
def test_cells_of_the_wrong_kind_are_refused_by_name(bad: object, what: str) -> None:
    cells = {"starts": [[0, 0]], "goals": [[0, 0]]} | {what: bad}
    with pytest.raises(InvalidCaseError, match=what):
        make_case(MAP, **cells)


def test_starts_and_goals_must_be_equally_many() -> None:
    with pytest.raises(InvalidCaseError, match="2 starts but 1 goals"):
        make_case(MAP, [[0, 0], [1, 0]], [[0, 2]])


@pytest.mark.parametrize(
    "bad",
    [
        pytest.param([], id="empty"),
        pytest.param([0, 0], id="one dimension"),
        pytest.param(np.zeros((0, 4)), id="no rows"),
        pytest.param(np.zeros((2, 2, 2)), id="three dimensions"),
        pytest.param([[0, 2]], id="two"),
        pytest.param([[0, -1]], id="negative"),
        pytest.param([[0, 0.5]], id="half"),
        pytest.param([[0, np.nan]], id="nan"),
        pytest.param([[0, 0], [0]], id="ragged"),
    ],
)
def test_a_map_of_the_wrong_kind_is_refused(bad: object) -> None:
    with pytest.raises(InvalidCaseError, match="the map"):
        make_case(bad, [[0, 0]], [[0, 0]])
