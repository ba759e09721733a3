# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Visit memory: a robot remembers the cells that it has entered, and prefers others. Free of torch.

A policy sees one instant only. A robot in a pocket of obstacles that is wider than its field of view may therefore go
to and fro until the episode ends. With the option `visit_memory` of its policy, a robot keeps a trail of its own visits
and lowers the log-probabilities of primitives that lead to cells where it was before (as in Korf's real-time search,
AIJ 1990). It needs no position: it adds up the moves that it really made, which its observations tell.
"""

import functools
import math

import numpy as np
import numpy.typing as npt

from magat_robot.policy.grids import EXP_TABLE_BITS, EXPONENT_BITS, exp_table

#: In place of a cell in a trail.
NO_CELL = np.iinfo(np.int32).min
#: Visits that a robot remembers.
LENGTH = 256
# A relative cell (x, y) is the number x + y * _ROW. Maps are far smaller, so no two cells share a number.
_ROW = 2**15
# What each primitive adds to that number: idle, up, down, left, right.
_STEPS = np.array([0, _ROW, -_ROW, -1, 1], dtype=np.int32)
# In a field of view: the robot's own cell in the channel of the goal; the cells up, down, left and right of it in the
# channel of obstacles.
_OWN_GOAL = (slice(None), 2, 5, 5)
_AROUND = (slice(None), 0, [6, 4, 5, 5], [5, 5, 4, 6])

_Rows = npt.NDArray[np.int64]
_Cells = npt.NDArray[np.int32]


class Trails:
    """The last visits of N robots. A visit begins when a robot enters a cell; waiting there adds nothing."""

    def __init__(self, robots: int, length: int = LENGTH) -> None:
        """Start with ``robots`` empty trails, each for the last ``length`` visits."""
        #: ``[N, length]`` int32, the cells in any order; `NO_CELL` in unused places.
        self.cells: _Cells = np.full((robots, length), NO_CELL, dtype=np.int32)
        self._next = np.zeros(robots, dtype=np.int64)

    def clear(self, robots: _Rows) -> None:
        """Forget all visits of ``robots`` (indices)."""
        self.cells[robots] = NO_CELL

    def enter(self, robots: _Rows, cells: npt.NDArray[np.integer]) -> None:
        """Note that ``robots`` (indices, each once) have entered ``cells``; the oldest visits are forgotten."""
        self.cells[robots, self._next[robots]] = cells
        self._next[robots] = (self._next[robots] + 1) % self.cells.shape[1]


def count_visits(trails: npt.NDArray[np.integer], cells: npt.NDArray[np.integer]) -> npt.NDArray[np.int64]:
    """How often each cell is in the trail of its row.

    Args:
        trails: ``[R, V]``, see `Trails`.
        cells: ``[R, A]``.

    Returns:
        ``[R, A]`` int64.
    """
    columns = cells.astype(trails.dtype, copy=False).T
    return np.stack([np.count_nonzero(trails == column[:, None], axis=1) for column in columns], axis=1)


class VisitMemory:
    """The trails of N robots in cells relative to where each began to count, from their observations alone.

    A trail is cleared while the robot stands on its goal, and begins anew with an episode. It also begins anew when the
    robot has missed an observation: it does not know then where it is relative to earlier cells.
    """

    def __init__(self, robots: int) -> None:
        """Remember nothing of ``robots`` robots."""
        self._trails = Trails(robots)
        self._place = np.zeros(robots, dtype=np.int32)
        self._episode = np.zeros(robots, dtype=np.uint64)
        self._tick = np.full(robots, -2)  # of the last observation; -2: there was none

    def observe(
        self,
        robots: _Rows,
        episode: int,
        tick: int,
        moved: npt.NDArray[np.integer],
        field_of_view: npt.NDArray[np.uint8],
    ) -> npt.NDArray[np.int64]:
        """Take in the observations of some robots.

        Args:
            robots: ``[R]`` their indices, each once.
            episode: number of the episode.
            tick: of the observations, from 0.
            moved: ``[R]`` the primitives that they made in the step before.
            field_of_view: ``[R, 3, 11, 11]``.

        Returns:
            ``[R, 4]`` int64, how often each robot has entered the cells up, down, left and right of it. Those with an
            obstacle count as often as the others at most, so that no robot is driven against a wall.
        """
        unknown = (self._episode[robots] != episode) | (self._tick[robots] + 1 != tick) | (tick == 0)
        self._episode[robots], self._tick[robots] = episode, tick
        self._place[robots] = np.where(unknown, 0, self._place[robots] + _STEPS[moved])
        on_goal = field_of_view[_OWN_GOAL] == 1
        self._trails.clear(robots[unknown | on_goal])
        enters = robots[~on_goal & (unknown | (moved != 0))]
        self._trails.enter(enters, self._place[enters])
        visits = count_visits(self._trails.cells[robots], self._place[robots, None] + _STEPS[1:])
        return np.where(field_of_view[_AROUND] == 1, visits.max(axis=1, keepdims=True), visits)


def lowered(
    weights: npt.NDArray[np.float64], visits: npt.NDArray[np.int64] | None, penalty: float
) -> npt.NDArray[np.float64]:
    """The weights of primitives after ``penalty`` is subtracted from the log-probability of a move for each visit.

    The probability of waiting stays as it is: waiting is no visit. The moves share the rest anew. Logarithms are whole
    numbers of steps of ``2**-EXPONENT_BITS`` and come from tables, and all other operations round a single number once.
    So the result is the same to the last bit whatever the batch and the backend.

    Args:
        weights: ``[R, 5]`` whole numbers up to ``2**EXP_TABLE_BITS``, see `Decision`; a weight of 0 counts as 0.5.
        visits: ``[R, 4]`` as `VisitMemory.observe` returns them; None: none.
        penalty: for each visit, nats; rounded to a whole number of steps.

    Returns:
        ``[R, 5]`` float64 whole numbers; rows without visits are unchanged.
    """
    if visits is None or penalty == 0 or not visits.any():
        return weights
    table, bounds = _tables()
    moves = weights[:, 1:]
    below = len(bounds) - np.searchsorted(bounds, np.maximum(moves, 0.5))
    below += visits * round(penalty * 2**EXPONENT_BITS)
    below -= below.min(axis=1, keepdims=True)
    shares = table[np.minimum(below, len(table) - 1)]
    # Products are below 2**53, so only the quotient is rounded.
    again = np.rint(shares * moves.sum(axis=1, keepdims=True) / shares.sum(axis=1, keepdims=True))
    changed = np.concatenate([weights[:, :1], again], axis=1)
    return np.where(visits.any(axis=1, keepdims=True), changed, weights)


@functools.cache
def _tables() -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """The table of exp(), and the bounds between the weights that are nearest to two of its entries, ascending."""
    table = exp_table()
    bounds = [2**EXP_TABLE_BITS * math.exp(-(k + 0.5) / 2**EXPONENT_BITS) for k in reversed(range(len(table) - 1))]
    return np.array(table, dtype=np.float64), np.array(bounds)
