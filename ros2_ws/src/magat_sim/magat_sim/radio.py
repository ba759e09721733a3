"""Who hears whom: the communication graph of one instant (MAGAT paper, Sec. III)."""

import numpy as np
from scipy.spatial import cKDTree

from magat_sim.grid import IntArray

#: Communication radius r_comm in cells: Euclidean, inclusive, not blocked by obstacles.
COMMUNICATION_RADIUS = 7.0


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
    receiver, sender = receiver[order], sender[order]
    degree = np.bincount(receiver, minlength=count)
    rank = np.arange(len(receiver)) - np.repeat(np.cumsum(degree) - degree, degree)
    heard = np.full((count, int(degree.max(initial=0))), -1, dtype=np.int64)
    heard[receiver, rank] = sender
    return heard
