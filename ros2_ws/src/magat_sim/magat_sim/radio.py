# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The communication graph at one instant (MAGAT paper, Sec. III)."""

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from magat_robot.policy.sampling import uniform
from magat_sim.grid import IntArray

#: Communication radius r_comm in cells: Euclidean, inclusive, not blocked by obstacles.
COMMUNICATION_RADIUS = 7.0
#: Combines the seeds of a link's two ends into one. It is odd, so that no bits are lost, and not 1, so that the two
#: directions of a link differ.
_RECEIVER = np.uint64(0xD1342543DE82EF95)


def neighbours(world: IntArray, position: IntArray, radius: float = COMMUNICATION_RADIUS) -> IntArray:
    """The neighbourhoods N_i of R robots.

    Args:
        world: ``[R]`` which world each robot is in; robots of different worlds never hear each other.
        position: ``[R, 2]`` cells ``(x, y)``.
        radius: cells, inclusive.

    Returns:
        ``[R, M]`` int64. Row i holds the indices of the robots that i hears, ascending, padded with -1 to the largest
        neighbourhood M (possibly 0). No robot hears itself.
    """
    count = len(position)
    span = float(np.abs(position).max(initial=0)) + radius + 1
    apart = position.astype(np.float64)
    apart[:, 0] += world * 2 * span  # the worlds side by side, out of each other's range
    pairs = cKDTree(apart).query_pairs(radius, output_type="ndarray").astype(np.int64)
    receiver = np.concatenate([pairs[:, 0], pairs[:, 1]])
    sender = np.concatenate([pairs[:, 1], pairs[:, 0]])
    order = np.lexsort((sender, receiver))
    return _rows(receiver[order], sender[order], count)


def without_lost(heard: IntArray, streams: npt.NDArray[np.uint64], tick: int, loss: float) -> IntArray:
    """Neighbourhoods without the links that are lost in one tick; the directions of a link are drawn separately.

    Whether a link is lost depends only on the seeds of its two ends and on the tick (see `sampling.uniform`).

    Args:
        heard: ``[R, M]`` int64 as returned by `neighbours`.
        streams: ``[R]`` uint64 seeds of the robots' random streams.
        tick: from 0.
        loss: share of the links that are lost, from 0 (none) to 1 (all).

    Returns:
        ``[R, M']`` int64, in the form of ``heard``.
    """
    receiver, place = np.nonzero(heard >= 0)
    sender = heard[receiver, place]
    kept = uniform(streams[receiver] * _RECEIVER + streams[sender], tick) >= loss
    return _rows(receiver[kept], sender[kept], len(heard))


def _rows(receiver: IntArray, sender: IntArray, count: int) -> IntArray:
    """Neighbourhoods of ``count`` robots, see `neighbours`, from links (``[E]``, sorted by receiver, then sender)."""
    degree = np.bincount(receiver, minlength=count)
    rank = np.arange(len(receiver)) - np.repeat(np.cumsum(degree) - degree, degree)
    heard = np.full((count, int(degree.max(initial=0))), -1, dtype=np.int64)
    heard[receiver, rank] = sender
    return heard
