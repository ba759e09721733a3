# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulator: one world, or many in lockstep. The simulator node, training and evaluation all step this class."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from magat_robot.policy.visit_memory import Trails
from magat_sim.case import Case
from magat_sim.field_of_view import RADIUS, Uint8Array, field_of_view, pad
from magat_sim.grid import DELTAS, BoolArray, IntArray, Primitive
from magat_sim.measures import EpisodeMeasures, Flowtime, episode_measures
from magat_sim.radio import neighbours, without_lost
from magat_sim.shield import MEMORY, NO_ROBOT, SHIELDS, Scene, blocked
from magat_sim.streams import EpisodeStreams


@dataclass(frozen=True)
class Rules:
    """How a world treats the actions and messages of its robots.

    Raises:
        ValueError: a value is out of range.
    """

    #: Share of the directed radio links that are lost, drawn anew in each tick; 0 to 1.
    link_loss: float = 0.0
    #: What keeps robots from colliding, one of `SHIELDS`.
    shield: str = "idle"

    def __post_init__(self) -> None:
        """Check the values."""
        if not 0.0 <= self.link_loss <= 1.0:  # written so that NaN fails, too
            raise ValueError(f"the link loss {self.link_loss} is no share: give a number from 0 to 1")
        if self.shield not in SHIELDS:
            raise ValueError(f"there is no shield {self.shield!r}: it is one of {', '.join(SHIELDS)}")


DEFAULT_RULES = Rules()


@dataclass(frozen=True)
class Observation:
    """What the R active robots know at one instant: those of all worlds that still run, world by world."""

    #: ``[R, 3, 11, 11]`` uint8, see `field_of_view`.
    field_of_view: Uint8Array
    #: ``[R, M]`` int64, rows of this observation that each robot hears, without lost links; -1 is padding, see `radio`.
    heard: IntArray
    #: ``[R]`` uint64 seeds of the robots' own streams.
    streams: npt.NDArray[np.uint64]
    #: Steps made so far.
    tick: int
    #: ``[R]`` int64, the primitive that each robot made in the step before; IDLE at tick 0.
    moved: IntArray


@dataclass(frozen=True)
class Actions:
    """The actions of R robots."""

    #: ``[R]`` the primitive that each robot sampled, 0 to 4.
    primitives: npt.ArrayLike
    #: ``[R, 5]`` log-probabilities of the primitives, for the shields ``pibt`` and ``pibt-memory``; all equal if None.
    log_probabilities: npt.ArrayLike | None = None
    #: ``[R]`` bool, robots that sent no preference, and stay where they are; none if None.
    silent: npt.ArrayLike | None = None


@dataclass(frozen=True)
class Step:
    """The moves of R robots after the shield."""

    #: ``[R]`` the primitive each robot made.
    moved: IntArray
    #: ``[R]`` bool, robots that sampled a move and did not make it.
    blocked: BoolArray


class Simulator:
    """B worlds of any sizes and teams, stepped together until each is done.

    A world is done when all its robots stand on their goals at one instant, or after its T_max steps. The shield keeps
    robots from colliding, whatever their actions are. Robots are numbered across all worlds, world by world.
    """

    def __init__(
        self,
        cases: Sequence[Case],
        t_max: Sequence[int],
        streams: Sequence[EpisodeStreams],
        rules: Rules = DEFAULT_RULES,
    ) -> None:
        """Put the robots on their starts.

        Args:
            cases: ``[B]``.
            t_max: ``[B]`` T_max of each world, steps, at least 0.
            streams: ``[B]`` randomness, see `episode_streams`; its generators are advanced.
            rules: of all worlds.

        Raises:
            ValueError: lengths differ, or streams are for another number of robots.
        """
        if not len(cases) == len(t_max) == len(streams) or not cases:
            raise ValueError(
                f"{len(cases)} cases, {len(t_max)} t_max, {len(streams)} streams: give one of each per world"
            )
        for case, stream in zip(cases, streams, strict=True):
            if case.robots != len(stream.robots):
                raise ValueError(f"streams for {len(stream.robots)} robots, but the case has {case.robots}")
        self.rules = rules
        self.tick = 0
        self.t_max = np.asarray(t_max, dtype=np.int64)
        robots = [case.robots for case in cases]
        self.world = np.repeat(np.arange(len(cases)), robots)
        self._end = np.cumsum(robots)
        self.position = np.concatenate([case.starts for case in cases]).copy()
        self.goal = np.concatenate([case.goals for case in cases])
        self._streams = streams
        self._robot_streams = np.concatenate([stream.robots for stream in streams])

        height = max(case.obstacles.shape[0] for case in cases)
        width = max(case.obstacles.shape[1] for case in cases)
        grids = np.ones((len(cases), height, width), dtype=np.uint8)
        for grid, case in zip(grids, cases, strict=True):
            grid[: case.obstacles.shape[0], : case.obstacles.shape[1]] = case.obstacles
        self._obstacles = pad(grids, 1)
        self._occupant = np.full(self._obstacles.size, NO_ROBOT, dtype=np.int32)
        self._occupant[self._cell(self.position)] = np.arange(len(self.world))

        on_goal = self.on_goal
        self._first_visit = np.where(on_goal, 0, -1)
        self._arrival = np.where(on_goal, 0, -1)  # step since which it is on its goal; -1 while away
        self._last_visit = np.zeros(len(on_goal), dtype=np.int64)  # 0, the start, before the first visit
        self._moved = np.full(len(on_goal), Primitive.IDLE, dtype=np.int64)
        self._trails = Trails(len(on_goal), MEMORY)
        away = np.flatnonzero(~on_goal)
        self._trails.enter(away, self._cell(self.position[away], self.world[away]))
        self._blocked = np.zeros(len(cases), dtype=np.int64)
        self._ticks = np.zeros(len(cases), dtype=np.int64)
        self._strict = self._all_in_world(on_goal)
        self._update_active()

    @property
    def on_goal(self) -> BoolArray:
        """``[all robots]`` bool, which robots stand on their goals now."""
        return (self.position == self.goal).all(axis=1)

    @property
    def visited(self) -> BoolArray:
        """``[all robots]`` bool, which robots have stood on their goals."""
        return self._first_visit >= 0

    @property
    def active(self) -> IntArray:
        """``[R]`` int64, the robots of the worlds that still run; observations and actions have this order."""
        return self._active

    @property
    def done(self) -> bool:
        """Whether every world is done."""
        return len(self._active) == 0

    def observe(self) -> Observation:
        """What the active robots know now."""
        robots = self._active
        occupied = (self._occupant != NO_ROBOT).astype(np.uint8).reshape(self._obstacles.shape)
        world, position = self.world[robots], self.position[robots]
        view = field_of_view(self._obstacles, occupied, world, position, self.goal[robots])
        heard, streams = neighbours(world, position), self._robot_streams[robots]
        if self.rules.link_loss > 0.0:
            heard = without_lost(heard, streams, self.tick, self.rules.link_loss)
        return Observation(view, heard, streams, self.tick, self._moved[robots])

    def step(self, actions: npt.ArrayLike | Actions) -> Step:
        """Make one step.

        Args:
            actions: of the ``[R]`` active robots, or only their primitives (``[R]`` int).

        Raises:
            ValueError: a wrong shape, or a value that is not a primitive.
        """
        robots = self._active
        scene = self._scene(actions if isinstance(actions, Actions) else Actions(actions))
        moved = SHIELDS[self.rules.shield](scene)
        moves = moved != Primitive.IDLE
        self._occupant[scene.place[moves]] = NO_ROBOT
        self._occupant[scene.leads[moves, moved[moves]]] = robots[moves]
        self.position[robots] += DELTAS[moved]
        self._moved[robots] = moved

        stopped = blocked(scene.actions, moved)
        np.add.at(self._blocked, self.world[robots[stopped]], 1)
        self._account(robots)
        return Step(moved, stopped)

    def _scene(self, given: Actions) -> Scene:
        robots, count = self._active, len(DELTAS)
        actions = np.asarray(given.primitives, dtype=np.int64)
        if actions.shape != robots.shape or (actions < 0).any() or (actions >= count).any():
            raise ValueError(f"actions have shape {actions.shape}, values {set(actions.ravel().tolist())}: "
                             f"give {robots.shape} primitives from 0 to {count - 1}")  # fmt: skip
        log_probabilities = np.zeros((len(robots), count), np.float32)
        if given.log_probabilities is not None:
            log_probabilities = np.asarray(given.log_probabilities, dtype=np.float32)
        silent = np.zeros(len(robots), bool) if given.silent is None else np.asarray(given.silent, dtype=bool)
        if log_probabilities.shape != (len(robots), count) or silent.shape != robots.shape:
            raise ValueError(
                f"log-probabilities of shape {log_probabilities.shape}, silent of shape {silent.shape}: give {count} "
                f"numbers and one flag for each of {len(robots)} robots"
            )
        draw = np.empty(len(self.world))
        for world in np.unique(self.world[robots]):
            stream = self._streams[world]
            draw[self._end[world] - len(stream.robots) : self._end[world]] = stream.shield.random(len(stream.robots))
        width = self._obstacles.shape[2]
        place = self._cell(self.position[robots], self.world[robots])
        leads = place[:, None] + DELTAS[:, 0] + width * DELTAS[:, 1]
        # Each robot's row among the active ones; the last entry is that of NO_ROBOT.
        row = np.full(len(self.world) + 1, NO_ROBOT)
        row[robots] = np.arange(len(robots))
        return Scene(
            place=place,
            leads=leads,
            free=self._obstacles.reshape(-1)[leads] == 0,
            ahead=row[self._occupant[leads]],
            actions=np.where(silent, Primitive.IDLE, actions),
            log_probabilities=log_probabilities,
            silent=silent,
            waited=self.tick - self._last_visit[robots],
            trail=self._trails.cells[robots],
            draw=draw[robots],
        )

    def measures(self, expert: Sequence[Flowtime | None]) -> list[EpisodeMeasures]:
        """The measures of each world (``[B]``), against the expert's flowtimes (``[B]``)."""
        return [self._measures_of(world, best) for world, best in enumerate(expert)]

    def _measures_of(self, world: int, best: Flowtime | None) -> EpisodeMeasures:
        here = self.world == world
        return episode_measures(
            self._first_visit[here],
            self._arrival[here],
            bool(self._strict[world]),
            int(self.t_max[world]),
            int(self._ticks[world]),
            int(self._blocked[world]),
            best,
        )

    def _account(self, robots: IntArray) -> None:
        self.tick += 1
        on_goal = self.on_goal
        now = np.zeros(len(on_goal), dtype=bool)
        now[robots] = on_goal[robots]
        self._last_visit[now] = self.tick
        self._first_visit[now & (self._first_visit < 0)] = self.tick
        self._arrival[now & (self._arrival < 0)] = self.tick
        self._arrival[robots[~on_goal[robots]]] = -1
        self._trails.clear(robots[on_goal[robots]])
        entered = robots[(self._moved[robots] != Primitive.IDLE) & ~on_goal[robots]]
        self._trails.enter(entered, self._cell(self.position[entered], self.world[entered]))
        self._ticks[np.unique(self.world[robots])] = self.tick
        self._strict |= self._all_in_world(on_goal)
        self._update_active()

    def _update_active(self) -> None:
        running = ~self._strict & (self.tick < self.t_max)
        self._active = np.flatnonzero(running[self.world])

    def _all_in_world(self, flag: BoolArray) -> BoolArray:
        result = np.ones(len(self.t_max), dtype=bool)
        np.logical_and.at(result, self.world, flag)
        return result

    def _cell(self, position: IntArray, world: IntArray | None = None) -> IntArray:
        _, height, width = self._obstacles.shape
        world = self.world if world is None else world
        return (world * height + position[:, 1] + RADIUS) * width + position[:, 0] + RADIUS
