# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cells and motion primitives. Only this module converts between cells ``(x, y)`` and array indices ``[y, x]``."""

from enum import IntEnum

import numpy as np
import numpy.typing as npt

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]


class Primitive(IntEnum):
    """Motion primitives, in the order used everywhere (messages, networks, files)."""

    IDLE = 0
    UP = 1
    DOWN = 2
    LEFT = 3
    RIGHT = 4


#: ``[5, 2]`` change of ``(x, y)`` by each primitive, cells; x to the right, y up.
DELTAS: IntArray = np.array([[0, 0], [0, 1], [0, -1], [-1, 0], [1, 0]], dtype=np.int64)


def at(array: npt.NDArray, cells: npt.ArrayLike) -> npt.NDArray:
    """The values of ``array`` at ``cells``.

    Args:
        array: ``[H, W]``, indexed ``[y, x]``.
        cells: ``[..., 2]`` integer ``(x, y)``, inside the array.

    Returns:
        ``[...]``, the dtype of ``array``.
    """
    cells = np.asarray(cells)
    return array[cells[..., 1], cells[..., 0]]


def inside(shape: tuple[int, int], cells: npt.ArrayLike) -> BoolArray:
    """Whether each of ``cells`` (``[..., 2]``, ``(x, y)``) lies in an array of ``shape`` ``(H, W)``; ``[...]`` bool."""
    cells = np.asarray(cells)
    height, width = shape
    x, y = cells[..., 0], cells[..., 1]
    return (x >= 0) & (x < width) & (y >= 0) & (y < height)


def primitives_between(before: npt.ArrayLike, after: npt.ArrayLike) -> IntArray:
    """The primitives that lead from some cells to others.

    Args:
        before: ``[..., 2]`` cells.
        after: ``[..., 2]`` cells, each equal or adjacent to its cell in ``before``.

    Returns:
        ``[...]`` int64.

    Raises:
        ValueError: a step is longer than one cell.
    """
    step = np.asarray(after, dtype=np.int64) - np.asarray(before, dtype=np.int64)
    if (np.abs(step).sum(axis=-1) > 1).any():
        bad = step[np.abs(step).sum(axis=-1) > 1][0]
        raise ValueError(
            f"a step of {tuple(int(v) for v in bad)} cells is not a motion primitive: move at most one cell at a time"
        )
    dx, dy = step[..., 0], step[..., 1]
    up_down = np.where(dy > 0, Primitive.UP, Primitive.DOWN)
    left_right = np.where(dx > 0, Primitive.RIGHT, Primitive.LEFT)
    return np.where(dy != 0, up_down, np.where(dx != 0, left_right, Primitive.IDLE)).astype(np.int64)
