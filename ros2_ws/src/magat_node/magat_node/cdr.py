# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Serialised Feature and FeatureBundle messages, read and written without rclpy's conversion.

With the direct radio, the N robots of a team receive N^2 Features in a round, and most are out of range. Reading the
tag from the serialised message takes a fraction of the time of creating a message object. The layout is CDR (OMG
DDSI-RTPS), little-endian: a header of four bytes, then the fields, each aligned to its size.
"""

import struct
from collections.abc import Iterable
from typing import Any, NamedTuple

from magat_node.cdr_layout import is_complete

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
#: episode, tick, round, tag, encoding, length of the payload.
_FEATURE = struct.Struct("<QIB3xQB3xI")
#: episode, tick, round, encoding, messages, length of the payloads.
_BUNDLE = struct.Struct("<QIBBHI")


class PackedFeature(NamedTuple):
    """The fields of a `Feature`."""

    episode: int
    tick: int
    round: int
    tag: int
    encoding: int
    payload: bytes


class PackedBundle(NamedTuple):
    """The fields of a `FeatureBundle`."""

    episode: int
    tick: int
    round: int
    encoding: int
    messages: int
    payloads: bytes

    def split(self) -> list[bytes]:
        """The payloads of its ``messages`` messages, all of one size.

        Raises:
            ValueError: the bytes cannot be divided by the number of messages. `unpack_bundle` returns no such bundle.
        """
        length = len(self.payloads)
        if not _divides(self.messages, length):
            raise ValueError(f"a bundle of {self.messages} messages with {length} bytes: they are not all of one size")
        size = length // max(self.messages, 1)
        return [self.payloads[size * i : size * (i + 1)] for i in range(self.messages)]


def pack_feature(episode: int, tick: int, number: int, tag: int, encoding: int, payload: bytes) -> bytes:
    """A serialised `Feature` of round ``number``."""
    return _LITTLE_ENDIAN + _FEATURE.pack(episode, tick, number, tag, encoding, len(payload)) + payload


def feature_bytes(payloads: Iterable[int]) -> int:
    """Total size of serialised `Feature` messages with payloads of the given sizes, bytes."""
    return sum(4 + _FEATURE.size + payload for payload in payloads)


def unpack_feature(data: bytes) -> PackedFeature | None:
    """The fields of a serialised `Feature`; None if it is damaged."""
    if data[:4] != _LITTLE_ENDIAN:  # another middleware on another kind of machine
        m = _message(data, "Feature")
        return m and PackedFeature(m.episode, m.tick, m.round, m.tag, m.encoding, bytes(m.payload))
    if len(data) < 4 + _FEATURE.size:
        return None
    episode, tick, number, tag, encoding, length = _FEATURE.unpack_from(data, 4)
    payload = data[4 + _FEATURE.size : 4 + _FEATURE.size + length]
    return PackedFeature(episode, tick, number, tag, encoding, payload) if len(payload) == length else None


def pack_bundle(episode: int, tick: int, number: int, encoding: int, payloads: list[bytes]) -> bytes:
    """A serialised `FeatureBundle` of round ``number``; the payloads are all of one size."""
    data = b"".join(payloads)
    return _LITTLE_ENDIAN + _BUNDLE.pack(episode, tick, number, encoding, len(payloads), len(data)) + data


def unpack_bundle(data: bytes) -> PackedBundle | None:
    """The fields of a serialised `FeatureBundle`; None if it is damaged."""
    if data[:4] != _LITTLE_ENDIAN:
        m = _message(data, "FeatureBundle")
        bundle = m and PackedBundle(m.episode, m.tick, m.round, m.encoding, m.messages, bytes(m.payloads))
    elif len(data) < 4 + _BUNDLE.size:
        return None
    else:
        episode, tick, number, encoding, messages, length = _BUNDLE.unpack_from(data, 4)
        payloads = data[4 + _BUNDLE.size : 4 + _BUNDLE.size + length]
        if len(payloads) != length:
            return None
        bundle = PackedBundle(episode, tick, number, encoding, messages, payloads)
    return None if bundle is None or not _divides(bundle.messages, len(bundle.payloads)) else bundle


def _divides(messages: int, length: int) -> bool:
    """Whether ``length`` bytes can be those of so many messages of one size."""
    return length % messages == 0 if messages else length == 0


def _message(data: bytes, kind: str) -> Any:
    # Imported here because evaluation, which runs without ROS, counts the bytes of messages.
    from rclpy.serialization import deserialize_message

    from magat_interfaces import msg

    message = getattr(msg, kind)
    if not is_complete(data, message):  # else the C library reports a wrong length on standard error
        return None
    try:
        return deserialize_message(data, message)
    except Exception:  # its type depends on the middleware
        return None
