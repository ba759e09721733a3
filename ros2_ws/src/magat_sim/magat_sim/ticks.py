"""One episode on a distributed team, tick by tick: one-time tags out, preferences in. Free of ROS."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from magat_sim.case import Case
from magat_sim.field_of_view import Uint8Array
from magat_sim.grid import DELTAS, BoolArray, IntArray
from magat_sim.relay import Bundle, Relay
from magat_sim.simulator import DEFAULT_RULES, Actions, Rules, Simulator, Step
from magat_sim.streams import EpisodeStreams


@dataclass(frozen=True)
class RobotObservation:
    """What is told to one robot at the start of a tick."""

    #: ``[3, 11, 11]`` uint8.
    field_of_view: Uint8Array
    own_tag: int
    #: Tags of the messages it will hear, shuffled.
    audible_tags: list[int]
    stream: int


@dataclass(frozen=True)
class ReceivedPreference:
    """What one robot answered."""

    primitive: int
    heard: int
    feature_bytes: int
    #: ``[5]`` how much it likes the primitives.
    log_probabilities: npt.ArrayLike = (0.0,) * len(DELTAS)


@dataclass(frozen=True)
class Outcome:
    """What a tick came to, for whoever watches."""

    #: ``[N]`` the primitives actions; IDLE where silent.
    actions: IntArray
    step: Step
    #: ``[N]`` bool.
    silent: BoolArray
    #: ``[N]`` messages in range that the robot did not hear, over all rounds; 0 where silent.
    missing: IntArray
    #: Directed radio links.
    links: int


class DistributedEpisode:
    """Runs a `Simulator` of one world by `look`, `answer` and `advance`; counts what the radio did."""

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
        self._tags = streams.tags
        self._wishes: dict[int, ReceivedPreference] = {}
        self._robot_of: dict[int, int] = {}
        self._expected: list[int] = []
        self._audible: IntArray = np.zeros(0, dtype=np.int64)
        self._links = 0

    def look(self, present: npt.ArrayLike) -> list[RobotObservation]:
        """Start a tick: what each of the N robots sees, and whom of those ``present`` (``[N]`` bool) it hears."""
        present = np.asarray(present, dtype=bool)
        observation = self.simulator.observe()
        tags = self._tags.integers(1, 2**64, size=self.robots, dtype=np.uint64)
        heard = np.where(present[np.maximum(observation.heard, 0)], observation.heard, -1)
        audible = [tags[row[row >= 0]] for row in heard]
        self._robot_of = {int(tag): robot for robot, tag in enumerate(tags)}
        self.relay = Relay(tags.tolist(), [row[row >= 0].tolist() for row in heard], present.tolist())
        self._wishes = {}
        self._audible = np.array([len(a) for a in audible])
        self._links = int(self._audible[present].sum())
        return [
            RobotObservation(view, int(tag), self._tags.permutation(hears).tolist(), int(stream))
            for view, tag, hears, stream in zip(
                observation.field_of_view, tags, audible, observation.streams, strict=True
            )
        ]

    def relayed(self) -> list[Bundle]:
        """End a round of messages that are relayed: for each of the N robots what it hears."""
        return self.relay.bundles(self._tags)

    def answer(self, tag: int, wish: ReceivedPreference) -> str | None:
        """Take the preference sent under ``tag``; None, or why it was dropped."""
        robot = self._robot_of.get(tag)
        if robot is None:
            return "a preference under a tag that was not given out in this tick"
        if robot in self._wishes:
            return "a second preference of one robot in one tick"
        if not 0 <= wish.primitive < len(DELTAS):
            return f"the primitive {wish.primitive}, where there are 0 to {len(DELTAS) - 1}"
        self._wishes[robot] = wish
        return None

    @property
    def answered(self) -> BoolArray:
        """``[N]`` bool, whose preference is there."""
        flags = np.zeros(self.robots, dtype=bool)
        flags[list(self._wishes)] = True
        return flags

    def advance(self) -> Outcome:
        """End the tick: who is silent idles, the shield rules, the robots move."""
        actions = np.zeros(self.robots, dtype=np.int64)
        liking = np.zeros((self.robots, len(DELTAS)), dtype=np.float32)
        missing = np.zeros(self.robots, dtype=np.int64)
        for robot, wish in self._wishes.items():
            actions[robot], liking[robot] = wish.primitive, wish.log_probabilities
            missing[robot] = max(0, int(self._audible[robot]) - wish.heard)
            self.feature_bytes += wish.feature_bytes
        self.features_missing += int(missing.sum())
        self.answers += len(self._wishes)
        silent = ~self.answered
        self.silent += int(silent.sum())
        return Outcome(actions, self.simulator.step(Actions(actions, liking, silent)), silent, missing, self._links)

    @property
    def bytes_per_tick(self) -> float:
        """Feature bytes that a robot sent in a tick, mean over the preferences that came."""
        return self.feature_bytes / max(self.answers, 1)
