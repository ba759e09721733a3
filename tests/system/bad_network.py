# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Runs a program of the team behind a bad network: ``python -m bad_network FAULTS MODULE [ARGUMENT ...]``.

FAULTS is a JSON object, by the last part of a topic's name: what happens to the messages that this program's
subscriptions get. The nodes are the team's own; only what reaches their callbacks is changed.
"""

import dataclasses
import heapq
import json
import random
import runpy
import struct
import sys
import time
from collections.abc import Callable
from itertools import count
from typing import Any

from rclpy.node import Node

from magat_node import cdr

#: Between looks for messages whose delay is over, seconds.
PERIOD = 0.002


@dataclasses.dataclass(frozen=True)
class Faults:
    """Shares of all messages, 0 to 1, and seconds."""

    lost: float = 0.0
    repeated: float = 0.0
    #: Each waits for up to so long, drawn evenly: they overtake each other.
    delay: float = 0.0
    #: Of serialised Features only: bytes are missing, numbers are NaN, the payload has another size, or it is of
    #: another tick or episode.
    damaged: float = 0.0


def damaged(data: bytes, chance: random.Random) -> bytes:
    """A serialised Feature with one thing wrong."""
    feature = cdr.unpack_feature(data)
    assert feature is not None
    kind = chance.randrange(5)
    if kind == 0:
        return data[: chance.randrange(len(data))]
    if kind == 1:
        nan = struct.pack("<f", float("nan"))
        return cdr.pack_feature(*feature._replace(payload=nan * (len(feature.payload) // len(nan))))
    if kind == 2:
        return cdr.pack_feature(*feature._replace(payload=feature.payload[: chance.randrange(len(feature.payload))]))
    if kind == 3:
        return cdr.pack_feature(*feature._replace(tick=max(0, feature.tick - chance.randint(1, 3))))
    return cdr.pack_feature(*feature._replace(episode=chance.getrandbits(63)))


class BadLine:
    """In front of a subscription's callback."""

    def __init__(self, node: Node, callback: Callable[[Any], None], faults: Faults) -> None:
        self._callback, self._faults = callback, faults
        self._chance = random.Random()
        self._late: list[tuple[float, int, Any]] = []
        self._number = count()
        if faults.delay > 0:
            node.create_timer(PERIOD, self._deliver)

    def __call__(self, message: Any) -> None:
        chance, faults = self._chance, self._faults
        if chance.random() < faults.lost:
            return
        if chance.random() < faults.damaged:
            message = damaged(message, chance)
        for _ in range(2 if chance.random() < faults.repeated else 1):
            if faults.delay > 0:
                due = time.monotonic() + chance.uniform(0, faults.delay)
                heapq.heappush(self._late, (due, next(self._number), message))
            else:
                self._callback(message)

    def _deliver(self) -> None:
        while self._late and self._late[0][0] <= time.monotonic():
            self._callback(heapq.heappop(self._late)[2])


def install(faults: dict[str, Faults]) -> None:
    """From now on, subscriptions are made behind a bad network."""
    good = Node.create_subscription

    def bad(node: Node, kind: type, topic: str, callback: Callable[[Any], None], *args: Any, **options: Any) -> Any:
        found = faults.get(topic.rpartition("/")[2])
        return good(node, kind, topic, BadLine(node, callback, found) if found else callback, *args, **options)

    Node.create_subscription = bad


if __name__ == "__main__":
    install({topic: Faults(**values) for topic, values in json.loads(sys.argv[1]).items()})
    module = sys.argv[2]
    del sys.argv[1:3]
    runpy.run_module(module, run_name="__main__", alter_sys=True)
