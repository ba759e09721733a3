"""The robots of one process, tick by tick: what they see and hear in, what they send and decide out. Free of ROS.

A process carries one robot or many. Many share one policy and compute together, but exchange every message over the
radio, among themselves too. As a policy's results do not depend on how many robots are computed together, each decides
what it would decide alone.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from magat_robot.exchange import MOST_MESSAGES, Exchange
from magat_robot.policy import payload
from magat_robot.policy.config import OBSERVATION_SHAPE
from magat_robot.policy.interface import Decision, LatentState, RobotPolicy

_OBSERVATION_BYTES = int(np.prod(OBSERVATION_SHAPE))


@dataclass(frozen=True)
class ReceivedObservation:
    """What one robot is told in a tick."""

    episode: int
    tick: int
    #: Seed of its random stream.
    stream: int
    #: What it sends under.
    own_tag: int
    #: Of the messages that it can hear.
    audible_tags: frozenset[int]
    #: ``[3, 11, 11]`` of 0 and 1, as bytes.
    field_of_view: bytes


@dataclass(frozen=True)
class Message:
    """What one robot sends in one round."""

    episode: int
    tick: int
    round: int
    tag: int
    payload: bytes


@dataclass(frozen=True)
class Answer:
    """What one robot decided."""

    sight: ReceivedObservation
    #: ``[5]`` float32.
    log_probabilities: npt.NDArray[np.float32]
    primitive: int
    #: Audible messages, less those that are missing: not there in time, or of no use, over all rounds.
    heard: int
    missing: int
    #: Seconds of computing, the process's divided by its robots.
    compute: float


class Crew:
    """M robots that carry one policy.

    A tick begins with the first sight of it. When all M robots have theirs, they look and send; when everything audible
    in a round is there, they hear it, and send again or decide. `overdue` goes on with what is there.
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
            policy: of all robots.
            robots: M.
            send: called with a robot's number, from 0, and what it sends.
            answer: called with a robot's number and what it decided.
            relayed: messages come as bundles (`hear_bundle`), not one by one (`hear`).
        """
        config = policy.config
        self.exchange = Exchange([payload.encoded_bytes(size, config.encoding) for size in config.message_sizes])
        self.missing = 0
        self._policy, self._robots, self._send, self._answer = policy, robots, send, answer
        self._relayed = relayed
        self._at: tuple[int, int] | None = None
        self._sights: dict[int, ReceivedObservation] = {}
        self._own: LatentState | None = None  # rows: the robots of _sights, in their order
        self._round = 0
        self._audible: frozenset[int] = frozenset()  # tags, by any of these robots
        self._awaited: set[int] = set()  # tags, or robots whose bundles are missing
        self._bundles: dict[int, list[bytes]] = {}
        self._lost = np.zeros(0, dtype=np.int64)
        self._compute = 0.0

    # --- What comes in ---

    def see(self, robot: int, sight: ReceivedObservation) -> bool:
        """Take what ``robot`` is told; True if a tick begins with it."""
        at, view = (sight.episode, sight.tick), sight.field_of_view
        if len(view) != _OBSERVATION_BYTES:
            self.exchange.drop(f"an observation of {len(view)} numbers, not {OBSERVATION_SHAPE}")
        elif max(view) > 1:
            self.exchange.drop(f"an observation that holds {max(view)}, where there are 0 and 1")
        elif len(sight.audible_tags) > MOST_MESSAGES:
            self.exchange.drop(f"an observation that announces {len(sight.audible_tags)} messages")
        elif self._at is not None and self._at[0] == at[0] and at[1] < self._at[1]:
            self.exchange.drop(f"a late observation, of tick {at[1]} after {self._at[1]}")
        elif at == self._at and (robot in self._sights or self._own is not None or not self._sights):
            self.exchange.drop(f"a repeated or late observation, of tick {at[1]}, which is under way")
        else:
            begins = at != self._at
            if begins:
                self._at, self._sights, self._own, self._round, self._bundles = at, {}, None, 0, {}
                self.exchange.begin(*at)
            self._sights[robot] = sight
            if len(self._sights) == self._robots:
                self._look()
            return begins
        return False

    def hear(self, message: Message) -> None:
        """Take the message of any robot, near or far."""
        mine = self.exchange.receive(message.episode, message.tick, message.round, message.tag, message.payload)
        if mine and self._own is not None and message.round == self._round:
            self._awaited.discard(message.tag)
            if not self._awaited:
                self._fuse()

    def hear_bundle(self, robot: int, episode: int, tick: int, number: int, payloads: Sequence[bytes]) -> None:
        """Take all that ``robot`` can hear in round ``number``, in any order."""
        # It may come before this process has looked: when that misses an observation, others go on without it.
        awaiting = self._sights if self._own is not None else range(self._robots if self._sights else 0)
        if (episode, tick) != self._at or number != self._round or robot not in awaiting or robot in self._bundles:
            self.exchange.drop(f"a late or repeated bundle, of round {number} of tick {tick}")
            return
        self._bundles[robot] = list(payloads)
        if self._own is not None:
            self._awaited.discard(robot)
            if not self._awaited:
                self._fuse()

    def overdue(self) -> None:
        """The deadline of what is awaited is over: go on without it."""
        if self._own is not None:
            self._fuse()
        elif self._sights:
            self._look()

    @property
    def waiting(self) -> bool:
        """A tick is under way."""
        return bool(self._sights)

    # --- Look, send, hear, decide ---

    def _look(self) -> None:
        started = time.monotonic()
        self._sights = dict(sorted(self._sights.items()))
        views = b"".join(sight.field_of_view for sight in self._sights.values())
        self._own = self._policy.perceive(np.frombuffer(views, dtype=np.uint8).reshape(-1, *OBSERVATION_SHAPE))
        self._lost = np.zeros(len(self._sights), dtype=np.int64)
        self._audible = frozenset().union(*(sight.audible_tags for sight in self._sights.values()))
        self.exchange.listen(self._audible)
        self._compute = time.monotonic() - started
        self._send_round()

    def _send_round(self) -> None:
        assert self._own is not None
        # Awaited first: what is sent may come back at once.
        if self._relayed:
            self._awaited = self._sights.keys() - self._bundles.keys()
        else:
            self._awaited = set(self._audible - self.exchange.kept(self._round).keys())
        ready = not self._awaited
        for (robot, sight), values in zip(self._sights.items(), self._own.messages, strict=True):
            data = payload.encode(values, self._policy.config.encoding)
            self._send(robot, Message(sight.episode, sight.tick, self._round, sight.own_tag, data))
        if ready:
            self._fuse()

    def _fuse(self) -> None:
        assert self._own is not None
        started = time.monotonic()
        heard = self._decoded()
        counts = np.array([len(messages) for messages in heard])
        audible = np.array([len(sight.audible_tags) for sight in self._sights.values()])
        self._lost = self._lost + np.maximum(audible - counts, 0)
        size = self._own.messages.shape[1]
        messages = np.zeros((len(heard), int(counts.max()), size), dtype=np.float32)
        for row, values in enumerate(heard):
            if values:
                messages[row, : len(values)] = values
        present = np.arange(messages.shape[1]) < counts[:, None]
        self._own = self._policy.hear(self._own, messages, present)
        self._round += 1
        self._bundles = {}
        self._compute += time.monotonic() - started
        if self._round < len(self._policy.config.message_sizes):
            self._send_round()
        else:
            self._decide()

    def _decoded(self) -> list[list[npt.NDArray[np.float32]]]:
        """What each robot has heard in this round; what cannot be used is dropped."""
        config = self._policy.config
        size = config.message_sizes[self._round]
        decoded: dict[bytes, npt.NDArray[np.float32] | str] = {}

        def usable(data: bytes) -> npt.NDArray[np.float32] | None:
            if data not in decoded:  # each message once, however many robots of this process hear it
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
        for robot, sight in self._sights.items():
            came = self._bundles.get(robot, []) if self._relayed else [kept[t] for t in sight.audible_tags if t in kept]
            result.append([x for x in map(usable, came) if x is not None])
        return result

    def _decide(self) -> None:
        assert self._own is not None
        started = time.monotonic()
        sights = list(self._sights.items())
        streams = np.array([sight.stream for _, sight in sights], dtype=np.uint64)
        decision: Decision = self._policy.decide(self._own, streams, sights[0][1].tick)
        self.missing += int(self._lost.sum())
        self._sights, self._own = {}, None
        share = (self._compute + time.monotonic() - started) / len(sights)
        logs = decision.log_probabilities
        for row, (robot, sight) in enumerate(sights):
            lost = int(self._lost[row])
            heard = max(len(sight.audible_tags) - lost, 0)
            self._answer(robot, Answer(sight, logs[row], int(decision.primitives[row]), heard, lost, share))
