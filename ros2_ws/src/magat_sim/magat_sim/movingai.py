# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cases in the files of the path finding community: MovingAI's `.map` and `.scen`.

Sturtevant: "Benchmarks for Grid-Based Pathfinding" (TCIAIG 2012), and Stern et al.: "Multi-Agent Pathfinding:
Definitions, Variants, and Benchmarks" (SoCS 2019). In the files y points down from the top left cell; here it points up
from the bottom left one. Only this module converts: `y = height - 1 - y of the file`, and the
last line of a map is `y = 0`.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.sparse.csgraph import dijkstra

from magat_sim.case import Case, InvalidCaseError, make_case
from magat_sim.grid import BoolArray, IntArray

#: Terrain that a robot can enter: ground, and the swamp of the games' maps.
_FREE = ".GS"
#: Terrain that it cannot: out of bounds, trees, water.
_BLOCKED = "@OTW"
_COLUMNS = ("bucket", "map", "width", "height", "start x", "start y", "goal x", "goal y", "length")


class MovingAIError(InvalidCaseError):
    """A file that is no map or scenario; the message begins with its name and the line's number, from 1."""


def read_map(path: Path) -> BoolArray:
    """The obstacles of a `.map` file.

    Returns:
        ``[H, W]`` bool, indexed ``[y, x]``, y up; True is an obstacle. Free are `.`, `G` and `S`; blocked are `@`, `O`,
        `T` and `W`.

    Raises:
        MovingAIError: the file is not a map; the message says in which line and why.
        OSError: the file cannot be read.
    """
    lines = _lines(path)
    sizes = dict.fromkeys(("height", "width"), 0)
    for number, line in lines:
        word, *values = line.split(maxsplit=1)
        if word == "map":
            break
        if word in sizes:
            sizes[word] = _whole(path, number, "".join(values), word, 1)
        elif word != "type":  # nobody uses its value, and some files lack it
            raise MovingAIError(f"{path}:{number}: {line!r} is not a line of a map's header: type, height, width, map")
    else:
        raise MovingAIError(f"{path}: there is no line 'map' before the rows")
    if 0 in sizes.values():
        raise MovingAIError(f"{path}:{number}: the header lacks height or width before 'map'")
    return _rows(path, lines, sizes["width"], sizes["height"])


def _rows(path: Path, lines: Iterator[tuple[int, str]], width: int, height: int) -> BoolArray:
    rows = []
    for number, line in lines:
        if len(line) != width:
            raise MovingAIError(f"{path}:{number}: the row has {len(line)} cells, but the map's width is {width}")
        strange = next((i for i, cell in enumerate(line) if cell not in _FREE + _BLOCKED), None)
        if strange is not None:
            raise MovingAIError(
                f"{path}:{number}: {line[strange]!r} in column {strange + 1} is not a terrain: {_FREE} are free, "
                f"{_BLOCKED} are blocked"
            )
        rows.append([cell in _BLOCKED for cell in line])
    if len(rows) != height:
        raise MovingAIError(f"{path}: there are {len(rows)} rows, but the map's height is {height}")
    return np.array(rows[::-1], dtype=bool)


def write_map(path: Path, obstacles: npt.ArrayLike) -> None:
    """Write ``obstacles`` (``[H, W]`` bool, indexed ``[y, x]``, y up) as a `.map` file."""
    mask = np.asarray(obstacles, dtype=bool)
    rows = ["".join("@" if blocked else "." for blocked in row) for row in mask[::-1]]
    head = ["type octile", f"height {mask.shape[0]}", f"width {mask.shape[1]}", "map"]
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="ascii")


def read_case(map_path: Path, scenario_path: Path, robots: int | None = None) -> Case:
    """A case of a `.map` file and the first lines of a `.scen` file, one a robot.

    Args:
        map_path: the map. The map's name in the scenario is ignored, because it is relative to an unknown folder.
        scenario_path: the starts and goals. Buckets and lengths are ignored.
        robots: the number of lines to read; all if None.

    Raises:
        MovingAIError: a file is malformed or has too few lines, or a goal cannot be reached from its start; the
            message says where and why.
        OSError: a file cannot be read.
    """
    obstacles = read_map(map_path)
    lines = _lines(scenario_path)
    number, head = next(lines, (1, ""))
    if head.split() not in (["version", "1"], ["version", "1.0"]):
        raise MovingAIError(f"{scenario_path}:{number}: {head!r} instead of 'version 1'")
    regions, _ = ndimage.label(~obstacles)
    cells: list[tuple[int, int, int, int]] = []
    seen: dict[tuple[str, int, int], int] = {}
    for number, line in lines:
        if robots is not None and len(cells) == robots:
            break
        cells.append(_robot(scenario_path, number, line, regions, seen))
    if not cells or len(cells) < (robots or 0):
        raise MovingAIError(f"{scenario_path}: it has {len(cells)} robots, but {robots or 1} are needed")
    table = np.array(cells)
    try:
        return make_case(obstacles, table[:, :2], table[:, 2:])
    except InvalidCaseError as error:
        raise MovingAIError(f"{scenario_path}: {error}") from error


def _robot(
    path: Path, number: int, line: str, regions: IntArray, seen: dict[tuple[str, int, int], int]
) -> tuple[int, int, int, int]:
    """Start and goal, y up, of one line.

    ``regions`` (``[H, W]``) numbers the connected parts of the map, 0 on obstacles. ``seen`` holds the lines that took
    a start or a goal.
    """
    values = line.split("\t") if "\t" in line else line.split()
    if len(values) != len(_COLUMNS):
        raise MovingAIError(
            f"{path}:{number}: the line has {len(values)} values, not {len(_COLUMNS)} ({', '.join(_COLUMNS)})"
        )
    width, height, *cells = (
        _whole(path, number, value.strip(), name) for name, value in zip(_COLUMNS[2:8], values[2:8], strict=True)
    )
    if (height, width) != regions.shape:
        raise MovingAIError(
            f"{path}:{number}: the scenario is for {width}x{height} cells, but the map has "
            f"{regions.shape[1]}x{regions.shape[0]}"
        )
    for name, (x, y) in (("start", cells[:2]), ("goal", cells[2:])):
        where = f"{path}:{number}: the {name} ({x}, {y}), y down from the top,"
        if x >= width or y >= height:
            raise MovingAIError(f"{where} lies outside the {width}x{height} map")
        if regions[height - 1 - y, x] == 0:
            raise MovingAIError(f"{where} is an obstacle")
        other = seen.setdefault((name, x, y), number)
        if other != number:
            raise MovingAIError(f"{where} is also that of line {other}: {name}s must differ")
    ends = cells[0], height - 1 - cells[1], cells[2], height - 1 - cells[3]
    if regions[ends[1], ends[0]] != regions[ends[3], ends[2]]:
        raise MovingAIError(
            f"{path}:{number}: the goal ({cells[2]}, {cells[3]}) cannot be reached from the start ({cells[0]}, "
            f"{cells[1]}), y down from the top: obstacles lie between them"
        )
    return ends


def write_case(case: Case, map_path: Path, scenario_path: Path) -> None:
    """Write ``case`` as a `.map` file and a `.scen` file that refers to it.

    The lengths in the scenario are those of shortest paths with moves along the axes, in cells.
    """
    write_map(map_path, case.obstacles)
    height, width = case.obstacles.shape
    lines = ["version 1"]
    for start, goal, length in zip(case.starts.tolist(), case.goals.tolist(), _lengths(case), strict=True):
        values = (0, map_path.name, width, height, start[0], height - 1 - start[1], goal[0], height - 1 - goal[1])
        lines.append("\t".join(map(str, (*values, length))))
    scenario_path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _lengths(case: Case) -> list[int]:
    """Length of each robot's shortest path, other robots ignored."""
    height, width = case.obstacles.shape
    free = ~case.obstacles
    cells = np.arange(height * width).reshape(height, width)
    beside, above = free[:, :-1] & free[:, 1:], free[:-1] & free[1:]
    here = np.concatenate([cells[:, :-1][beside], cells[:-1][above]])
    there = np.concatenate([cells[:, 1:][beside], cells[1:][above]])
    graph = sparse.coo_array((np.ones(len(here)), (here, there)), shape=(height * width, height * width)).tocsr()
    starts, goals = (cells[c[:, 1], c[:, 0]] for c in (case.starts, case.goals))
    return [
        int(dijkstra(graph, directed=False, unweighted=True, indices=start)[goal])
        for start, goal in zip(starts, goals, strict=True)
    ]


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """The non-blank lines of a file, with their numbers from 1."""
    # utf-8-sig drops a byte order mark, which some editors write.
    for number, line in enumerate(path.read_text(encoding="utf-8-sig", errors="replace").splitlines(), 1):
        if line.strip():
            yield number, line.strip()


def _whole(path: Path, number: int, text: str, name: str, at_least: int = 0) -> int:
    if not text.isdecimal() or int(text) < at_least:
        raise MovingAIError(f"{path}:{number}: {name} is {text!r}: give a whole number of at least {at_least}")
    return int(text)
