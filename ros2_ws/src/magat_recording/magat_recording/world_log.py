"""The World messages of one episode as arrays. Free of ROS."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from magat_sim.grid import BoolArray, IntArray
from magat_sim.measures import EpisodeMeasures, Flowtime, walk_measures
from magat_sim.shield import blocked


@dataclass
class WorldLog:
    """The World messages of an episode, live or read from a bag, as arrays. N robots, T steps."""

    episode: int = 0
    #: World messages by tick, 0 to T; see `complete`.
    worlds: dict[int, Any] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether no tick up to the last one is missing."""
        return self.worlds.keys() == set(range(len(self.worlds)))

    @property
    def _ordered(self) -> list[Any]:
        return [self.worlds[tick] for tick in sorted(self.worlds)]

    @property
    def robots(self) -> list[str]:
        """``[N]`` names."""
        return list(self._ordered[0].robots)

    @property
    def obstacles(self) -> BoolArray:
        """``[H, W]`` bool."""
        first = self._ordered[0]
        return np.frombuffer(first.obstacles, dtype=np.uint8).astype(bool).reshape(first.height, first.width)

    @property
    def goals(self) -> IntArray:
        """``[N, 2]`` int64 cells ``(x, y)``."""
        first = self._ordered[0]
        return np.stack([first.goal_x, first.goal_y], axis=1).astype(np.int64)

    @property
    def positions(self) -> IntArray:
        """``[T + 1, N, 2]`` int64 cells ``(x, y)``."""
        return np.stack([np.stack([w.x, w.y], axis=1) for w in self._ordered]).astype(np.int64)

    @property
    def action(self) -> IntArray:
        """``[T, N]`` int64 primitives that the robots wanted; IDLE if silent."""
        return self._steps([np.frombuffer(w.action, dtype=np.uint8) for w in self._ordered[1:]]).astype(np.int64)

    @property
    def moved(self) -> IntArray:
        """``[T, N]`` int64 primitives that the shield made of them."""
        return self._steps([np.frombuffer(w.moved, dtype=np.uint8) for w in self._ordered[1:]]).astype(np.int64)

    @property
    def silent(self) -> BoolArray:
        """``[T, N]`` bool, robots that did not answer in time."""
        return self._steps([w.silent for w in self._ordered[1:]]).astype(bool)

    @property
    def visited(self) -> BoolArray:
        """``[T, N]`` bool, robots that have visited their goals, after each step."""
        return self._steps([w.visited for w in self._ordered[1:]]).astype(bool)

    @property
    def blocked(self) -> BoolArray:
        """``[T, N]`` bool, moves that the shield blocked."""
        return blocked(self.action, self.moved)

    def _steps(self, rows: list[Any]) -> Any:
        return np.array(rows).reshape(-1, len(self.goals))

    @property
    def measures(self) -> EpisodeMeasures:
        """The measures of the episode."""
        last = self._ordered[-1]
        # -1: the expert found no solution.
        best = Flowtime(last.expert_flowtime, last.expert_flowtime_strict) if last.expert_flowtime >= 0 else None
        on_goal = (self.positions == self.goals).all(axis=2)
        return walk_measures(on_goal, last.t_max, int(self.blocked.sum()), best)
