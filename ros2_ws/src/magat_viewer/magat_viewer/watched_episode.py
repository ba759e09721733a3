"""An episode as it is watched: worlds in, what browsers draw out. Free of ROS.

Browsers get a *scene* once an episode (JSON: what stays) and *frames* (binary: what changes from tick to tick), all of
which have the same length, so that several may follow each other in one message.
"""

import struct
from dataclasses import asdict
from typing import Any

import numpy as np

from magat_sim.field_of_view import RADIUS, Uint8Array
from magat_sim.grid import BoolArray, IntArray
from magat_sim.measures import EpisodeMeasures, Flowtime, episode_measures
from magat_sim.radio import COMMUNICATION_RADIUS
from magat_sim.shield import blocked

#: Number of the episode, tick; robots on their goals, and that have visited them; moves blocked, and times that a robot
#: was silent, so far; directed radio links; seconds a tick. After it come x and y (int16 each) and a byte a robot:
#: action (bits 0 to 2), moved (3 to 5), silent (6), visited (7); then zeros up to a multiple of four bytes.
_HEAD = struct.Struct("<7If")
#: By how much the latest tick counts in the mean wall time of a tick.
_NEWEST = 0.1


class WatchedEpisode:
    """One episode, as far as it was seen. N robots."""

    def __init__(self, number: int, world: Any) -> None:
        """Begin with its first world that was seen; ``number`` names it to browsers, whose numbers hold 53 bits."""
        self.number = number
        self.id: int = world.episode
        self.robots = list(world.robots)
        self.width, self.height = world.width, world.height
        self.goals = _cells(world.goal_x, world.goal_y)
        #: ``[H, W]`` bool; None of an episode that was joined after its begin, where nobody tells them again.
        self.obstacles: BoolArray | None = None
        if len(world.obstacles) > 0:
            self.obstacles = _bytes(world.obstacles).astype(bool).reshape(self.height, self.width)
        count = len(self.robots)
        #: ``[N]`` how often each was silent.
        self.silences = np.zeros(count, dtype=np.int64)
        self.blocked = 0
        self._first, self._last = np.full(count, -1), np.full(count, -1)
        self._strict = False
        self._whole = world.tick == 0
        self._seconds = 0.0
        self._count(world)

    def holds(self, world: Any) -> bool:
        """Whether a world is one of this episode."""
        same = (world.episode, world.width, world.height) == (self.id, self.width, self.height)
        return same and list(world.robots) == self.robots

    def step(self, world: Any) -> None:
        """Take the next world; one that was seen already, or comes late, changes nothing."""
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
        """``[N, 2]`` cells ``(x, y)``, now."""
        return _cells(self.world.x, self.world.y)

    @property
    def ended(self) -> bool:
        """Whether it is over: everybody is there, or the time is up."""
        return self._strict or self.tick >= self.world.t_max

    @property
    def measures(self) -> EpisodeMeasures | None:
        """What it came to; None while it runs, or if some of it was not seen."""
        if not self._whole or not self.ended:
            return None
        world = self.world
        # -1 says that the expert gave no solution.
        best = Flowtime(world.expert_flowtime, world.expert_flowtime_strict) if world.expert_flowtime >= 0 else None
        walk = (self._first, self._last, self._strict, int(world.t_max), self.tick, self.blocked, best)
        return episode_measures(*walk)

    def scene(self) -> dict[str, Any]:
        """What stays, as JSON values. Obstacles are a text of H W digits, row by row from y = 0; or None."""
        grid = self.obstacles
        return {
            "kind": "scene",
            "episode": self.number,
            "robots": self.robots,
            "width": self.width,
            "height": self.height,
            "obstacles": None if grid is None else "".join(map(str, grid.astype(int).ravel().tolist())),
            "goals": self.goals.tolist(),
            "t_max": int(self.world.t_max),
            "radio_range": COMMUNICATION_RADIUS,
            "sight": RADIUS,
        }

    def frame(self) -> bytes:
        """The world of this tick, see `_HEAD`."""
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

    def result(self) -> dict[str, Any]:
        """What is known of how it went, as JSON values: ``measures`` is None as `measures` is."""
        measures = self.measures
        found = None
        if measures is not None:
            names = ("success", "success_strict", "p_rg", "makespan", "moves_blocked")
            values = asdict(measures)
            found = {name: values[name] for name in names} | {"delta_ft": _number(measures.delta_ft)}
        return {"episode": self.number, "ticks": self.tick, "measures": found}


def _cells(x: Any, y: Any) -> IntArray:
    return np.stack([x, y], axis=1).astype(np.int64)


def _bytes(values: Any) -> Uint8Array:
    """uint8[] of a message: an array when it is live, bytes when it is read from a bag."""
    return np.frombuffer(values, dtype=np.uint8)


def _number(value: float) -> float | None:
    """JSON has no NaN."""
    return None if np.isnan(value) else value
