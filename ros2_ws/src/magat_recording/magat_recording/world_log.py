# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The World messages of one episode as arrays. Free of ROS."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from magat_node.errors import UnusableMessageError
from magat_recording.world_check import fault
from magat_sim.grid import BoolArray, IntArray
from magat_sim.measures import EpisodeMeasures, Flowtime, walk_measures
from magat_sim.shield import blocked

#: What is the same in all World messages of an episode.
_SAME = ("robots", "width", "height", "goal_x", "goal_y", "t_max")
#: Episodes that are kept at most. A team runs one at a time; others are those of strangers.
_MOST_EPISODES = 64


@dataclass
class WorldLog:
    """The World messages of an episode, live or read from a bag, as arrays. N robots, T steps."""

    episode: int = 0
    #: World messages by tick, 0 to T; see `complete`.
    worlds: dict[int, Any] = field(default_factory=dict)

    def add(self, world: Any) -> None:
        """Take a World message of the episode; of two of one tick the first one counts.

        Raises:
            UnusableMessageError: it cannot be used, or is of other robots, goals or another map than those before.
        """
        wrong = fault(world)
        if wrong is None and self.worlds:
            first = next(iter(self.worlds.values()))
            if any(getattr(world, name) != getattr(first, name) for name in _SAME) or world.tick > first.t_max:
                wrong = f"robots, goals or map are not those of its episode (tick {world.tick})"
        if wrong is not None:
            raise UnusableMessageError(f"a world in which {wrong}")
        self.worlds.setdefault(world.tick, world)

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


class WorldLogs:
    """World messages by episode, for a client that learns the id of its episode only at the end."""

    def __init__(self) -> None:
        """Start empty."""
        self._logs: dict[int, WorldLog] = {}

    def add(self, world: Any) -> None:
        """Take a World message. Only an episode whose tick 0 was seen is kept.

        Raises:
            UnusableMessageError: see `WorldLog.add`.
        """
        log = self._logs.get(world.episode)
        if log is None:
            if world.tick > 0:
                return
            log = WorldLog(world.episode)
        log.add(world)
        self._logs.pop(world.episode, None)
        self._logs[world.episode] = log  # the last one to be forgotten
        if len(self._logs) > _MOST_EPISODES:
            del self._logs[next(iter(self._logs))]

    def of(self, episode: int) -> WorldLog:
        """The messages of ``episode`` so far."""
        return self._logs.get(episode, WorldLog(episode))

    def clear(self) -> None:
        """Forget all."""
        self._logs.clear()
