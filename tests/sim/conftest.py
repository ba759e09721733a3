# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shared by the tests of the simulator: worlds set up by hand, and an independent check of steps."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from magat_sim.case import Case
from magat_sim.simulator import Simulator
from magat_sim.streams import episode_streams

MOVES = {0: (0, 0), 1: (0, 1), 2: (0, -1), 3: (-1, 0), 4: (1, 0)}
Cells = Sequence[tuple[int, int]]


def faults(obstacles: np.ndarray, before: np.ndarray, actions: Sequence[int], after: np.ndarray) -> list[str]:
    """The faults of a step of a team: collisions, jumps, moves that are no robot's action, needless waits."""
    height, width = obstacles.shape
    old, new = (list(map(tuple, np.asarray(cells).tolist())) for cells in (before, after))
    found = []
    for i, (here, there) in enumerate(zip(old, new, strict=True)):
        dx, dy = MOVES[int(actions[i])]
        target = (here[0] + dx, here[1] + dy)
        free = 0 <= target[0] < width and 0 <= target[1] < height and not obstacles[target[1], target[0]]
        if not (0 <= there[0] < width and 0 <= there[1] < height) or obstacles[there[1], there[0]]:
            found.append(f"robot {i} is on {there}, an obstacle or off the map")
        if there not in (here, target):
            found.append(f"robot {i} went from {here} to {there}, but its action leads to {target}")
        if there == here != target and free and target not in new:
            found.append(f"robot {i} was kept from {target}, which is empty")
        for j in range(i):
            if there == new[j]:
                found.append(f"robots {j} and {i} are both on {there}")
            if here != old[j] and (here, there) == (new[j], old[j]):
                found.append(f"robots {j} and {i} swapped {here} and {there}")
    return found


@pytest.fixture(scope="session")
def judge() -> Callable:
    """`faults`."""
    return faults


@pytest.fixture(scope="session")
def arena() -> Callable:
    """A simulator of one world whose goals are far off the map, so that it runs for all its steps."""

    def make(
        width: int, height: int, starts: Cells, obstacles: Cells = (), number: int = 0, t_max: int = 100
    ) -> Simulator:
        grid = np.zeros((height, width), dtype=bool)
        for x, y in obstacles:
            grid[y, x] = True
        cells = np.array(starts, dtype=np.int64)
        return Simulator([Case(grid, cells, cells + 1000)], [t_max], [episode_streams(1, number, len(cells))])

    return make
