# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cases: a map with starts and goals, checked, and drawn from a seed and a number."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from magat_node.errors import MagatError
from magat_sim.grid import BoolArray, IntArray, at, inside

#: Limit for drawn maps, because any client in the network may request them and cells take memory and time.
MOST_CELLS = 2**20


class InvalidCaseError(MagatError, ValueError):
    """A case is invalid; the message says which robot, which cell and why."""


@dataclass(frozen=True)
class Case:
    """One multi-robot path planning instance. Build it with `make_case`, which checks it."""

    #: ``[H, W]`` bool, indexed ``[y, x]``; True is an obstacle.
    obstacles: BoolArray
    #: ``[N, 2]`` int64 cells ``(x, y)``.
    starts: IntArray
    #: ``[N, 2]`` int64 cells ``(x, y)``.
    goals: IntArray

    @property
    def robots(self) -> int:
        """Number of robots, N."""
        return len(self.starts)


def make_case(obstacles: npt.ArrayLike, starts: npt.ArrayLike, goals: npt.ArrayLike) -> Case:
    """A checked case.

    Args:
        obstacles: ``[H, W]``, 0/1 or bool, indexed ``[y, x]``.
        starts: ``[N, 2]`` integers ``(x, y)``.
        goals: ``[N, 2]`` integers ``(x, y)``.

    Raises:
        InvalidCaseError: wrong shapes or values, a cell outside the map or on an obstacle, a start or goal that two
            robots share, or a goal that cannot be reached from its start.
    """
    values = _numbers(obstacles, "the map")
    if values.ndim != 2 or values.size == 0:
        raise InvalidCaseError(f"the map has shape {values.shape}: give a non-empty [height, width] array")
    wrong = ~np.isin(values, (0, 1))
    if wrong.any():
        raise InvalidCaseError(f"the map holds the value {values[wrong][0]:g}: use 0 (free) and 1 (obstacle)")
    grid = values.astype(bool)
    cells = {"start": _cells(starts, "starts"), "goal": _cells(goals, "goals")}
    if len(cells["start"]) != len(cells["goal"]):
        raise InvalidCaseError(
            f"{len(cells['start'])} starts but {len(cells['goal'])} goals: give one of each per robot"
        )
    for what, where in cells.items():
        _check_cells(grid, where, what)
    regions, _ = ndimage.label(~grid)
    apart = at(regions, cells["start"]) != at(regions, cells["goal"])
    if apart.any():
        robot = int(np.flatnonzero(apart)[0])
        raise InvalidCaseError(
            f"robot {robot}: goal {_text(cells['goal'][robot])} cannot be reached from start "
            f"{_text(cells['start'][robot])}: obstacles lie between them"
        )
    return Case(grid, cells["start"], cells["goal"])


def draw_case(
    seed: int, number: int, width: int = 20, height: int = 20, robots: int = 10, density: float = 0.1
) -> Case:
    """Case ``number`` of the series of ``seed``; the same on every machine.

    Obstacles are drawn uniformly (exactly ``round(density * width * height)`` of them), starts are unique, goals are
    unique, and every goal can be reached from its start.

    Raises:
        InvalidCaseError: too many robots, obstacles or cells.
    """
    if not 0 <= density <= 1:  # NaN is not
        raise InvalidCaseError(f"the obstacle density is {density:g}: give a share of the cells, 0 to 1")
    if width < 1 or height < 1:
        raise InvalidCaseError(f"a map of {width}x{height} cells has no cells: give at least 1x1")
    if robots < 1:
        raise InvalidCaseError(f"a case of {robots} robots: ask for at least 1")
    if width * height > MOST_CELLS:
        raise InvalidCaseError(
            f"a map of {width}x{height} cells is too large to be drawn: ask for at most {MOST_CELLS} cells"
        )
    count = round(density * width * height)
    if count + robots > width * height:
        raise InvalidCaseError(
            f"{robots} robots do not fit on a {width}x{height} map of obstacle density {density}: ask for fewer"
        )
    # Only random() is used: NumPy promises that its stream does not change, unlike those of choice() and shuffle().
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, number])))
    cells = np.zeros(width * height, dtype=bool)
    cells[np.argsort(rng.random(width * height), kind="stable")[:count]] = True
    grid = cells.reshape(height, width)
    y, x = np.nonzero(~grid)
    free = np.stack([x, y], axis=1).astype(np.int64)
    starts = free[np.argsort(rng.random(len(free)), kind="stable")[:robots]]
    goals = _draw_goals(grid, starts, free[np.argsort(rng.random(len(free)), kind="stable")])
    return Case(grid, starts, goals)


def _draw_goals(grid: BoolArray, starts: IntArray, shuffled: IntArray) -> IntArray:
    """For each start, the first cell of ``shuffled`` that is reachable from it and not yet taken.

    There always is one, because a region has at least as many cells as starts.
    """
    regions, _ = ndimage.label(~grid)
    region_of = at(regions, shuffled)
    taken = np.zeros(len(shuffled), dtype=bool)
    goals = np.empty_like(starts)
    for robot, region in enumerate(at(regions, starts)):
        first = np.flatnonzero((region_of == region) & ~taken)[0]
        taken[first] = True
        goals[robot] = shuffled[first]
    return goals


def _numbers(values: npt.ArrayLike, what: str) -> npt.NDArray[np.float64]:
    try:
        return np.asarray(values, dtype=np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise InvalidCaseError(f"{what}: {error}; give an array of numbers") from error


def _cells(cells: npt.ArrayLike, what: str) -> IntArray:
    array = _numbers(cells, what)
    if array.ndim != 2 or array.shape[1] != 2 or len(array) == 0:
        raise InvalidCaseError(f"{what} have shape {array.shape}: give [N, 2] cells (x, y), N at least 1")
    # This form fails for NaN, too. No map reaches 2**31.
    whole = (np.floor(array) == array) & (np.abs(array) < 2**31)
    if not whole.all():
        robot = int(np.flatnonzero(~whole.all(axis=1))[0])
        raise InvalidCaseError(
            f"robot {robot}: {what} hold {array[robot].tolist()}, which is not a cell: give whole numbers"
        )
    return array.astype(np.int64)


def _check_cells(grid: BoolArray, cells: IntArray, what: str) -> None:
    height, width = grid.shape
    outside = ~inside(grid.shape, cells)
    if outside.any():
        robot = int(np.flatnonzero(outside)[0])
        raise InvalidCaseError(f"robot {robot}: {what} {_text(cells[robot])} lies outside the {width}x{height} map")
    blocked = at(grid, cells)
    if blocked.any():
        robot = int(np.flatnonzero(blocked)[0])
        raise InvalidCaseError(f"robot {robot}: {what} {_text(cells[robot])} is an obstacle")
    _, first, inverse = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    shared = first[inverse.ravel()] != np.arange(len(cells))
    if shared.any():
        robot = int(np.flatnonzero(shared)[0])
        other = int(first[inverse.ravel()[robot]])
        raise InvalidCaseError(
            f"robots {other} and {robot} share the {what} {_text(cells[robot])}: {what}s must differ"
        )


def _text(cell: IntArray) -> str:
    return f"({int(cell[0])}, {int(cell[1])})"
