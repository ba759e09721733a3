# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""One episode on a distributed team, tick by tick: observations with one-time tags, preferences. Free of ROS."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from magat_node.unpredictable import random_tags, shuffled
from magat_sim.case import Case
from magat_sim.field_of_view import Uint8Array
from magat_sim.grid import DELTAS, BoolArray, IntArray
from magat_sim.relay import Bundle, Relay
from magat_sim.simulator import DEFAULT_RULES, Actions, Rules, Simulator, Step
from magat_sim.streams import EpisodeStreams


@dataclass(frozen=True)
class RobotObservation:
    """What one robot receives at the start of a tick."""

    #: ``[3, 11, 11]`` uint8.
    field_of_view: Uint8Array
    #: Tag of the messages that it sends in this tick.
    own_tag: int
    #: Tags of the messages that it will hear, shuffled.
    audible_tags: list[int]
    #: Seed of its random stream.
    stream: int
    #: The primitive that it made in the step before.
    moved: int


@dataclass(frozen=True)
class ReceivedPreference:
    """The answer of one robot in a tick."""

    #: The sampled action.
    primitive: int
    #: Announced messages that it heard.
    heard: int
    #: Bytes of the Feature messages that it sent.
    feature_bytes: int
    #: ``[5]`` log-probabilities of the primitives.
    log_probabilities: npt.ArrayLike = (0.0,) * len(DELTAS)


@dataclass(frozen=True)
class Outcome:
    """The result of a tick, for the World message."""

    #: ``[N]`` int64, the sampled actions; IDLE for silent robots.
    actions: IntArray
    step: Step
    #: ``[N]`` bool, robots without a preference in time.
    silent: BoolArray
    #: ``[N]`` int64, messages in range that the robot did not hear, over all rounds; 0 for silent robots.
    missing: IntArray
    #: Directed radio links of the tick.
    links: int


class DistributedEpisode:
    """Runs a `Simulator` of one world: `look` begins a tick, `answer` takes preferences, `advance` ends it."""

    def __init__(
        self,
        case: Case,
        t_max: int,
        streams: EpisodeStreams,
        rules: Rules = DEFAULT_RULES,
    ) -> None:
        """Put the robots on their starts; see `Simulator`."""
        self.simulator = Simulator([case], [t_max], [streams], rules)
        self.robots = case.robots
        self.silent = self.features_missing = self.feature_bytes = self.answers = 0
        self._preferences: dict[int, ReceivedPreference] = {}
        self._robot_of: dict[int, int] = {}
        self._audible: IntArray = np.zeros(0, dtype=np.int64)
        self._links = 0

    def look(self, present: npt.ArrayLike) -> list[RobotObservation]:
        """Start a tick: the observations of N robots. Those that are not ``present`` (``[N]`` bool) send nothing."""
        present = np.asarray(present, dtype=bool)
        observation = self.simulator.observe()
        tags = random_tags(self.robots)
        heard = np.where(present[np.maximum(observation.heard, 0)], observation.heard, -1)
        hears = [row[row >= 0].tolist() for row in heard]
        audible = [shuffled(tags[j] for j in row) for row in hears]
        self._robot_of = {tag: robot for robot, tag in enumerate(tags)}
        self.relay = Relay(tags, hears, present.tolist())
        self._preferences = {}
        self._audible = np.array([len(a) for a in audible])
        self._links = int(self._audible[present].sum())
        return [
            RobotObservation(view, tag, announced, int(stream), int(moved))
            for view, tag, announced, stream, moved in zip(
                observation.field_of_view, tags, audible, observation.streams, observation.moved, strict=True
            )
        ]

    def relayed(self) -> list[Bundle]:
        """End a round of the relayed radio: the messages that each of the N robots hears."""
        return self.relay.bundles()

    def answer(self, tag: int, preference: ReceivedPreference) -> str | None:
        """Take the preference sent under ``tag``; returns None, or why it was dropped."""
        robot = self._robot_of.get(tag)
        if robot is None:
            return "a preference under a tag that was not given out in this tick"
        if robot in self._preferences:
            return "a second preference of one robot in one tick"
        if not 0 <= preference.primitive < len(DELTAS):
            return f"the primitive {preference.primitive}; there are 0 to {len(DELTAS) - 1}"
        self._preferences[robot] = preference
        return None

    @property
    def answered(self) -> BoolArray:
        """``[N]`` bool, robots whose preferences have come."""
        flags = np.zeros(self.robots, dtype=bool)
        flags[list(self._preferences)] = True
        return flags

    def advance(self) -> Outcome:
        """End the tick: silent robots idle, the shield is applied, and the robots move."""
        actions = np.zeros(self.robots, dtype=np.int64)
        log_probabilities = np.zeros((self.robots, len(DELTAS)), dtype=np.float32)
        missing = np.zeros(self.robots, dtype=np.int64)
        for robot, preference in self._preferences.items():
            actions[robot], log_probabilities[robot] = preference.primitive, preference.log_probabilities
            missing[robot] = max(0, int(self._audible[robot]) - preference.heard)
            self.feature_bytes += preference.feature_bytes
        self.features_missing += int(missing.sum())
        self.answers += len(self._preferences)
        silent = ~self.answered
        self.silent += int(silent.sum())
        step = self.simulator.step(Actions(actions, log_probabilities, silent))
        return Outcome(actions, step, silent, missing, self._links)

    @property
    def bytes_per_tick(self) -> float:
        """Bytes of the Feature messages of a robot in a tick, mean over the preferences that came."""
        return self.feature_bytes / max(self.answers, 1)
