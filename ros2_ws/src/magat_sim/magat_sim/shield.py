"""Collision shielding: turns what robots want into moves that never collide."""

import numpy as np
import numpy.typing as npt

from magat_sim.grid import BoolArray, IntArray

NOBODY = -1


def idle_shield(
    occupant: npt.NDArray[np.int32],
    obstacles: npt.NDArray[np.uint8],
    cell: IntArray,
    target: IntArray,
    draw: npt.NDArray[np.float64],
) -> BoolArray:
    """The paper's shield: an illegal move becomes IDLE, and what that makes illegal in turn becomes IDLE too.

    Two robots that would swap cells both idle. Of several that want one cell that is or becomes free, the one with the
    lowest draw moves. Following a robot into the cell that it leaves is allowed, and so are rotations of three or more.

    Args:
        occupant: ``[C]`` index of the robot in each cell, or `NOBODY`. Cells of separate worlds are separate cells.
        obstacles: ``[C]`` 1 where no robot may be; includes a rim around each map, so that every target is a cell.
        cell: ``[R]`` index of the cell each robot is in.
        target: ``[R]`` index of the cell each robot wants to be in next; its own to idle.
        draw: ``[R]`` random numbers of the episode, all different within a world.

    Returns:
        ``[R]`` bool, the robots that move to their targets; all others stay.
    """
    moves = (target != cell) & (obstacles[target] == 0)
    ahead = occupant[target]
    other = np.maximum(ahead, 0)
    swaps = moves & (ahead != NOBODY) & moves[other] & (target[other] == cell)
    moves &= ~swaps
    best = np.full(len(occupant), np.inf)
    np.minimum.at(best, target[moves], draw[moves])
    moves &= draw == best[target]
    while True:
        blocked = moves & (ahead != NOBODY) & ~moves[other]
        if not blocked.any():
            return moves
        moves &= ~blocked
