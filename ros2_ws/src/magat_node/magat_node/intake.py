# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The way of messages into a node: those that cannot be used are dropped, counted and logged, and do no other harm.

Every subscription takes serialised messages. A callback of rclpy gets deserialised ones, and a damaged message then
either ends the process, or is dropped without a count and with a line of the C library that names no node.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from magat_node.cdr_layout import is_complete
from magat_node.errors import UnusableMessageError
from magat_node.text import Throttle, shortened

#: Most characters of a reason in a log line.
_REASON = 200


class Intake:
    """Reads the messages of one topic for one node."""

    def __init__(
        self,
        node: Node,
        kind: type,
        topic: str,
        on_drop: Callable[[str], object] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start with nothing dropped.

        Args:
            node: whose logger names it.
            kind: of the messages.
            topic: its name, for log lines.
            on_drop: called with the reason for each dropped message.
            clock: the time, seconds.
        """
        self._log, self._kind, self._topic, self._on_drop = node.get_logger(), kind, topic, on_drop
        self._throttle = Throttle(clock)
        #: Messages dropped so far.
        self.dropped = 0

    def read(self, data: bytes) -> Any | None:
        """The message in ``data``; None if it is malformed, which is dropped."""
        # The C library would report a wrong length on standard error, each time.
        if is_complete(data, self._kind):
            try:
                return deserialize_message(data, self._kind)
            except Exception as error:  # its type depends on the middleware
                self.drop(f"it is malformed ({error})")
                return None
        self.drop(f"its {len(data)} bytes are no message of the type {self._kind.__name__}")
        return None

    def deliver(self, data: bytes, callback: Callable[[Any], object]) -> None:
        """Call ``callback`` with the message in ``data``. It may refuse it by an `UnusableMessageError`."""
        message = self.read(data)
        if message is not None:
            self.hand_over(message, callback)

    def hand_over(self, message: Any, callback: Callable[[Any], object]) -> None:
        """Call ``callback`` with ``message``, which is dropped if that raises an `UnusableMessageError`."""
        try:
            callback(message)
        except UnusableMessageError as error:
            self.drop(str(error))

    def drop(self, why: str) -> None:
        """Count a message that cannot be used; log it, unless one of this topic was logged a moment ago."""
        self.dropped += 1
        why = shortened(why, _REASON)
        if self._on_drop is not None:
            self._on_drop(why)
        if self._throttle.due():
            self._log.warning(f"dropped {self.dropped} messages on {self._topic} so far; the last one: {why}")


class PolledSubscription(NamedTuple):
    """A subscription of a node that no executor spins: its owner takes the messages, at half the cost of callbacks."""

    subscription: Subscription
    intake: Intake

    def take(self, callback: Callable[[Any], object]) -> None:
        """Call ``callback`` with each message that has arrived, as `Intake.deliver` does."""
        for data, _ in take_serialized(self.subscription):
            self.intake.deliver(data, callback)

    def take_serialized(self) -> list[bytes]:
        """The messages that have arrived."""
        return [data for data, _ in take_serialized(self.subscription)]


def take_serialized(subscription: Subscription) -> Iterator[tuple[bytes, dict[str, int]]]:
    """The messages that have arrived, for nodes that no executor spins: serialised, each with its times."""
    handle = subscription.handle
    with handle:
        while (taken := handle.take_message(subscription.msg_type, True)) is not None:
            yield taken
