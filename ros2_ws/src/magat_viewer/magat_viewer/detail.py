# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the chosen robot saw, received and decided in one tick. Free of ROS.

The sums of a deployed policy do not depend on their order. So the page can compute again, to the last bit, what a robot
computed from its observation and the messages that it received, and there are two ways to know these messages:

- From the world. The message of each neighbour follows from the neighbour's observation, which follows from the map. If
  the World message says that the robot received all messages in range, and its action is the one that it would draw
  then, the page needs no further messages, and costs the team nothing.
- From the robots' features and preferences, otherwise. Messages carry no sender, but the page knows the message that
  each neighbour must have sent. Two neighbours that sent the same message got the same attention.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from magat_robot.policy import payload
from magat_robot.policy.computed import ComputedPolicy
from magat_robot.policy.config import ENCODINGS
from magat_robot.policy.interface import LatentState
from magat_sim.field_of_view import Uint8Array, field_of_view, pad
from magat_sim.grid import BoolArray, IntArray
from magat_sim.radio import neighbours

#: Why attention is not known yet: only the robots' own messages tell which messages the robot received.
RECEIVED_UNKNOWN = "the page does not know yet which messages the robot received"
#: Why there is no attention of a silent robot.
SILENT = "the robot did not answer in time"


@dataclass(frozen=True)
class TeamSnapshot:
    """The team at the start of a tick. N robots."""

    tick: int
    #: ``[N, 2]`` cells ``(x, y)``.
    positions: IntArray
    #: ``[N, 2]`` cells ``(x, y)``.
    goals: IntArray
    #: ``[H, W]`` bool; None if it is not known.
    obstacles: BoolArray | None

    def fields_of_view(self, robots: Sequence[int]) -> Uint8Array:
        """``[len(robots), 3, 11, 11]`` the fields of view of ``robots``.

        Raises:
            ValueError: the obstacles are not known.
        """
        if self.obstacles is None:
            raise ValueError("the obstacles are not known: there is no field of view without them")
        occupied = np.zeros(self.obstacles.shape, dtype=np.uint8)
        occupied[self.positions[:, 1], self.positions[:, 0]] = 1
        chosen = np.asarray(robots, dtype=np.int64)
        world = np.zeros(len(chosen), dtype=np.int64)
        grids = pad(self.obstacles[None], 1), pad(occupied[None], 0)
        return field_of_view(*grids, world, self.positions[chosen], self.goals[chosen])


@dataclass(frozen=True)
class TickOutcome:
    """What the World message after a tick says of one robot."""

    silent: bool
    #: Messages in range that it did not receive.
    missing: int
    #: The primitive that it drew.
    action: int


@dataclass(frozen=True)
class RobotTick:
    """The messages to and from one robot in one tick, as far as they are known."""

    #: ``[3, 11, 11]`` uint8.
    field_of_view: Uint8Array
    #: Number of messages that it could receive in each round.
    audible: int
    #: Its random stream, from the observation.
    stream: int
    #: The messages of the first round, in any order; None if not all of them are known.
    payloads: Sequence[bytes] | None
    #: Their encoding; that of the policy is assumed if it is none of `ENCODINGS`.
    encoding: str
    #: Its `Preference`; None if it was silent, or the page did not subscribe to preferences.
    preference: Any = None
    #: Used where there is no preference; None if it is not known.
    outcome: TickOutcome | None = None


@dataclass(frozen=True)
class Neighbour:
    """A robot in range of the chosen one."""

    robot: int
    #: By head, in the first round; None if the chosen robot did not receive its message, or that is not known.
    attention: list[float] | None


@dataclass(frozen=True)
class RobotDetail:
    """All that the page shows of the chosen robot. The browser gets it as JSON, with the same names."""

    robot: int
    tick: int
    #: For each channel 121 digits, row by row from the lowest y.
    field_of_view: list[str]
    #: Of the five primitives; None if they are not known.
    probabilities: list[float] | None
    #: The primitive that it drew; None if that is not known.
    action: int | None
    #: Messages that it could receive and did receive (None if that is not known).
    audible: int
    heard: int | None
    neighbours: list[Neighbour]
    #: Why there is no attention; empty if there is.
    no_attention: str


@dataclass(frozen=True)
class _Decision:
    """What is known of a robot's decision."""

    no_attention: str
    probabilities: list[float] | None = None
    action: int | None = None
    heard: int | None = None
    #: By neighbour, then by head.
    attention: dict[int, list[float]] = field(default_factory=dict)


def robot_detail(robot: int, snapshot: TeamSnapshot, messages: RobotTick, policy: ComputedPolicy | str) -> RobotDetail:
    """What the page shows of ``robot``.

    Args:
        robot: its number.
        snapshot: the team at the start of the tick.
        messages: to and from the robot.
        policy: of the robot, or the reason why it is not known.
    """
    in_range = _in_range(robot, snapshot.positions)
    if messages.preference is None and messages.outcome is not None:
        decision = _from_world(snapshot, in_range, messages, messages.outcome, policy)
    else:
        decision = _from_messages(snapshot, in_range, messages, policy)
    return RobotDetail(
        robot=robot,
        tick=snapshot.tick,
        field_of_view=["".join(map(str, channel.ravel().tolist())) for channel in messages.field_of_view],
        probabilities=decision.probabilities,
        action=decision.action,
        audible=messages.audible,
        heard=decision.heard,
        neighbours=[Neighbour(other, decision.attention.get(other)) for other in in_range],
        no_attention=decision.no_attention,
    )


def _from_world(
    snapshot: TeamSnapshot, in_range: list[int], messages: RobotTick, outcome: TickOutcome, policy: ComputedPolicy | str
) -> _Decision:
    """The decision of a robot that received all messages in range, in a tick of one round; otherwise almost nothing."""
    if outcome.silent:
        return _Decision(SILENT)
    if reason := _not_computable(snapshot, policy):
        return _Decision(reason, action=outcome.action)
    assert not isinstance(policy, str)
    unknown = _Decision(RECEIVED_UNKNOWN, action=outcome.action)
    remembers = policy.config.visit_memory > 0  # what it remembers is not in this tick's messages
    if policy.rounds > 1 or remembers or outcome.missing or messages.audible != len(in_range):
        return unknown
    latent = policy.perceive(messages.field_of_view[None])
    received = payload.round_trip(_sent(snapshot, in_range, policy), _encoding(messages, policy))
    attention = _by_neighbour(policy, latent, received, in_range)
    latent = policy.hear(latent, received[None], np.ones((1, len(received)), dtype=bool))
    decision = policy.decide(latent, np.array([messages.stream], dtype=np.uint64), snapshot.tick)
    if decision.primitives[0] != outcome.action:
        return unknown
    probabilities = _probabilities(decision.log_probabilities[0])
    return _Decision(_no_attention(policy), probabilities, outcome.action, messages.audible, attention)


def _from_messages(
    snapshot: TeamSnapshot, in_range: list[int], messages: RobotTick, policy: ComputedPolicy | str
) -> _Decision:
    """The decision of a robot by its own preference, and its attention by the messages that it received."""
    attention, no_attention = _attention(snapshot, in_range, messages, policy)
    preference = messages.preference
    if preference is None:
        return _Decision(no_attention, attention=attention)
    probabilities = _probabilities(preference.log_probabilities)
    return _Decision(no_attention, probabilities, int(preference.primitive), int(preference.heard), attention)


def _attention(
    snapshot: TeamSnapshot, in_range: list[int], messages: RobotTick, policy: ComputedPolicy | str
) -> tuple[dict[int, list[float]], str]:
    """Attention by neighbour and head, and why there is none (empty if there is)."""
    if reason := _not_computable(snapshot, policy):
        return {}, reason
    assert not isinstance(policy, str)
    if not policy.config.communicates:
        return {}, _no_attention(policy)
    nothing_received = messages.payloads is not None and not messages.payloads
    if not in_range or not messages.audible or nothing_received:
        return {}, ""
    if messages.payloads is None:
        return {}, SILENT if messages.preference is None else RECEIVED_UNKNOWN
    encoding, sent = _encoding(messages, policy), _sent(snapshot, in_range, policy)
    remaining, places = Counter(messages.payloads), []
    for place, values in enumerate(sent):
        data = payload.encode(values, encoding)
        if remaining[data] > 0:
            remaining[data] -= 1
            places.append(place)
    if remaining.total():
        return {}, f"the robot received messages that {policy.config.name} does not send: is it the robots' policy?"
    received = payload.round_trip(sent[places], encoding)
    latent = policy.perceive(messages.field_of_view[None])
    return _by_neighbour(policy, latent, received, [in_range[place] for place in places]), ""


def _by_neighbour(
    policy: ComputedPolicy, latent: LatentState, received: npt.NDArray[np.float32], senders: list[int]
) -> dict[int, list[float]]:
    """The attention to the messages ``received`` (``[M, n]``) from ``senders``, by sender and head."""
    if not policy.config.communicates:
        return {}
    weights = policy.attention(latent, received[None], np.ones((1, len(received)), dtype=bool))[0]
    return {sender: weights[:, place].round(4).tolist() for place, sender in enumerate(senders)}


def _not_computable(snapshot: TeamSnapshot, policy: ComputedPolicy | str) -> str:
    """Why nothing can be computed; empty if it can."""
    if isinstance(policy, str):
        return policy
    return "" if snapshot.obstacles is not None else "the map is not known until the next episode starts"


def _no_attention(policy: ComputedPolicy) -> str:
    """Why there is no attention with this policy; empty if there is."""
    return "" if policy.config.communicates else f"robots with {policy.config.name} and K = 1 do not communicate"


def _encoding(messages: RobotTick, policy: ComputedPolicy) -> str:
    return messages.encoding if messages.encoding in ENCODINGS else policy.config.encoding


def _sent(snapshot: TeamSnapshot, robots: list[int], policy: ComputedPolicy) -> npt.NDArray[np.float32]:
    """``[len(robots), n]`` what ``robots`` sent in the first round, before it was encoded."""
    return policy.perceive(snapshot.fields_of_view(robots)).messages


def _probabilities(log_probabilities: Any) -> list[float]:
    """Probabilities from 0 to 1, even if a robot sends NaN or infinities, which JSON does not have."""
    values = np.minimum(np.asarray(log_probabilities, dtype=np.float64), 0.0)
    return np.nan_to_num(np.exp(values)).round(4).tolist()


def _in_range(robot: int, positions: IntArray) -> list[int]:
    row = neighbours(np.zeros(len(positions), dtype=np.int64), positions)[robot]
    return row[row >= 0].tolist()
