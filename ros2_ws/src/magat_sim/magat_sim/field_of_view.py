# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The field of view of a robot: the input tensor of the policy (MAGAT paper, Sec. V-B)."""

import numpy as np
import numpy.typing as npt

from magat_sim.grid import IntArray

#: Cells seen in each direction: the field of view is 9 x 9.
RADIUS = 4
#: Width and height of the input tensor: the field of view and the ring around it.
SIZE = 2 * RADIUS + 3
CENTRE = RADIUS + 1
#: Channels of the input tensor, in order.
OBSTACLES, ROBOTS, GOAL = 0, 1, 2

Uint8Array = npt.NDArray[np.uint8]


def pad(grids: npt.ArrayLike, value: int) -> Uint8Array:
    """``[..., H, W]`` grids, padded with `RADIUS` cells of ``value`` so that no field of view leaves the array."""
    grids = np.asarray(grids, dtype=np.uint8)
    width = [(0, 0)] * (grids.ndim - 2) + [(RADIUS, RADIUS)] * 2
    return np.pad(grids, width, constant_values=value)


def field_of_view(
    obstacles: Uint8Array, robots: Uint8Array, world: IntArray, position: IntArray, goal: IntArray
) -> Uint8Array:
    """Input tensors of R robots in B worlds.

    Args:
        obstacles: ``[B, H + 2 * RADIUS, W + 2 * RADIUS]`` uint8, padded with 1 (outside the map is an obstacle).
        robots: same shape, 1 where a robot is, padded with 0.
        world: ``[R]`` which of the B worlds each robot is in.
        position: ``[R, 2]`` cells ``(x, y)``.
        goal: ``[R, 2]`` cells ``(x, y)``.

    Returns:
        ``[R, 3, 11, 11]`` uint8 of 0 and 1, rows along y (up), columns along x; the robot is at ``[:, 5, 5]``. The
        outer ring is zero except for the mark of a goal out of view, which is where the line to the goal crosses it.
    """
    _, height, width = obstacles.shape
    window = (np.arange(2 * RADIUS + 1)[:, None] * width + np.arange(2 * RADIUS + 1)).ravel()
    # In padded arrays the corner of the window is at the robot's (x, y).
    corner = (world * height + position[:, 1]) * width + position[:, 0]
    index = corner[:, None] + window
    count = len(position)
    tensor = np.zeros((count, 3, SIZE, SIZE), dtype=np.uint8)
    view = (count, 2 * RADIUS + 1, 2 * RADIUS + 1)
    tensor[:, OBSTACLES, 1:-1, 1:-1] = obstacles.reshape(-1)[index].reshape(view)
    tensor[:, ROBOTS, 1:-1, 1:-1] = robots.reshape(-1)[index].reshape(view)
    mark = _goal_mark(goal - position)
    tensor[np.arange(count), GOAL, CENTRE + mark[:, 1], CENTRE + mark[:, 0]] = 1
    return tensor


def _goal_mark(offset: IntArray) -> IntArray:
    """``[R, 2]`` offsets of the marks for goals at ``offset``: a goal in view, or its projection on the ring."""
    distance = np.abs(offset).max(axis=1, keepdims=True)
    far = distance > RADIUS
    # Rounded half away from zero, in integers, so that rotating or mirroring the world rotates or mirrors the mark.
    scaled = (2 * CENTRE * np.abs(offset) + distance) // np.maximum(2 * distance, 1)
    return np.where(far, np.sign(offset) * scaled, offset)
