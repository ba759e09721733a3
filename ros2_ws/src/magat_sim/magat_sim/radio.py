"""Who hears whom: the communication graph of one instant (MAGAT paper, Sec. III)."""

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from magat_robot.policy.sampling import uniform
from magat_sim.grid import IntArray

#: Communication radius r_comm in cells: Euclidean, inclusive, not blocked by obstacles.
COMMUNICATION_RADIUS = 7.0
#: Makes one seed of a link's two ends; odd, so that none is lost, and not 1, so that either direction has its own.
_RECEIVER = np.uint64(0xD1342543DE82EF95)


def neighbours(world: IntArray, position: IntArray, radius: float = COMMUNICATION_RADIUS) -> IntArray:
    """The neighbourhoods N_i of R robots.

    Args:
        world: ``[R]`` which world each robot is in; robots of different worlds never hear each other.
        position: ``[R, 2]`` cells ``(x, y)``.
        radius: cells, inclusive.

    Returns:
        ``[R, M]`` int64, row i the indices of the robots that i hears, ascending, filled up with -1 to the largest
        neighbourhood M (possibly 0). No robot hears itself.
    """
    count = len(position)
    span = float(np.abs(position).max(initial=0)) + radius + 1
    apart = position.astype(np.float64)
    apart[:, 0] += world * 2 * span  # worlds side by side, out of each other's reach
    pairs = cKDTree(apart).query_pairs(radius, output_type="ndarray").astype(np.int64)
    receiver = np.concatenate([pairs[:, 0], pairs[:, 1]])
    sender = np.concatenate([pairs[:, 1], pairs[:, 0]])
    order = np.lexsort((sender, receiver))
    return _rows(receiver[order], sender[order], count)


def without_lost(heard: IntArray, streams: npt.NDArray[np.uint64], tick: int, loss: float) -> IntArray:
    """Neighbourhoods less the links that are lost in one tick, each direction of a link by itself.

    Whether a link is lost follows from the seeds of its two ends and the tick alone (see `sampling.uniform`), whoever
    else is there.

    Args:
        heard: ``[R, M]`` as of `neighbours`.
        streams: ``[R]`` uint64 seeds of the robots' own streams.
        tick: from 0.
        loss: share of the links that are lost, from 0 (none) to 1 (all).

    Returns:
        ``[R, M']``, in the form of ``heard``.
    """
    receiver, place = np.nonzero(heard >= 0)
    sender = heard[receiver, place]
    kept = uniform(streams[receiver] * _RECEIVER + streams[sender], tick) >= loss
    return _rows(receiver[kept], sender[kept], len(heard))


def _rows(receiver: IntArray, sender: IntArray, count: int) -> IntArray:
    """Links (``[E]`` each, by receiver, then by sender) as neighbourhoods of ``count`` robots, see `neighbours`."""
    degree = np.bincount(receiver, minlength=count)
    rank = np.arange(len(receiver)) - np.repeat(np.cumsum(degree) - degree, degree)
    heard = np.full((count, int(degree.max(initial=0))), -1, dtype=np.int64)
    heard[receiver, rank] = sender
    return heard
