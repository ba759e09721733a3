"""One recorded episode to look at, and the inks that it is drawn with.

Every colour is a tint of one of a few inks on white paper; that is also how the animation can do with one palette.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt
from PIL import ImageColor

from magat_sim.grid import BoolArray, IntArray, inside
from magat_sim.radio import COMMUNICATION_RADIUS, neighbours

FloatArray = npt.NDArray[np.float64]

INK = "#2b3440"
ALARM = "#e03131"
ROBOT_INKS = (
    "#2f6fde", "#ee7b10", "#1f9d57", "#cf2f74", "#7d4fd8", "#0d98ae",
    "#96602f", "#818f0e", "#e265b4", "#22408c", "#12664a", "#b5452b",
)  # fmt: skip
#: Of attention.
LISTENING = ROBOT_INKS[0]


@lru_cache(4096)
def tint(ink: str, strength: float) -> str:
    """``ink`` thinned on white paper, from 0 (white) to 1 (the ink itself)."""
    red, green, blue = (round(255 + (value - 255) * strength) for value in ImageColor.getrgb(ink)[:3])
    return f"#{red:02x}{green:02x}{blue:02x}"


def glaze(ink: str, strength: float) -> str:
    """``ink`` that lets through what it is painted on, from 0 (nothing but that) to 1 (the ink itself)."""
    return f"{ink}{round(255 * strength):02x}"


def robot_colour(robot: int) -> str:
    """The ink of a robot, by its number from 0."""
    return ROBOT_INKS[robot % len(ROBOT_INKS)]


@dataclass(frozen=True)
class EpisodeRecord:
    """What happened in one episode of N robots and T steps, T possibly 0.

    Raises:
        ValueError: shapes that do not belong together, or a cell outside the map.
    """

    #: ``[H, W]`` bool, indexed ``[y, x]``; True is an obstacle.
    obstacles: BoolArray
    #: ``[N, 2]`` int64 cells ``(x, y)``.
    goals: IntArray
    #: ``[T + 1, N, 2]`` int64 cells ``(x, y)``, at the start and after each step.
    positions: IntArray
    #: ``[T, N]`` bool, moves that robots drew and the shield did not let them make.
    blocked: BoolArray
    #: A line over the drawing.
    title: str

    def __post_init__(self) -> None:
        """Check that the arrays are of one episode."""
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
                raise ValueError(f"{what} leave the map, which is {grid[1]} wide and {grid[0]} high")

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
        """``[T + 1, N]`` who is on its goal at each instant."""
        return (self.positions == self.goals).all(axis=2)

    @cached_property
    def links(self) -> list[IntArray]:
        """``[T + 1]`` arrays ``[L, 2]``: the pairs of robots that hear each other, the lower number first."""
        together = np.zeros(self.robots, dtype=np.int64)
        found = []
        for position in self.positions:
            heard = neighbours(together, position, COMMUNICATION_RADIUS)
            robot, column = np.nonzero(heard > np.arange(self.robots)[:, None])
            found.append(np.stack([robot, heard[robot, column]], axis=1))
        return found

    @property
    def outcome(self) -> str:
        """The episode in half a sentence."""
        arrived = f"{self.on_goal[-1].sum()} of {self.robots} robots at goal"
        return f"{arrived} after {self.steps} steps, {self.blocked.sum()} moves blocked"
