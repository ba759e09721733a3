# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""MovingAI's files: what is written is read back, y is turned round, and what is wrong is named with its line."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from magat_sim.case import draw_case
from magat_sim.movingai import MovingAIError, read_case, read_map, write_case, write_map

MAP = """type octile
height 3
width 4
map
.@.T
..GS
OW..
"""
SCENARIO = """version 1
0\tempty.map\t4\t3\t0\t0\t3\t2\t5.0
0\tempty.map\t4\t3\t2\t2\t0\t1\t3.41421356
"""


@pytest.fixture
def files(tmp_path):
    """Writes a map and a scenario; returns their paths."""

    def write(text=MAP, scenario=SCENARIO):
        paths = tmp_path / "a.map", tmp_path / "a.scen"
        paths[0].write_text(text)
        paths[1].write_text(scenario)
        return paths

    return write


def test_the_last_row_is_the_lowest(files):
    obstacles = read_map(files()[0])
    assert obstacles.astype(int).tolist() == [[1, 1, 0, 0], [0, 0, 0, 0], [0, 1, 0, 1]]  # [y, x]


def test_cells_are_turned_round(files):
    case = read_case(*files())
    assert case.starts.tolist() == [[0, 2], [2, 0]]
    assert case.goals.tolist() == [[3, 0], [0, 1]]
    assert read_case(*files(), robots=1).starts.tolist() == [[0, 2]]


def test_blanks_and_windows_line_ends_do_not_matter(files):
    spaced = SCENARIO.replace("\t", "  ").replace("\n", "\r\n") + "\r\n"
    assert read_case(*files(MAP.replace("\n", "\r\n") + "\n", spaced)).robots == 2


@given(
    seed=st.integers(0, 2**32 - 1),
    width=st.integers(1, 12),
    height=st.integers(1, 12),
    density=st.sampled_from([0.0, 0.1, 0.4]),
    share=st.floats(0.0, 1.0),
)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_written_is_read_back(tmp_path, seed, width, height, density, share):
    free = width * height - round(density * width * height)
    case = draw_case(seed, 0, width, height, max(1, int(share * free)), density)
    paths = tmp_path / "a.map", tmp_path / "a.scen"

    write_case(case, *paths)
    again = read_case(*paths)

    np.testing.assert_array_equal(again.obstacles, case.obstacles)
    np.testing.assert_array_equal(again.starts, case.starts)
    np.testing.assert_array_equal(again.goals, case.goals)
    lengths = [int(line.split("\t")[-1]) for line in paths[1].read_text().splitlines()[1:]]
    assert lengths == [_steps(case.obstacles, *ends) for ends in zip(case.starts, case.goals, strict=True)]


def _steps(obstacles, start, goal):
    """Breadth first, cell by cell."""
    steps, front = 0, {tuple(start.tolist())}
    free = {(int(x), int(y)) for y, x in np.argwhere(~obstacles)} - front
    while tuple(goal.tolist()) not in front:
        front = {c for x, y in front for c in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)) if c in free}
        free -= front
        steps += 1
    return steps


def test_a_map_is_written_as_others_read_it(tmp_path):
    write_map(tmp_path / "a.map", np.array([[0, 1, 1], [0, 0, 0]], bool))
    assert (tmp_path / "a.map").read_text() == "type octile\nheight 2\nwidth 3\nmap\n...\n.@@\n"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("height 3", "height x", r"a\.map:2: height is 'x': give a whole number of at least 1"),
        ("width 4", "width 0", r"a\.map:3: width is '0'"),
        ("width 4", "depth 4", r"a\.map:3: 'depth 4' is not a line of a map's header"),
        ("width 4\n", "", r"a\.map:3: the header lacks"),
        ("map\n.@.T\n..GS\nOW..\n", "", r"a\.map: there is no line 'map'"),
        ("..GS", "..G", r"a\.map:6: the row has 3 cells, but the map's width is 4"),
        ("..GS", "..?S", r"a\.map:6: '\?' in column 3 is not a terrain"),
        ("OW..\n", "", r"a\.map: there are 2 rows, but the map's height is 3"),
    ],
)
def test_a_bad_map_is_refused_with_its_line(files, old, new, message):
    with pytest.raises(MovingAIError, match=message):
        read_map(files(MAP.replace(old, new))[0])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("version 1", "version 2", r"a\.scen:1: 'version 2' instead of 'version 1'"),
        ("\t5.0", "", r"a\.scen:2: the line has 8 values, not 9"),
        ("\t2\t2\t0\t1", "\t2\t2.5\t0\t1", r"a\.scen:3: start y is '2\.5'"),
        ("\t2\t2\t0\t1", "\t-1\t2\t0\t1", r"a\.scen:3: start x is '-1'"),
        ("\t2\t2\t0\t1", "\t2\t3\t0\t1", r"a\.scen:3: the start \(2, 3\), .* outside the 4x3 map"),
        ("\t2\t2\t0\t1", "\t2\t2\t1\t0", r"a\.scen:3: the goal \(1, 0\), .* is an obstacle"),
        ("\t2\t2\t0\t1", "\t0\t0\t0\t1", r"a\.scen:3: the start \(0, 0\), .* is also that of line 2"),
        ("\t2\t2\t0\t1", "\t2\t2\t3\t2", r"a\.scen:3: the goal \(3, 2\), .* is also that of line 2"),
        ("\t4\t3\t2", "\t4\t4\t2", r"a\.scen:3: the scenario is for 4x4 cells, but the map has 4x3"),
    ],
)
def test_a_bad_scenario_is_refused_with_its_line(files, old, new, message):
    with pytest.raises(MovingAIError, match=message):
        read_case(*files(scenario=SCENARIO.replace(old, new)))


@pytest.mark.parametrize(("scenario", "robots"), [(SCENARIO, 3), ("version 1\n", None), ("version 1\n", 0)])
def test_too_few_robots_are_refused(files, scenario, robots):
    with pytest.raises(MovingAIError, match="robots, but"):
        read_case(*files(scenario=scenario), robots)


def test_an_unreachable_goal_is_named_as_in_the_file(files):
    said = r"a\.scen:2: the goal \(3, 2\) cannot be reached from the start \(0, 0\), y down from the top"
    with pytest.raises(MovingAIError, match=said):
        read_case(*files(MAP.replace("..GS", "@@@@")), robots=1)


@pytest.mark.parametrize(
    ("text", "scenario"),
    [
        (MAP.replace("type octile\n", ""), SCENARIO),
        (MAP.replace("type octile", "type"), SCENARIO),
        ("\ufeff" + MAP, "\ufeff" + SCENARIO),
        (MAP.replace("\n", "\t\n"), SCENARIO.replace("\n", "\t\n")),
        (MAP.replace("height 3", "height\t3").replace("\n", " \r\n"), SCENARIO.replace("\n", "\r\n")),
    ],
    ids=["no type", "an empty type", "byte order marks", "trailing tabs", "tabs in the header and CRLF"],
)
def test_what_nobody_uses_is_not_needed(files, text, scenario):
    expected, found = read_case(*files()), read_case(*files(text, scenario))
    assert np.array_equal(found.obstacles, expected.obstacles)
    assert np.array_equal(found.starts, expected.starts)
    assert np.array_equal(found.goals, expected.goals)
