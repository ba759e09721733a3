# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Converts the World messages of an episode to what browsers draw. Free of ROS.

For each episode browsers get one *scene* (JSON: what does not change) and one *frame* for each tick (binary: what
changes). All frames of an episode have the same length, so that one message can hold several.
"""

import struct
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from magat_sim.field_of_view import RADIUS, Uint8Array
from magat_sim.grid import BoolArray, IntArray
from magat_sim.measures import EpisodeMeasures, Flowtime, episode_measures
from magat_sim.radio import COMMUNICATION_RADIUS
from magat_sim.shield import blocked

#: The head of a frame: number of the episode; tick; robots on their goals; robots that have visited their goals;
#: blocked moves so far; silent robots, summed over the ticks so far; directed radio links; mean seconds per tick. Then
#: follow x and y of all robots (int16 each), one byte for each robot: action (bits 0 to 2), moved (3 to 5), silent (6),
#: visited (7), and zeros up to a multiple of four bytes.
_HEAD = struct.Struct("<7If")
#: Weight of the newest tick in the exponential mean of the wall time per tick.
_NEWEST = 0.1


@dataclass(frozen=True)
class Scene:
    """What does not change during an episode. The browser gets it as JSON, with the same names."""

    episode: int
    #: Names.
    robots: list[str]
    width: int
    height: int
    #: H W digits 0 or 1, row by row from y = 0; None if they are not known.
    obstacles: str | None
    #: Cells ``(x, y)``.
    goals: list[list[int]]
    t_max: int
    #: Communication radius and radius of the field of view, cells.
    radio_range: float
    view_radius: int


@dataclass(frozen=True)
class ResultMeasures:
    """The measures of an episode that the page shows, see `magat_sim.measures.EpisodeMeasures`."""

    success: bool
    success_strict: bool
    p_rg: float
    makespan: int
    moves_blocked: int
    #: NaN without an expert's solution (null in JSON).
    delta_ft: float


@dataclass(frozen=True)
class EpisodeResult:
    """The result of an episode, so far."""

    episode: int
    ticks: int
    #: None while the episode runs, or if some of it was not seen.
    measures: ResultMeasures | None


class WatchedEpisode:
    """One episode, from the first World message that was seen. N robots."""

    def __init__(self, number: int, world: Any) -> None:
        """Start with the World message ``world``; ``number`` replaces its id, which is too large for JavaScript."""
        self.number = number
        self.id: int = world.episode
        self.robots = list(world.robots)
        self.width, self.height = world.width, world.height
        self.goals = _cells(world.goal_x, world.goal_y)
        #: ``[H, W]`` bool; None if the first World message was not seen, because only that one has the obstacles.
        self.obstacles: BoolArray | None = None
        if len(world.obstacles) > 0:
            self.obstacles = _bytes(world.obstacles).astype(bool).reshape(self.height, self.width)
        count = len(self.robots)
        #: ``[N]`` ticks in which each robot was silent.
        self.silences = np.zeros(count, dtype=np.int64)
        self.blocked = 0
        self._first, self._last = np.full(count, -1), np.full(count, -1)
        self._strict = False
        self._whole = world.tick == 0
        self._seconds = 0.0
        self._count(world)

    def holds(self, world: Any) -> bool:
        """Whether ``world`` belongs to this episode."""
        same = (world.episode, world.width, world.height) == (self.id, self.width, self.height)
        return same and list(world.robots) == self.robots

    def step(self, world: Any) -> None:
        """Take the next World message; one that is not newer than the last is ignored."""
        if world.tick <= self.tick:
            return
        self._whole &= world.tick == self.tick + 1
        self._count(world)

    def _count(self, world: Any) -> None:
        self.world, self.tick = world, int(world.tick)
        on_goal = (self.positions == self.goals).all(axis=1)
        self._first[on_goal & (self._first < 0)] = self.tick
        self._last = np.where(on_goal, np.where(self._last < 0, self.tick, self._last), -1)
        self._strict |= bool(on_goal.all())
        if self.tick > 0:
            self.silences += np.asarray(world.silent, dtype=bool)
            self.blocked += int(blocked(*(_bytes(part).astype(np.int64) for part in (world.action, world.moved))).sum())
            self._seconds += (world.seconds - self._seconds) * (_NEWEST if self._seconds else 1.0)

    @property
    def positions(self) -> IntArray:
        """``[N, 2]`` cells ``(x, y)`` after the last tick."""
        return _cells(self.world.x, self.world.y)

    @property
    def ended(self) -> bool:
        """Whether it is over: all robots are on their goals at the same time, or T_max is reached."""
        return self._strict or self.tick >= self.world.t_max

    @property
    def measures(self) -> EpisodeMeasures | None:
        """Its measures; None while it runs, or if some of it was not seen."""
        if not self._whole or not self.ended:
            return None
        world = self.world
        # -1: the expert found no solution.
        best = Flowtime(world.expert_flowtime, world.expert_flowtime_strict) if world.expert_flowtime >= 0 else None
        arguments = (self._first, self._last, self._strict, int(world.t_max), self.tick, self.blocked, best)
        return episode_measures(*arguments)

    def scene(self) -> Scene:
        """What does not change."""
        grid = self.obstacles
        return Scene(
            episode=self.number,
            robots=self.robots,
            width=self.width,
            height=self.height,
            obstacles=None if grid is None else "".join(map(str, grid.astype(int).ravel().tolist())),
            goals=self.goals.tolist(),
            t_max=int(self.world.t_max),
            radio_range=COMMUNICATION_RADIUS,
            view_radius=RADIUS,
        )

    def frame(self) -> bytes:
        """The last World message as a frame, see `_HEAD`."""
        world = self.world
        action, moved = _bytes(world.action), _bytes(world.moved)
        silent, visited = (np.asarray(part, dtype=np.uint8) for part in (world.silent, world.visited))
        on_goal = int((self.positions == self.goals).all(axis=1).sum())
        head = _HEAD.pack(
            self.number, self.tick, on_goal, int(visited.sum()), self.blocked, int(self.silences.sum()),
            world.links, self._seconds,
        )  # fmt: skip
        body = self.positions.T.astype("<i2").tobytes()
        body += ((action & 7) | (moved & 7) << 3 | silent << 6 | visited << 7).tobytes()
        return head + body + bytes(-len(body) % 4)

    def result(self) -> EpisodeResult:
        """The result so far."""
        measures, shown = self.measures, None
        if measures is not None:
            names = [field.name for field in fields(ResultMeasures)]
            shown = ResultMeasures(**{name: getattr(measures, name) for name in names})
        return EpisodeResult(self.number, self.tick, shown)


def _cells(x: Any, y: Any) -> IntArray:
    return np.stack([x, y], axis=1).astype(np.int64)


def _bytes(values: Any) -> Uint8Array:
    """A uint8[] of a message, which is an array in a live message and bytes in a recorded one."""
    return np.frombuffer(values, dtype=np.uint8)
