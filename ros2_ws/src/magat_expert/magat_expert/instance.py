# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Validation of multi-agent path finding instances and of the parameters of a search."""

import math
import operator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from magat_expert import _core

MAX_SEED = 2**64 - 1  # seeds are 64-bit numbers
MAX_ROBOTS = 32_767  # the search stores robots in 16 bits
MAX_SIDE = 32_767  # paths store coordinates in 16 bits
#: Largest suboptimality bound, and its default.
MAX_W, DEFAULT_W = 1_000.0, 1.1
#: Largest memory limit of a search, and its default, MiB.
MAX_MEMORY_LIMIT, DEFAULT_MEMORY_LIMIT = 2**20, 1024


class InvalidInstanceError(ValueError):
    """The instance or a parameter of the search is invalid; the message says why and what to do."""


@dataclass(frozen=True)
class Instance:
    """A validated instance, in the dtypes that the search needs.

    Attributes:
        obstacles: uint8 `[H, W]`, indexed `[y, x]`, 1 on obstacles.
        starts: int32 `[N, 2]`, cells `(x, y)`.
        goals: int32 `[N, 2]`, cells `(x, y)`.
    """

    obstacles: np.ndarray
    starts: np.ndarray
    goals: np.ndarray

    @property
    def num_robots(self) -> int:
        return len(self.starts)


def validate_instance(obstacles: ArrayLike, starts: ArrayLike, goals: ArrayLike) -> Instance:
    """Check an instance and convert it.

    Args:
        obstacles: bool `[H, W]`, indexed `[y, x]`, y up; integers 0 and 1 are allowed, too.
        starts: int `[N, 2]`, cells `(x, y)`, no two alike.
        goals: int `[N, 2]`, cells `(x, y)`, no two alike, each reachable from its robot's start.

    Raises:
        InvalidInstanceError: the instance is invalid; the message names the first fault, with the robot and the cell.
    """
    mask = _mask(obstacles)
    start_cells = _cells(starts, "starts")
    goal_cells = _cells(goals, "goals")
    if len(start_cells) != len(goal_cells):
        raise InvalidInstanceError(
            f"there are {len(start_cells)} starts and {len(goal_cells)} goals: give one of each per robot"
        )
    for cells, name in ((start_cells, "start"), (goal_cells, "goal")):
        _require_free(mask, cells, name)
        _require_unique(cells, name)
    _require_reachable(mask, start_cells, goal_cells)
    return Instance(mask, start_cells.astype(np.int32), goal_cells.astype(np.int32))


def validate_limits(w: float, time_limit: float, node_limit: int | None) -> tuple[float, float, int]:
    """Check the parameters of a search.

    Args:
        w: bound on the cost, from 1 to 1000.
        time_limit: seconds, above 0; infinity means none.
        node_limit: high-level expansions, at least 0; None means no limit.

    Returns:
        The three parameters, with -1 for a node limit of None.

    Raises:
        InvalidInstanceError: one of them is not a number, or out of range.
    """
    w = _number(w, "w")
    time_limit = validate_time_limit(time_limit)
    if not 1.0 <= w <= MAX_W:
        raise InvalidInstanceError(
            f"w is {w}: a solution costs at most w times the lower bound, so choose w from 1 (optimal) to {MAX_W:g}"
        )
    if node_limit is None:
        return w, time_limit, -1
    return w, time_limit, validate_count(node_limit, "node_limit", 0, 2**63 - 1, " (None: no limit)")


def validate_time_limit(time_limit: float) -> float:
    """Return `time_limit` if it is a number of seconds above 0; infinity is allowed.

    Raises:
        InvalidInstanceError: it is not.
    """
    time_limit = _number(time_limit, "time_limit")
    if not time_limit > 0.0:
        raise InvalidInstanceError(f"time_limit is {time_limit}: give the search more than 0 seconds")
    return time_limit


def validate_memory_limit(memory_limit: int) -> int:
    """The bytes of a `memory_limit` in MiB, from 1 to `MAX_MEMORY_LIMIT`.

    Raises:
        InvalidInstanceError: it is not a whole number, or out of range.
    """
    return validate_count(memory_limit, "memory_limit", 1, MAX_MEMORY_LIMIT, " MiB") * 2**20


def validate_count(value: int, name: str, lowest: int, highest: int, note: str = "") -> int:
    """Return `value` if it is a whole number from `lowest` to `highest`. Errors call it `name` and end with `note`.

    Raises:
        InvalidInstanceError: it is not.
    """
    try:
        number = operator.index(value)
    except TypeError:
        raise InvalidInstanceError(f"{name} is {value!r}: give a whole number{note}") from None
    if not lowest <= number <= highest:
        limit = f"{lowest} or more" if number < lowest else f"at most {highest}"
        raise InvalidInstanceError(f"{name} is {number}: give {limit}{note}")
    return number


def _number(value: object, name: str) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InvalidInstanceError(f"{name} is {value!r}: give a number") from None
    if math.isnan(number):
        raise InvalidInstanceError(f"{name} is NaN: give a number")
    return number


def _array(values: ArrayLike, name: str) -> np.ndarray:
    try:
        return np.asarray(values)
    except ValueError as error:
        raise InvalidInstanceError(f"{name} are not an array: {error}") from None


def _mask(obstacles: ArrayLike) -> np.ndarray:
    mask = _array(obstacles, "obstacles")
    if mask.ndim != 2 or 0 in mask.shape:
        raise InvalidInstanceError(
            f"obstacles have shape {mask.shape}: give a map of shape [H, W] with at least one cell"
        )
    if max(mask.shape) > MAX_SIDE:
        raise InvalidInstanceError(f"obstacles have shape {mask.shape}: at most {MAX_SIDE} cells a side are supported")
    if mask.dtype.kind not in "biu":
        raise InvalidInstanceError(f"obstacles have dtype {mask.dtype}: give bool, True on obstacles")
    if mask.dtype.kind != "b" and not np.isin(mask, (0, 1)).all():
        raise InvalidInstanceError("obstacles hold integers other than 0 and 1: give bool, True on obstacles")
    return np.ascontiguousarray(mask, dtype=np.uint8)


def _cells(cells: ArrayLike, name: str) -> np.ndarray:
    array = _array(cells, name)
    if array.ndim != 2 or array.shape[1] != 2:
        raise InvalidInstanceError(f"{name} have shape {array.shape}: give [N, 2], one cell (x, y) per robot")
    if not 1 <= len(array) <= MAX_ROBOTS:
        raise InvalidInstanceError(f"there are {len(array)} {name}: give 1 to {MAX_ROBOTS} robots")
    if array.dtype.kind not in "iu":
        raise InvalidInstanceError(f"{name} have dtype {array.dtype}: cells are integers, round them first")
    return array


def _require_free(mask: np.ndarray, cells: np.ndarray, name: str) -> None:
    height, width = mask.shape
    outside = (cells < 0).any(axis=1) | (cells[:, 0] >= width) | (cells[:, 1] >= height)
    if outside.any():
        robot = int(outside.argmax())
        raise InvalidInstanceError(
            f"the {name} of robot {robot}, cell {_show(cells[robot])}, is outside the map of "
            f"{width} x {height} cells: x goes from 0 to {width - 1}, y from 0 to {height - 1}"
        )
    blocked = mask[cells[:, 1], cells[:, 0]] != 0
    if blocked.any():
        robot = int(blocked.argmax())
        raise InvalidInstanceError(
            f"the {name} of robot {robot}, cell {_show(cells[robot])}, is on an obstacle: "
            "move it to a free cell (arrays are indexed [y, x])"
        )


def _require_unique(cells: np.ndarray, name: str) -> None:
    owner: dict[tuple[int, int], int] = {}
    for robot, cell in enumerate(map(tuple, cells.tolist())):
        other = owner.setdefault(cell, robot)
        if other == robot:
            continue
        raise InvalidInstanceError(
            f"robots {other} and {robot} have the same {name}, cell {_show(cells[robot])}: "
            f"give every robot a {name} of its own"
        )


def _require_reachable(mask: np.ndarray, starts: np.ndarray, goals: np.ndarray) -> None:
    component = _core.components(mask)
    cut_off = component[starts[:, 1], starts[:, 0]] != component[goals[:, 1], goals[:, 0]]
    if cut_off.any():
        robot = int(cut_off.argmax())
        raise InvalidInstanceError(
            f"robot {robot} cannot reach its goal, cell {_show(goals[robot])}, from its start, cell "
            f"{_show(starts[robot])}: obstacles separate them, so choose another goal"
        )


def _show(cell: np.ndarray) -> str:
    return f"({int(cell[0])}, {int(cell[1])})"
