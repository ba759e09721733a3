"""The simulator as the radio's medium: what robots send in a round, handed to each that is in range. Free of ROS."""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class Bundle(NamedTuple):
    """What one robot hears in one round."""

    #: How the payloads are encoded.
    encoding: int
    #: All of one size.
    payloads: list[bytes]


class Relay:
    """One tick's messages, round by round."""

    def __init__(self, tags: Sequence[int], hears: Sequence[Sequence[int]], present: Sequence[bool]) -> None:
        """Begin a tick.

        Args:
            tags: ``[N]`` what each robot sends under.
            hears: for each of the N robots, the numbers of the robots that it hears.
            present: ``[N]`` whose messages are waited for.
        """
        self.round = 0
        self._robot_of = {tag: robot for robot, tag in enumerate(tags)}
        self._hears = hears
        self._expected = {robot for robot, there in enumerate(present) if there}
        self._sent: dict[int, tuple[int, bytes]] = {}

    def receive(self, number: int, tag: int, encoding: int, payload: bytes) -> str | None:
        """Take the message of round ``number`` sent under ``tag``; None, or why it was dropped."""
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
        """Everybody's message of the round is there."""
        return self._expected <= self._sent.keys()

    def bundles(self, shuffle: np.random.Generator) -> list[Bundle]:
        """End the round: for each of the N robots what it hears, in random order.

        Payloads of another encoding or size than most have are left out: a bundle has one of each, and they would be of
        no use anyway.
        """
        kinds = Counter((encoding, len(payload)) for encoding, payload in self._sent.values())
        common = max(kinds, key=kinds.__getitem__, default=(0, 0))
        good = {robot: data for robot, (encoding, data) in self._sent.items() if (encoding, len(data)) == common}
        self.round += 1
        self._sent = {}
        heard = [shuffle.permutation([j for j in hears if j in good]) for hears in self._hears]
        return [Bundle(common[0], [good[j] for j in order]) for order in heard]
