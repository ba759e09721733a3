# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables of a recorded team: episodes, ticks, robots, messages, and messages that the recording lacks. Free of ROS.

Episodes are numbered from 0 in the order in which they began, robots in the simulator's order. Row ``tick`` is the step
from instant ``tick`` to ``tick + 1``: observations and decisions before the step, and its outcome. Features carry no
sender. The sender is found by its tag, because each tag is in the recorded observation of one robot only.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from magat_node.errors import UnusableMessageError
from magat_node.status_check import status_fault
from magat_recording.bag import BagError, BagMessage
from magat_recording.recovery import read_recording
from magat_recording.world_log import WorldLog
from magat_sim.shield import blocked

_MEASURES = ("success", "success_strict", "delta_ft", "delta_ft_strict", "p_rg", "makespan", "t_max", "ticks",
             "moves_blocked")  # fmt: skip


@dataclass
class RecordedTick:
    """The messages of one tick of an episode; the first one if a message came twice."""

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
        """The robots by their tags in this tick."""
        return {observation.message.own_tag: robot for robot, observation in self.observations.items()}


@dataclass
class RecordedEpisode:
    """A complete episode of a recording."""

    number: int
    #: Its World messages.
    log: WorldLog
    ticks: dict[int, RecordedTick] = field(default_factory=lambda: defaultdict(RecordedTick))

    def steps(self) -> Iterator[tuple[int, RecordedTick]]:
        """The ticks and their messages, in order."""
        for tick in range(len(self.log.worlds) - 1):
            yield tick, self.ticks[tick]


class TeamRecording:
    """The recording of a team. Each table is computed once, on first access."""

    def __init__(self, bag: Path) -> None:
        """Read ``bag``, with the other pieces of the recording if its recorder was killed (`magat_recording.recovery`).

        Raises:
            BagError: it cannot be read, it has no complete episode, or it is of an older version.
        """
        self._messages = list(read_recording(bag))
        worlds = [message for message in self._messages if _kind(message) == "World"]
        if worlds and not hasattr(worlds[0].message, "action"):
            raise BagError(f"{bag} was recorded by an older version, without the field World.action: record it again")
        logs: dict[int, WorldLog] = {}
        for world in worlds:
            number = world.message.episode
            with suppress(UnusableMessageError):  # of a stranger
                logs.setdefault(number, WorldLog(number)).add(world.message)
        complete = [log for log in logs.values() if log.worlds and log.complete]
        if not complete:
            raise BagError(
                f"{bag} has no complete episode ({len(worlds)} of its {len(self._messages)} messages are worlds): "
                "start the recording before the episode"
            )
        # Strangers may have begun episodes with other robots. The team is the one that made most of the ticks.
        ticks: Counter[tuple[str, ...]] = Counter()
        for log in complete:
            ticks[tuple(log.robots)] += len(log.worlds)
        names = list(ticks.most_common(1)[0][0])
        complete = [log for log in complete if log.robots == names]
        #: Number of episodes that are ignored because a World message is missing: most began before the recording.
        self.incomplete_episodes = len(logs) - len(complete)
        #: Names of the robots, in the simulator's order.
        self.names = names
        self._by_id = {log.episode: RecordedEpisode(number, log) for number, log in enumerate(complete)}
        #: All RobotStatus messages of the team.
        self.statuses = [
            message for message in self._messages if _kind(message) == "RobotStatus" and self._own(message)
        ]
        #: The last RobotStatus, with the policy, its digest, the encoding and the radio; None if there is none.
        self.last_status: Any = self.statuses[-1].message if self.statuses else None
        #: The names of all policies that the robots carried, by digest.
        self.policies: dict[str, str] = {s.message.digest: s.message.policy for s in self.statuses}
        team = worlds[0].topic.removesuffix("world")
        self._robot_of = {f"{team}{name}": robot for robot, name in enumerate(self.names)}
        for message in self._messages:
            self._sort(message)

    def _own(self, status: BagMessage) -> bool:
        """Whether a RobotStatus is one of the team's, not of a stranger."""
        return status_fault(status.message) is None and set(status.message.robots) <= set(self.names)

    def _sort(self, message: BagMessage) -> None:
        """Add a message to the tick that it belongs to, if any."""
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
        """The complete episodes, in the order in which they began."""
        return list(self._by_id.values())

    @cached_property
    def rounds(self) -> int:
        """Rounds of messages in a tick."""
        return max(
            (number + 1 for e in self.all_episodes for _, tick in e.steps() for _, number in tick.features), default=0
        )

    @cached_property
    def robots(self) -> pd.DataFrame:
        """One row for each tick and robot.

        Columns: ``episode``, ``tick``, ``robot``; ``x``, ``y``, ``goal_x``, ``goal_y`` (cells, before the step);
        ``action``, ``moved`` (primitives), ``silent``, ``visited`` (after the step); from its observation
        ``neighbours`` (audible messages); from its preference, NaN if the robot was silent, ``heard`` (messages),
        ``entropy`` (bits), ``bytes`` (of its features), ``compute`` and ``latency`` (seconds; the latter between
        observation and preference, by the times at which the recorder received them).
        """
        parts = []
        for episode in self.all_episodes:
            log = episode.log
            positions, goals = log.positions, log.goals
            steps, count = len(positions) - 1, len(goals)
            values = np.full((steps, count, 6), np.nan)
            for tick, messages in episode.steps():
                for robot, observation in messages.observations.items():
                    values[tick, robot, 0] = len(observation.message.audible_tags)
                    preference = messages.preferences.get(observation.message.own_tag)
                    if preference is not None and not log.worlds[tick + 1].silent[robot]:
                        values[tick, robot, 1:] = _preference_values(preference, observation.received)
            columns = {
                "episode": np.full(steps * count, episode.number),
                "tick": np.repeat(np.arange(steps), count),
                "robot": np.tile(np.arange(count), steps),
                "x": positions[:-1, :, 0].ravel(),
                "y": positions[:-1, :, 1].ravel(),
                "goal_x": np.tile(goals[:, 0], steps),
                "goal_y": np.tile(goals[:, 1], steps),
                **{name: getattr(log, name).ravel() for name in ("action", "moved", "silent", "visited")},
            }
            names = ("neighbours", "heard", "entropy", "bytes", "compute", "latency")
            columns |= {name: values[:, :, number].ravel() for number, name in enumerate(names)}
            parts.append(pd.DataFrame(columns))
        return pd.concat(parts, ignore_index=True)

    @cached_property
    def ticks(self) -> pd.DataFrame:
        """One row for each tick.

        Columns: ``episode``, ``tick``; ``blocked`` (moves); ``silent``, ``visited`` and ``on_goal`` (numbers of robots
        after the step); ``slowest`` (the robot that answered last, NaN if none did); ``seconds`` (wall time);
        ``links`` (directed radio links).
        """
        robots = self.robots.assign(blocked=blocked(self.robots.action, self.robots.moved))
        by_tick = robots.groupby(["episode", "tick"])
        table = by_tick[["blocked", "silent", "visited"]].sum()
        answered = robots[robots.latency.notna()]
        slowest = answered.loc[answered.groupby(["episode", "tick"]).latency.idxmax()]
        table["slowest"] = slowest.set_index(["episode", "tick"]).robot
        for name, column in (("seconds", "seconds"), ("links", "links")):
            table[name] = [getattr(e.log.worlds[tick + 1], column) for e in self.all_episodes for tick, _ in e.steps()]
        table["on_goal"] = np.concatenate(
            [(e.log.positions[1:] == e.log.goals).all(axis=2).sum(axis=1) for e in self.all_episodes]
        )
        return table.reset_index()

    @cached_property
    def episodes(self) -> pd.DataFrame:
        """One row for each episode: its measures (`magat_sim.measures`) and radio statistics.

        ``ended`` is False for an episode that was cancelled or that goes on after the recording; its measures then hold
        up to the last recorded tick. ``silent``, ``features_missing`` and ``bytes_per_tick`` are those of the action's
        result.
        """
        rows = []
        by_episode = dict(iter(self.robots.groupby("episode")))
        for episode in self.all_episodes:
            measures = episode.log.measures
            robots = by_episode.get(episode.number, self.robots.iloc[:0])
            rows.append(
                {
                    "episode": episode.number,
                    "id": episode.log.episode,
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
        """One row for each message.

        Columns: ``time`` (seconds since the first one), ``topic``, ``kind``, ``bytes``; ``episode``, ``tick`` and
        ``round``, -1 if it belongs to none; ``robot``: the sender or, for observations and bundles, the receiver, -1 if
        it is unknown.
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
        """One row for each tick of which the recording lacks messages.

        Columns: ``episode``, ``tick``; the numbers of missing ``observations``, ``features``, ``preferences`` and
        ``bundles``. A robot that was not silent received an observation, sent a preference, sent a feature in each
        round and, if the radio is relayed, received a bundle in each round.
        """
        rows = []
        relayed = any(tick.bundles for e in self.all_episodes for _, tick in e.steps())
        for episode in self.all_episodes:
            for tick, known in episode.steps():
                silent = np.asarray(episode.log.worlds[tick + 1].silent, dtype=bool)
                active = np.flatnonzero(~silent).tolist()
                tags = [known.observations[robot].message.own_tag for robot in active if robot in known.observations]
                rounds = range(self.rounds)
                lost = (
                    len(active) - len(tags),
                    len(active) * len(rounds)
                    - sum((tag, number) in known.features for tag in tags for number in rounds),
                    len(active) - sum(tag in known.preferences for tag in tags),
                    sum((robot, number) not in known.bundles for robot in active for number in rounds)
                    if relayed
                    else 0,
                )
                if any(lost):
                    rows.append((episode.number, tick, *lost))
        return pd.DataFrame(rows, columns=["episode", "tick", "observations", "features", "preferences", "bundles"])


def _kind(message: BagMessage) -> str:
    return message.type.rpartition("/")[2]


def _preference_values(preference: BagMessage, asked: int) -> tuple[float, ...]:
    """heard, entropy, bytes, compute and latency of `TeamRecording.robots`; ``asked``: when the observation came."""
    content = preference.message
    logs = np.asarray(content.log_probabilities, dtype=np.float64)
    entropy = float(-(np.exp(logs) * logs).sum() / np.log(2))
    latency = (preference.received - asked) / 1e9
    return content.heard, entropy, content.feature_bytes, content.compute_us / 1e6, latency
