"""A recorded team as tidy tables: episodes, ticks, robots, messages, and what the recording lacks. Free of ROS.

In the tables episodes are numbered from 0 in the order in which they began, and robots in the simulator's order. Row
``tick`` is the step from instant ``tick`` to ``tick + 1``: what was seen and decided before it, and what came of it.
Features carry no sender. It is found by the tags of the recorded observations, each of which only one robot was sent.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from magat_recording.bag import BagError, BagMessage, read_bag
from magat_recording.world_log import WorldLog
from magat_sim.shield import blocked

#: A robot that has not left two cells for so many instants, its goal being elsewhere, is stuck.
PATIENCE = 8
#: Stuck robots so near to each other hold each other up, cells from side to side (with corners).
NEAR = 2


@dataclass
class RecordedTick:
    """What was said in one tick of an episode; of messages that came twice the first one."""

    #: By robot.
    observations: dict[int, BagMessage] = field(default_factory=dict)
    #: By tag and round.
    features: dict[tuple[int, int], BagMessage] = field(default_factory=dict)
    #: By tag.
    preferences: dict[int, BagMessage] = field(default_factory=dict)
    #: By robot and round.
    bundles: dict[tuple[int, int], BagMessage] = field(default_factory=dict)

    @cached_property
    def senders(self) -> dict[int, int]:
        """Robots by the tags under which they spoke."""
        return {observation.message.own_tag: robot for robot, observation in self.observations.items()}


@dataclass
class RecordedEpisode:
    """An episode of a recording, from its begin."""

    number: int
    recording: WorldLog
    ticks: dict[int, RecordedTick] = field(default_factory=lambda: defaultdict(RecordedTick))

    def steps(self) -> Iterator[tuple[int, RecordedTick]]:
        """The ticks of which both ends are known, in their order."""
        for tick in range(len(self.recording.worlds) - 1):
            yield tick, self.ticks[tick]


class TeamRecording:
    """The recording of a team. Tables are made when they are asked for, once."""

    def __init__(self, bag: Path) -> None:
        """Read ``bag``.

        Raises:
            BagError: it cannot be read, or no episode is in it from its begin.
        """
        self._messages = list(read_bag(bag))
        worlds = [message for message in self._messages if _kind(message) == "World"]
        recordings: dict[int, WorldLog] = {}
        for world in worlds:
            number = world.message.episode
            recordings.setdefault(number, WorldLog(number)).worlds[world.message.tick] = world.message
        whole = [recording for recording in recordings.values() if recording.complete]
        if not whole:
            raise BagError(
                f"{bag} has no episode from its begin ({len(worlds)} of its {len(self._messages)} messages are "
                "worlds): record before the episode begins"
            )
        #: How many episodes are left out, because a world of theirs is missing: most likely those before the recording.
        self.left_out = len(recordings) - len(whole)
        #: Names, in the simulator's order.
        self.names = whole[0].robots
        self._by_id = {r.episode: RecordedEpisode(number, r) for number, r in enumerate(whole)}
        #: What robots said of themselves.
        self.statuses = [message for message in self._messages if _kind(message) == "RobotStatus"]
        #: What they said last of their policy, its digest, the encoding and the radio; None if they said nothing.
        self.equipment: Any = self.statuses[-1].message if self.statuses else None
        #: Names of the policies that were carried one after the other, by their digests.
        self.policies: dict[str, str] = {s.message.digest: s.message.policy for s in self.statuses}
        team = worlds[0].topic.removesuffix("world")
        self._robot_of = {f"{team}{name}": robot for robot, name in enumerate(self.names)}
        for message in self._messages:
            self._sort(message)

    def _sort(self, message: BagMessage) -> None:
        """Put a message to its tick, if it is of one."""
        kind, content = _kind(message), message.message
        episode = self._by_id.get(getattr(content, "episode", 0))
        if episode is None or kind == "World":
            return
        tick, robot = episode.ticks[content.tick], self._robot_of.get(message.topic.rpartition("/")[0], -1)
        if kind == "Observation":
            tick.observations.setdefault(robot, message)
        elif kind == "FeatureBundle":
            tick.bundles.setdefault((robot, content.round), message)
        elif kind == "Feature":
            tick.features.setdefault((content.tag, content.round), message)
        elif kind == "Preference":
            tick.preferences.setdefault(content.tag, message)

    @property
    def all_episodes(self) -> list[RecordedEpisode]:
        """In the order in which they began."""
        return list(self._by_id.values())

    @cached_property
    def rounds(self) -> int:
        """Exchanges in a tick."""
        return max(
            (number + 1 for e in self.all_episodes for _, tick in e.steps() for _, number in tick.features), default=0
        )

    @cached_property
    def robots(self) -> pd.DataFrame:
        """One row a tick and robot.

        Columns: ``episode``, ``tick``, ``robot``; ``x``, ``y``, ``goal_x``, ``goal_y`` (cells, before the step);
        ``action``, ``moved`` (primitives), ``silent``, ``visited`` (after the step); of its observation ``neighbours``
        (messages that it could hear); of its preference, NaN where it was silent, ``heard`` (messages), ``entropy``
        (bits), ``bytes`` (of its feature messages), ``compute`` and ``latency`` (seconds; the latter from observation
        to preference, both as the recorder received them).
        """
        parts = []
        for episode in self.all_episodes:
            recording = episode.recording
            positions, goals = recording.positions, recording.goals
            steps, count = len(positions) - 1, len(goals)
            told = np.full((steps, count, 6), np.nan)
            for tick, said in episode.steps():
                for robot, observation in said.observations.items():
                    told[tick, robot, 0] = len(observation.message.audible_tags)
                    preference = said.preferences.get(observation.message.own_tag)
                    if preference is not None and not recording.worlds[tick + 1].silent[robot]:
                        told[tick, robot, 1:] = _said(preference, observation.received)
            columns = {
                "episode": np.full(steps * count, episode.number),
                "tick": np.repeat(np.arange(steps), count),
                "robot": np.tile(np.arange(count), steps),
                "x": positions[:-1, :, 0].ravel(),
                "y": positions[:-1, :, 1].ravel(),
                "goal_x": np.tile(goals[:, 0], steps),
                "goal_y": np.tile(goals[:, 1], steps),
                **{name: getattr(recording, name).ravel() for name in ("action", "moved", "silent", "visited")},
            }
            names = ("neighbours", "heard", "entropy", "bytes", "compute", "latency")
            columns |= {name: told[:, :, number].ravel() for number, name in enumerate(names)}
            parts.append(pd.DataFrame(columns))
        return pd.concat(parts, ignore_index=True)

    @cached_property
    def ticks(self) -> pd.DataFrame:
        """One row a tick.

        Columns: ``episode``, ``tick``; ``blocked`` (moves); ``silent``, ``visited`` and ``on_goal`` (robots, after the
        step); ``slowest`` (the robot that answered last, NaN if none did); ``seconds`` (wall time); ``links``
        (directed, of the radio).
        """
        robots = self.robots.assign(blocked=blocked(self.robots.action, self.robots.moved))
        by_tick = robots.groupby(["episode", "tick"])
        table = by_tick[["blocked", "silent", "visited"]].sum()
        answered = robots[robots.latency.notna()]
        slowest = answered.loc[answered.groupby(["episode", "tick"]).latency.idxmax()]
        table["slowest"] = slowest.set_index(["episode", "tick"]).robot
        for name, column in (("seconds", "seconds"), ("links", "links")):
            table[name] = [
                getattr(e.recording.worlds[tick + 1], column) for e in self.all_episodes for tick, _ in e.steps()
            ]
        table["on_goal"] = np.concatenate(
            [(e.recording.positions[1:] == e.recording.goals).all(axis=2).sum(axis=1) for e in self.all_episodes]
        )
        return table.reset_index()

    @cached_property
    def episodes(self) -> pd.DataFrame:
        """One row an episode: its measures (`magat_sim.measures`), and what the radio did.

        ``ended`` is False of an episode that was cancelled, or is cut off with the recording: what is said of it holds
        up to there. ``silent``, ``features_missing`` and ``bytes_per_tick`` are those of the action's result.
        """
        rows = []
        by_episode = dict(iter(self.robots.groupby("episode")))
        for episode in self.all_episodes:
            measures = episode.recording.measures
            robots = by_episode.get(episode.number, self.robots.iloc[:0])
            rows.append(
                {
                    "episode": episode.number,
                    "id": episode.recording.episode,
                    "ended": measures.success_strict or measures.ticks == measures.t_max,
                    **{name: getattr(measures, name) for name in _MEASURES},
                    "flowtime": measures.flowtime.first_visit,
                    "silent": int(robots.silent.sum()),
                    "features_missing": int((robots.neighbours - robots.heard).clip(lower=0).sum()),
                    "bytes_per_tick": float(robots.bytes.sum() / max(robots.bytes.count(), 1)),
                }
            )
        return pd.DataFrame(rows)

    @cached_property
    def messages(self) -> pd.DataFrame:
        """One row a message.

        Columns: ``time`` (seconds since the first one), ``topic``, ``kind``, ``bytes``; ``episode``, ``tick`` and
        ``round``, -1 if it is of none; ``robot``, who sent it or, of observations and bundles, was sent it, -1 if
        nobody can say.
        """
        begin = self._messages[0].received
        rows = []
        for message in self._messages:
            content, kind = message.message, _kind(message)
            episode = self._by_id.get(getattr(content, "episode", 0))
            robot = self._robot_of.get(message.topic.rpartition("/")[0], -1)
            if episode is not None and kind in ("Feature", "Preference"):
                robot = episode.ticks[content.tick].senders.get(content.tag, -1)
            of_tick = (-1, -1, -1)
            if episode is not None:
                of_tick = (episode.number, content.tick, getattr(content, "round", -1))
            rows.append(((message.received - begin) / 1e9, message.topic, kind, len(message.data), *of_tick, robot))
        return pd.DataFrame(rows, columns=["time", "topic", "kind", "bytes", "episode", "tick", "round", "robot"])

    @cached_property
    def lost(self) -> pd.DataFrame:
        """One row a tick of which the recording lacks messages: how many ``observations``, ``features`` and so on.

        A robot that was not silent had its observation, sent a feature in each round and a preference and, when
        messages are relayed, was handed a bundle in each.
        """
        rows = []
        relayed = any(tick.bundles for e in self.all_episodes for _, tick in e.steps())
        for episode in self.all_episodes:
            for tick, said in episode.steps():
                silent = np.asarray(episode.recording.worlds[tick + 1].silent, dtype=bool)
                spoke = np.flatnonzero(~silent).tolist()
                tags = [said.observations[robot].message.own_tag for robot in spoke if robot in said.observations]
                rounds = range(self.rounds)
                lacking = (
                    len(spoke) - len(tags),
                    len(spoke) * len(rounds) - sum((tag, number) in said.features for tag in tags for number in rounds),
                    len(spoke) - sum(tag in said.preferences for tag in tags),
                    sum((robot, number) not in said.bundles for robot in spoke for number in rounds) if relayed else 0,
                )
                if any(lacking):
                    rows.append((episode.number, tick, *lacking))
        return pd.DataFrame(rows, columns=["episode", "tick", "observations", "features", "preferences", "bundles"])


_MEASURES = ("success", "success_strict", "delta_ft", "delta_ft_strict", "p_rg", "makespan", "t_max", "ticks",
             "moves_blocked")  # fmt: skip


def _kind(message: BagMessage) -> str:
    return message.type.rpartition("/")[2]


def _said(preference: BagMessage, asked: int) -> tuple[float, ...]:
    content = preference.message
    logs = np.asarray(content.log_probabilities, dtype=np.float64)
    entropy = float(-(np.exp(logs) * logs).sum() / np.log(2))
    latency = (preference.received - asked) / 1e9
    return content.heard, entropy, content.feature_bytes, content.compute_us / 1e6, latency


def deadlocks(robots: pd.DataFrame, patience: int = PATIENCE) -> pd.DataFrame:
    """Where robots hold each other up, or one holds itself up: standing still, or going to and fro.

    Args:
        robots: the table of that name.
        patience: a robot is stuck while it has been off its goal, on one or two cells, for at least so many instants.

    Returns:
        One row a deadlock, which is all that is stuck side by side at the same time: ``episode``, ``begin`` (tick),
        ``ticks`` (how long), ``robots`` (a tuple), ``silent`` (whether one of them was dead or late in the meantime).
    """
    found: list[tuple[int, int, int, tuple[int, ...], bool]] = []
    for number, table in robots.groupby("episode"):
        count = int(table.robot.max()) + 1
        x, y, goal_x, goal_y, silent = (
            table[name].to_numpy().reshape(-1, count) for name in ("x", "y", "goal_x", "goal_y", "silent")
        )
        stuck = _stuck(x, y, (x == goal_x) & (y == goal_y), patience)
        tick, robot = np.nonzero(stuck)
        node = np.full(stuck.shape, -1)
        node[tick, robot] = np.arange(len(tick))
        follows = stuck[1:] & stuck[:-1]
        edges = [np.stack([node[:-1][follows], node[1:][follows]])]
        for now in range(len(stuck)):
            here = np.flatnonzero(stuck[now])
            apart = np.maximum(
                np.abs(x[now, here][:, None] - x[now, here]), np.abs(y[now, here][:, None] - y[now, here])
            )
            a, b = np.nonzero(np.triu(apart <= NEAR, 1))
            edges.append(np.stack([node[now, here[a]], node[now, here[b]]]))
        ends = np.concatenate(edges, axis=1)
        graph = coo_array((np.ones(ends.shape[1]), (ends[0], ends[1])), shape=(len(tick), len(tick)))
        groups, member = connected_components(graph, directed=False)
        for group in range(groups):
            inside = member == group
            begin, end = tick[inside].min(), tick[inside].max() + 1
            who = np.unique(robot[inside])
            dead = bool(silent[tick[inside], robot[inside]].any())
            found.append((int(number), int(begin), int(end - begin), tuple(who.tolist()), dead))
    return pd.DataFrame(found, columns=["episode", "begin", "ticks", "robots", "silent"]).sort_values(
        ["episode", "begin"], ignore_index=True
    )


def _stuck(x: np.ndarray, y: np.ndarray, on_goal: np.ndarray, patience: int) -> np.ndarray:
    """``[T, N]`` bool: instants within a window of ``patience`` in which a robot was off its goal and on two cells."""
    stuck = np.zeros(x.shape, dtype=bool)
    cell = x * 2**16 + y
    for begin in range(len(x) - patience + 1):
        window = slice(begin, begin + patience)
        cells = np.sort(cell[window], axis=0)
        few = (cells[1:] != cells[:-1]).sum(axis=0) < 2
        stuck[window] |= few & ~on_goal[window].any(axis=0)
    return stuck
