# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The relayed radio: the messages of a round, passed on to the robots in range. Free of ROS."""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from magat_node.unpredictable import shuffled


class Bundle(NamedTuple):
    """The messages that one robot hears in one round."""

    #: How the payloads are encoded.
    encoding: int
    #: All of one size.
    payloads: list[bytes]


class Relay:
    """The messages of one tick, round by round."""

    def __init__(self, tags: Sequence[int], hears: Sequence[Sequence[int]], present: Sequence[bool]) -> None:
        """Begin a tick.

        Args:
            tags: ``[N]`` the tag of each robot's messages.
            hears: for each of the N robots, the indices of the robots that it hears.
            present: ``[N]`` robots whose messages complete a round.
        """
        self.round = 0
        self._robot_of = {tag: robot for robot, tag in enumerate(tags)}
        self._hears = hears
        self._expected = {robot for robot, there in enumerate(present) if there}
        self._sent: dict[int, tuple[int, bytes]] = {}

    def receive(self, number: int, tag: int, encoding: int, payload: bytes) -> str | None:
        """Take the message of round ``number`` sent under ``tag``; returns None, or why it was dropped."""
        robot = self._robot_of.get(tag)
        if robot is None:
            return "a message under a tag that was not given out in this tick"
        if number != self.round:
            return f"a message of round {number}, while round {self.round} is under way"
        if robot in self._sent:
            return "a second message of one robot in one round"
        self._sent[robot] = encoding, payload
        return None

    @property
    def complete(self) -> bool:
        """Whether the messages of all present robots have come in this round."""
        return self._expected <= self._sent.keys()

    def bundles(self) -> list[Bundle]:
        """End the round: the messages that each of the N robots hears, in random order.

        A bundle has one encoding and one payload size. Payloads that differ from the majority are left out; the robots
        could not use them.
        """
        kinds = Counter((encoding, len(payload)) for encoding, payload in self._sent.values())
        common = max(kinds, key=kinds.__getitem__, default=(0, 0))
        good = {robot: data for robot, (encoding, data) in self._sent.items() if (encoding, len(data)) == common}
        self.round += 1
        self._sent = {}
        return [Bundle(common[0], shuffled(good[j] for j in hears if j in good)) for hears in self._hears]
