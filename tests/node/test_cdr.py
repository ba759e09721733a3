# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Serialised feature messages are those of the middleware, and damaged ones are detected."""

import array
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from magat_interfaces.msg import Feature, FeatureBundle
from magat_node import cdr

BIG_ENDIAN = b"\0\0\0\0"
HEADER, FEATURE, BUNDLE = 4, 32, 20
#: Bytes of a serialised Feature that only put the number after them on a multiple of its size.
PADDING = [HEADER + i for i in (13, 14, 15, 25, 26, 27)]


def whole(bits: int) -> st.SearchStrategy[int]:
    return st.one_of(st.integers(0, 2**bits - 1), st.sampled_from([0, 2**bits - 1]))


features = st.tuples(whole(64), whole(32), whole(8), whole(64), whole(8), st.binary(max_size=600))


@st.composite
def bundles(draw: st.DrawFn) -> tuple[int, int, int, int, list[bytes]]:
    size, count = draw(st.integers(0, 40)), draw(st.integers(0, 20))
    payloads = draw(st.lists(st.binary(min_size=size, max_size=size), min_size=count, max_size=count))
    return draw(whole(64)), draw(whole(32)), draw(whole(8)), draw(whole(8)), payloads


def feature_of(episode: int, tick: int, number: int, tag: int, encoding: int, payload: bytes) -> Feature:
    message = Feature(episode=episode, tick=tick, round=number, tag=tag, encoding=encoding)
    message.payload = array.array("B", payload)
    return message


def bundle_of(episode: int, tick: int, number: int, encoding: int, payloads: list[bytes]) -> FeatureBundle:
    message = FeatureBundle(episode=episode, tick=tick, round=number, encoding=encoding, messages=len(payloads))
    message.payloads = array.array("B", b"".join(payloads))
    return message


def without_padding(data: bytes) -> bytes:
    """The middleware leaves in there what was in memory."""
    return bytes(0 if i in PADDING else byte for i, byte in enumerate(data))


@given(fields=features)
def test_a_feature_is_written_as_the_middleware_writes_it(fields: tuple) -> None:
    data, message = cdr.pack_feature(*fields), feature_of(*fields)
    assert data == without_padding(serialize_message(message))
    assert deserialize_message(data, Feature) == message


@given(fields=bundles())
def test_a_bundle_is_written_as_the_middleware_writes_it(fields: tuple) -> None:
    data, message = cdr.pack_bundle(*fields), bundle_of(*fields)
    assert data == serialize_message(message)
    assert deserialize_message(data, FeatureBundle) == message


@given(fields=features)
def test_a_feature_is_read_as_the_middleware_wrote_it(fields: tuple) -> None:
    assert cdr.unpack_feature(serialize_message(feature_of(*fields))) == fields


@given(fields=bundles())
def test_a_bundle_is_read_as_the_middleware_wrote_it(fields: tuple) -> None:
    *head, payloads = fields
    read = cdr.unpack_bundle(serialize_message(bundle_of(*fields)))
    assert read == (*head, len(payloads), b"".join(payloads))
    assert read.split() == payloads


@pytest.mark.parametrize(("messages", "length"), [(2, 5), (7, 6), (0, 1)])
def test_a_bundle_that_cannot_be_split_says_why(messages: int, length: int) -> None:
    with pytest.raises(ValueError, match=f"{messages} messages with {length} bytes"):
        cdr.PackedBundle(1, 2, 3, 1, messages, bytes(length)).split()


def big_endian_feature(episode: int, tick: int, number: int, tag: int, encoding: int, payload: bytes) -> bytes:
    head = struct.pack(">QIB3xQB3xI", episode, tick, number, tag, encoding, len(payload))
    return BIG_ENDIAN + head + payload


def big_endian_bundle(episode: int, tick: int, number: int, encoding: int, messages: int, payloads: bytes) -> bytes:
    head = struct.pack(">QIBBHI", episode, tick, number, encoding, messages, len(payloads))
    return BIG_ENDIAN + head + payloads


@given(fields=features)
def test_a_feature_of_a_big_endian_machine_is_read_too(fields: tuple) -> None:
    assert cdr.unpack_feature(big_endian_feature(*fields)) == fields


@given(fields=bundles())
def test_a_bundle_of_a_big_endian_machine_is_read_too(fields: tuple) -> None:
    *head, payloads = fields
    expected = (*head, len(payloads), b"".join(payloads))
    assert cdr.unpack_bundle(big_endian_bundle(*expected)) == expected


@pytest.mark.parametrize("big", [False, True], ids=["little-endian", "big-endian"])
def test_what_is_cut_off_is_damaged_wherever_it_is_cut(big: bool, capfd: pytest.CaptureFixture) -> None:
    feature = (1, 2, 3, 4, 1, b"seven b")
    data = big_endian_feature(*feature) if big else cdr.pack_feature(*feature)
    assert len(data) == HEADER + FEATURE + 7
    assert [cdr.unpack_feature(data[:length]) for length in range(len(data))] == [None] * len(data)
    bundle = big_endian_bundle(1, 2, 3, 1, 3, b"abcdef") if big else cdr.pack_bundle(1, 2, 3, 1, [b"ab", b"cd", b"ef"])
    assert len(bundle) == HEADER + BUNDLE + 6
    assert [cdr.unpack_bundle(bundle[:length]) for length in range(len(bundle))] == [None] * len(bundle)
    capfd.readouterr()  # the middleware says so, too


def test_bytes_after_a_message_are_ignored() -> None:
    """Some middlewares fill up to a multiple of four bytes."""
    assert cdr.unpack_feature(cdr.pack_feature(1, 2, 3, 4, 1, b"abc") + b"\0").payload == b"abc"
    assert cdr.unpack_bundle(cdr.pack_bundle(1, 2, 3, 1, [b"abc"]) + b"\0\0").payloads == b"abc"


@pytest.mark.parametrize("big", [False, True], ids=["little-endian", "big-endian"])
@pytest.mark.parametrize(("messages", "length"), [(2, 5), (7, 6), (65535, 10), (0, 4)])
def test_a_bundle_whose_payloads_are_not_of_one_size_is_damaged(big: bool, messages: int, length: int) -> None:
    data = big_endian_bundle(1, 2, 3, 1, messages, bytes(length))
    if not big:
        data = serialize_message(FeatureBundle(messages=messages, payloads=array.array("B", bytes(length))))
    assert cdr.unpack_bundle(data) is None


def test_a_length_beyond_the_end_is_damage_and_takes_no_memory() -> None:
    for length in (1, 2**31, 2**32 - 1):
        data = cdr.pack_feature(1, 2, 3, 4, 1, b"")
        assert cdr.unpack_feature(data[:-4] + struct.pack("<I", length)) is None
        data = cdr.pack_bundle(1, 2, 3, 1, [])
        assert cdr.unpack_bundle(data[:-4] + struct.pack("<I", length)) is None


@given(data=st.one_of(st.binary(max_size=80), st.binary(max_size=80).map(BIG_ENDIAN.__add__)))
def test_any_bytes_are_a_message_or_damaged(data: bytes) -> None:
    for read, fields in ((cdr.unpack_feature(data), 6), (cdr.unpack_bundle(data), 6)):
        assert read is None or len(read) == fields


@pytest.mark.parametrize(("payload", "size"), [(512, 548), (256, 292), (132, 168)])
def test_a_feature_of_128_numbers_takes_so_many_bytes(payload: int, size: int) -> None:
    assert len(cdr.pack_feature(1, 2, 3, 4, 0, bytes(payload))) == size
