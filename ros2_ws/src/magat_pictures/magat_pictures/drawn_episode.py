# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""An episode as arrays, ready to be drawn."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from magat_sim.grid import BoolArray, IntArray, inside
from magat_sim.radio import COMMUNICATION_RADIUS, neighbours

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class DrawnEpisode:
    """An episode of N robots and T steps, T possibly 0.

    Raises:
        ValueError: shapes do not match, or a cell is outside the map.
    """

    #: ``[H, W]`` bool, indexed ``[y, x]``; True is an obstacle.
    obstacles: BoolArray
    #: ``[N, 2]`` int64 cells ``(x, y)``.
    goals: IntArray
    #: ``[T + 1, N, 2]`` int64 cells ``(x, y)``, at the start and after each step.
    positions: IntArray
    #: ``[T, N]`` bool, moves that the shield blocked.
    blocked: BoolArray
    #: Printed over the drawing.
    title: str

    def __post_init__(self) -> None:
        """Check the shapes and the cells."""
        grid, goals, positions, blocked = (a.shape for a in (self.obstacles, self.goals, self.positions, self.blocked))
        if len(grid) != 2 or 0 in grid:
            raise ValueError(f"obstacles have shape {grid}: give a non-empty [height, width] array")
        if len(goals) != 2 or goals[1] != 2 or goals[0] == 0:
            raise ValueError(f"goals have shape {goals}: give [N, 2] cells (x, y), N at least 1")
        if len(positions) != 3 or positions[0] == 0 or positions[1:] != goals:
            raise ValueError(f"positions have shape {positions}: give [T + 1, N, 2], with N = {goals[0]} as in goals")
        if blocked != (positions[0] - 1, positions[1]):
            raise ValueError(f"blocked has shape {blocked}: give [T, N], one instant less than positions {positions}")
        for what, cells in (("goals", self.goals), ("positions", self.positions)):
            if not inside(grid, cells).all():
                raise ValueError(f"{what} are outside the map, which is {grid[1]} wide and {grid[0]} high")

    @property
    def robots(self) -> int:
        """Number of robots, N."""
        return len(self.goals)

    @property
    def steps(self) -> int:
        """Number of steps, T."""
        return len(self.positions) - 1

    @cached_property
    def on_goal(self) -> BoolArray:
        """``[T + 1, N]`` bool, robots on their goals at each instant."""
        return (self.positions == self.goals).all(axis=2)

    @cached_property
    def links(self) -> list[IntArray]:
        """``[T + 1]`` arrays ``[L, 2]``: the pairs of robots in range of each other, the lower number first."""
        together = np.zeros(self.robots, dtype=np.int64)
        found = []
        for position in self.positions:
            heard = neighbours(together, position, COMMUNICATION_RADIUS)
            robot, column = np.nonzero(heard > np.arange(self.robots)[:, None])
            found.append(np.stack([robot, heard[robot, column]], axis=1))
        return found

    @property
    def outcome(self) -> str:
        """One line on how the episode ended."""
        arrived = f"{self.on_goal[-1].sum()} of {self.robots} robots at goal"
        return f"{arrived} after {self.steps} steps, {self.blocked.sum()} moves blocked"
