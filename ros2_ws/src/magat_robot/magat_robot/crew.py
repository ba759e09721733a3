# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The state machine of a tick, for the robots of one process (the crew). Free of ROS.

A process runs one robot or several. Several robots share one policy and are computed as one batch, but they exchange
all messages over the radio, also with each other. The results of a policy do not depend on the batch, so each robot
decides as if it ran alone.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from magat_node.unpredictable import shuffled
from magat_robot.exchange import MOST_MESSAGES, Exchange
from magat_robot.policy import payload
from magat_robot.policy.config import OBSERVATION_SHAPE, PRIMITIVES
from magat_robot.policy.interface import Decision, LatentState, RobotPolicy
from magat_robot.policy.visit_memory import VisitMemory

_OBSERVATION_BYTES = int(np.prod(OBSERVATION_SHAPE))


@dataclass(frozen=True)
class ReceivedObservation:
    """The observation of one robot in a tick: `magat_interfaces/msg/Observation` without ROS."""

    episode: int
    tick: int
    #: Seed of the robot's random stream.
    stream: int
    #: One-time tag of the messages that the robot sends in this tick.
    own_tag: int
    #: Tags of the robots in radio range.
    audible_tags: frozenset[int]
    #: ``[3, 11, 11]`` of 0 and 1, as bytes.
    field_of_view: bytes
    #: The primitive that the robot made in the step before.
    moved: int = 0


@dataclass(frozen=True)
class Message:
    """The message of one robot in one round of a tick: `magat_interfaces/msg/Feature` without ROS."""

    episode: int
    tick: int
    round: int
    tag: int
    payload: bytes


@dataclass(frozen=True)
class Answer:
    """The decision of one robot in a tick, and statistics of the tick."""

    observation: ReceivedObservation
    #: ``[5]`` float32, natural logarithms of the primitives' probabilities.
    log_probabilities: npt.NDArray[np.float32]
    #: The primitive drawn.
    primitive: int
    #: Messages in radio range minus ``missing``; at least 0.
    heard: int
    #: Messages in radio range that came too late, or were unusable, summed over all rounds.
    missing: int
    #: Seconds of computing in this process, divided by the number of robots.
    compute: float


class Crew:
    """The M robots of one process, which share one policy.

    A tick begins with the first observation of it. When all M observations are there, the robots perceive and send the
    first messages. When all audible messages of a round are there, the robots process them, and send the messages of
    the next round or decide. `overdue` goes on without what is missing.
    """

    def __init__(
        self,
        policy: RobotPolicy,
        robots: int,
        send: Callable[[int, Message], None],
        answer: Callable[[int, Answer], None],
        relayed: bool = False,
    ) -> None:
        """Wait for the first tick.

        Args:
            policy: shared by all robots.
            robots: M.
            send: called with the number of a robot, from 0, and the message that it sends.
            answer: called with the number of a robot and its decision.
            relayed: messages arrive as bundles (`hear_bundle`), not one by one (`hear`).
        """
        config = policy.config
        self.exchange = Exchange(payload.round_bytes(config, config.encoding))
        #: Messages missing so far, of all robots.
        self.missing = 0
        self._policy, self._robots, self._send, self._answer = policy, robots, send, answer
        self._relayed = relayed
        self._at: tuple[int, int] | None = None
        self._observations: dict[int, ReceivedObservation] = {}
        self._latent: LatentState | None = None  # rows: the robots in the order of _observations
        # Without visit_memory nothing is remembered, because it would not be used.
        self._memory = VisitMemory(robots) if config.visit_memory else None
        self._visits: npt.NDArray[np.int64] | None = None  # rows as those of _latent
        self._round = 0
        self._audible: frozenset[int] = frozenset()  # tags that any of these robots can hear
        self._awaited: set[int] = set()  # missing tags; if relayed, robots without a bundle
        self._bundles: dict[int, list[bytes]] = {}
        self._lost = np.zeros(0, dtype=np.int64)
        self._compute = 0.0

    # --- Input ---

    def see(self, robot: int, observation: ReceivedObservation) -> bool:
        """Process the observation of ``robot``; True if a tick begins with it."""
        at, field_of_view = (observation.episode, observation.tick), observation.field_of_view
        if len(field_of_view) != _OBSERVATION_BYTES:
            self.exchange.drop(f"an observation of {len(field_of_view)} numbers, not {OBSERVATION_SHAPE}")
        elif max(field_of_view) > 1:
            self.exchange.drop(f"an observation that holds {max(field_of_view)}, not only 0 and 1")
        elif observation.moved >= PRIMITIVES:
            self.exchange.drop(f"an observation with the primitive {observation.moved}, not 0 to {PRIMITIVES - 1}")
        elif len(observation.audible_tags) > MOST_MESSAGES:
            tags = len(observation.audible_tags)
            self.exchange.drop(f"an observation that announces {tags} messages, more than {MOST_MESSAGES}")
        elif self._at is not None and self._at[0] == at[0] and at[1] < self._at[1]:
            self.exchange.drop(f"a late observation, of tick {at[1]} after {self._at[1]}")
        elif at == self._at and (robot in self._observations or self._latent is not None or not self._observations):
            self.exchange.drop(f"a repeated or late observation, of tick {at[1]}, which is under way")
        else:
            begins = at != self._at
            if begins:
                self._at, self._observations, self._latent, self._round, self._bundles = at, {}, None, 0, {}
                self.exchange.begin(*at)
            self._observations[robot] = observation
            if len(self._observations) == self._robots:
                self._perceive()
            return begins
        return False

    def hear(self, message: Message) -> None:
        """Process a message that came over the direct radio, from any robot, in range or not."""
        is_new = self.exchange.receive(message.episode, message.tick, message.round, message.tag, message.payload)
        if is_new and self._latent is not None and message.round == self._round:
            self._awaited.discard(message.tag)
            if not self._awaited:
                self._fuse()

    def hear_bundle(self, robot: int, episode: int, tick: int, number: int, payloads: Sequence[bytes]) -> None:
        """Process all messages that ``robot`` hears in round ``number``, in any order, over the relayed radio."""
        # A bundle may come before the robots of this process perceive: if one of them misses its observation, other
        # processes do not wait for it.
        awaiting = self._observations if self._latent is not None else range(self._robots if self._observations else 0)
        if (episode, tick) != self._at or number != self._round or robot not in awaiting or robot in self._bundles:
            self.exchange.drop(f"a late or repeated bundle, of round {number} of tick {tick}")
            return
        self._bundles[robot] = list(payloads)
        if self._latent is not None:
            self._awaited.discard(robot)
            if not self._awaited:
                self._fuse()

    def overdue(self) -> None:
        """Go on without what is missing, because the deadline is over."""
        if self._latent is not None:
            self._fuse()
        elif self._observations:
            self._perceive()

    @property
    def waiting(self) -> bool:
        """Whether a tick is in progress."""
        return bool(self._observations)

    # --- Perceive, send, hear, decide ---

    def _perceive(self) -> None:
        started = time.monotonic()
        self._observations = dict(sorted(self._observations.items()))
        data = b"".join(observation.field_of_view for observation in self._observations.values())
        views = np.frombuffer(data, dtype=np.uint8).reshape(-1, *OBSERVATION_SHAPE)
        self._latent = self._policy.perceive(views)
        if self._memory is not None:
            assert self._at is not None
            moved = np.array([observation.moved for observation in self._observations.values()])
            self._visits = self._memory.observe(np.array([*self._observations]), *self._at, moved, views)
        self._lost = np.zeros(len(self._observations), dtype=np.int64)
        self._audible = frozenset().union(*(observation.audible_tags for observation in self._observations.values()))
        self.exchange.listen(self._audible)
        self._compute = time.monotonic() - started
        self._send_round()

    def _send_round(self) -> None:
        assert self._latent is not None
        # Set before sending, because the answers may arrive during the call that sends.
        if self._relayed:
            self._awaited = self._observations.keys() - self._bundles.keys()
        else:
            self._awaited = set(self._audible - self.exchange.kept(self._round).keys())
        ready = not self._awaited
        number = self._round  # the next round may begin before all have sent
        # In a fixed order, the place of a message would tell which of these robots has sent it.
        for (robot, observation), values in shuffled(
            zip(self._observations.items(), self._latent.messages, strict=True)
        ):
            data = payload.encode(values, self._policy.config.encoding)
            self._send(robot, Message(observation.episode, observation.tick, number, observation.own_tag, data))
        if ready:
            self._fuse()

    def _fuse(self) -> None:
        assert self._latent is not None
        started = time.monotonic()
        heard = self._decoded()
        counts = np.array([len(messages) for messages in heard])
        audible = np.array([len(observation.audible_tags) for observation in self._observations.values()])
        self._lost = self._lost + np.maximum(audible - counts, 0)
        size = self._latent.messages.shape[1]
        messages = np.zeros((len(heard), int(counts.max()), size), dtype=np.float32)
        for row, values in enumerate(heard):
            if values:
                messages[row, : len(values)] = values
        present = np.arange(messages.shape[1]) < counts[:, None]
        self._latent = self._policy.hear(self._latent, messages, present)
        self._round += 1
        self._bundles = {}
        self._compute += time.monotonic() - started
        if self._round < len(self._policy.config.message_sizes):
            self._send_round()
        else:
            self._decide()

    def _decoded(self) -> list[list[npt.NDArray[np.float32]]]:
        """The decoded messages of each robot in this round, without unusable ones, which are counted as dropped."""
        config = self._policy.config
        size = config.message_sizes[self._round]
        decoded: dict[bytes, npt.NDArray[np.float32] | str] = {}

        def usable(data: bytes) -> npt.NDArray[np.float32] | None:
            if data not in decoded:  # a message that several robots of this process hear is decoded once
                try:
                    decoded[data] = payload.decode(data, size, config.encoding, config.largest)
                except payload.PayloadError as error:
                    decoded[data] = str(error)
            values = decoded[data]
            if isinstance(values, str):
                self.exchange.drop(values)
                return None
            return values

        kept = self.exchange.kept(self._round)
        result = []
        for robot, observation in self._observations.items():
            if self._relayed:
                received = self._bundles.get(robot, [])
            else:
                received = [kept[tag] for tag in observation.audible_tags if tag in kept]
            result.append([x for x in map(usable, received) if x is not None])
        return result

    def _decide(self) -> None:
        assert self._latent is not None
        started = time.monotonic()
        observations = list(self._observations.items())
        streams = np.array([observation.stream for _, observation in observations], dtype=np.uint64)
        decision: Decision = self._policy.decide(self._latent, streams, observations[0][1].tick, self._visits)
        self.missing += int(self._lost.sum())
        self._observations, self._latent = {}, None
        share = (self._compute + time.monotonic() - started) / len(observations)
        logs = decision.log_probabilities
        for row, (robot, observation) in enumerate(observations):
            lost = int(self._lost[row])
            heard = max(len(observation.audible_tags) - lost, 0)
            self._answer(robot, Answer(observation, logs[row], int(decision.primitives[row]), heard, lost, share))
