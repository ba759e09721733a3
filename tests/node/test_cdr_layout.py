# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lengths in serialised messages are checked before the C library sees them."""

import array
from contextlib import suppress

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Empty

from magat_interfaces.msg import Deployment, Observation, PolicyFile, Preference, RobotStatus, World
from magat_node.cdr_layout import is_complete

MESSAGES = [
    Observation(audible_tags=array.array("Q", [1, 2]), field_of_view=array.array("B", bytes(363))),
    Preference(heard=3),
    World(robots=["a", "bob"], x=[1, 2], obstacles=array.array("B", bytes(7)), silent=[True, False], missing=[1]),
    RobotStatus(robots=["alice"], policy="MAGAT-F-128", last_drop="a reason"),
    Deployment(digest="d", files=[PolicyFile(name="a", data=array.array("B", bytes(5))), PolicyFile(name="bc")]),
    Empty(),
]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_what_is_complete_is_what_can_be_read(message, capfd):
    kind, data = type(message), serialize_message(message)
    assert is_complete(data, kind)
    assert is_complete(data + bytes(8), kind)
    for end in range(len(data)):
        if is_complete(data[:end], kind) and end > 4:
            assert deserialize_message(data[:end], kind) == message  # what was cut off is padding
    rng = np.random.default_rng(1)
    for _ in range(300):
        damaged = bytearray(data)
        for at in rng.integers(4, len(data), 3) if len(data) > 4 else ():
            damaged[at] = rng.integers(256)
        if is_complete(bytes(damaged), kind):
            with suppress(RuntimeError):
                deserialize_message(bytes(damaged), kind)
    assert "remaining buffer" not in capfd.readouterr().err


@pytest.mark.parametrize("data", [b"", b"\0\1", b"\0\1\0\0" + b"\xff" * 40, b"\0\7\0\0" + bytes(400), b"\xff" * 600])
def test_what_is_no_message_is_not_complete(data):
    assert not any(is_complete(data, type(message)) for message in MESSAGES if not isinstance(message, Empty))


def test_big_endian_lengths_are_read():
    assert is_complete(b"\0\0\0\0" + bytes(8) + bytes(4) + bytes(4), Deployment) is False
    assert is_complete(b"\0\0\0\0" + bytes(8) + b"\1" + bytes(3) + b"\0\0\0\1\0" + bytes(3) + bytes(4), Deployment)
