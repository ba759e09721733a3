# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Deadlocks of a recorded team: robots that keep each other from their goals."""

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from magat_sim.grid import BoolArray, IntArray

#: A robot is stuck if it stays off its goal and on at most two cells for this many ticks.
PATIENCE = 8
#: Stuck robots are in the same deadlock if they are at most this far apart, cells (Chebyshev distance).
NEAR = 2


def deadlocks(robots: pd.DataFrame, patience: int = PATIENCE) -> pd.DataFrame:
    """Groups of robots that stand still or move to and fro, off their goals.

    Args:
        robots: `magat_recording.tables.TeamRecording.robots`.
        patience: a robot is stuck while it has been off its goal, on one or two cells, for at least this many ticks.

    Returns:
        One row for each deadlock, which is a connected group of stuck robots in space and time: ``episode``, ``begin``
        (tick), ``ticks`` (its length), ``robots`` (a tuple of numbers), ``silent`` (whether one of them was silent
        meanwhile).
    """
    found: list[tuple[int, int, int, tuple[int, ...], bool]] = []
    for number, table in robots.groupby("episode"):
        count = int(table.robot.max()) + 1
        x, y, goal_x, goal_y, silent = (
            table[name].to_numpy().reshape(-1, count) for name in ("x", "y", "goal_x", "goal_y", "silent")
        )
        stuck = _stuck(x, y, (x == goal_x) & (y == goal_y), patience)
        tick, robot = np.nonzero(stuck)
        groups, member = _groups(stuck, x, y)
        for group in range(groups):
            inside = member == group
            begin, end = tick[inside].min(), tick[inside].max() + 1
            members = tuple(np.unique(robot[inside]).tolist())
            any_silent = bool(silent[tick[inside], robot[inside]].any())
            found.append((int(number), int(begin), int(end - begin), members, any_silent))
    return pd.DataFrame(found, columns=["episode", "begin", "ticks", "robots", "silent"]).sort_values(
        ["episode", "begin"], ignore_index=True
    )


def _stuck(x: IntArray, y: IntArray, on_goal: BoolArray, patience: int) -> BoolArray:
    """``[T, N]`` bool: ticks within a window of ``patience`` in which a robot was off its goal and on two cells."""
    stuck = np.zeros(x.shape, dtype=bool)
    cell = x * 2**16 + y
    for begin in range(len(x) - patience + 1):
        window = slice(begin, begin + patience)
        cells = np.sort(cell[window], axis=0)
        few = (cells[1:] != cells[:-1]).sum(axis=0) < 2
        stuck[window] |= few & ~on_goal[window].any(axis=0)
    return stuck


def _groups(stuck: BoolArray, x: IntArray, y: IntArray) -> tuple[int, npt.NDArray[np.int32]]:
    """The number of connected groups of ``stuck`` (``[T, N]``), and the group of each of its S true entries, ``[S]``.

    An entry is connected with that of the same robot in the next tick, and with those near it in the same tick.
    """
    count = int(stuck.sum())
    node = np.full(stuck.shape, -1)
    node[stuck] = np.arange(count)
    follows = stuck[1:] & stuck[:-1]
    edges = [np.stack([node[:-1][follows], node[1:][follows]])]
    for now in range(len(stuck)):
        here = np.flatnonzero(stuck[now])
        apart = np.maximum(np.abs(x[now, here][:, None] - x[now, here]), np.abs(y[now, here][:, None] - y[now, here]))
        a, b = np.nonzero(np.triu(apart <= NEAR, 1))
        edges.append(np.stack([node[now, here[a]], node[now, here[b]]]))
    ends = np.concatenate(edges, axis=1)
    graph = coo_array((np.ones(ends.shape[1]), (ends[0], ends[1])), shape=(count, count))
    return connected_components(graph, directed=False)
