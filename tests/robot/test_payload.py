# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The encodings of messages: exact or rounded as documented, and strict about invalid payloads."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from magat_robot.policy.config import ENCODINGS, PolicyConfig
from magat_robot.policy.payload import (
    PayloadError,
    bytes_per_tick,
    decode,
    encode,
    encoded_bytes,
    longest_payload,
    round_bytes,
    round_trip,
)

MOST = 8.0
#: Values of messages are multiples of 1/256.
UNIT = 2.0**-8
SUMS = 2048.0

seeds = st.integers(0, 2**32 - 1)


def messages(rng: np.random.Generator, rows: int, size: int, most: float = MOST, unit: float = UNIT) -> np.ndarray:
    """``[rows, size]`` float32 multiples of ``unit``: sparse rows, small rows, one of zeros, one with the largest."""
    values = rng.integers(0, int(most / unit) + 1, size=(rows, size)) * unit
    values *= rng.random((rows, size)) < rng.random((rows, 1))
    values = np.floor(values * rng.random((rows, 1)) / unit) * unit
    values[0] = 0
    values[-1, :1] = most
    return values.astype(np.float32)


@pytest.mark.parametrize("encoding", ENCODINGS)
@given(seed=seeds, rows=st.integers(1, 6), size=st.integers(0, 70), most=st.sampled_from([MOST, SUMS]))
def test_what_arrives_is_what_simulations_in_one_process_take_it_for(
    encoding: str, seed: int, rows: int, size: int, most: float
) -> None:
    sent = messages(np.random.default_rng(seed), rows, size, most)
    taken = round_trip(sent, encoding)
    assert (taken.dtype, taken.shape) == (np.float32, sent.shape)
    for row, expected in zip(sent, taken, strict=True):
        data = encode(row, encoding)
        assert len(data) == encoded_bytes(size, encoding)
        arrived = decode(data, size, encoding, most)
        assert (arrived.dtype, arrived.shape) == (np.float32, (size,))
        assert arrived.tobytes() == expected.tobytes()


@pytest.mark.parametrize("encoding", ENCODINGS)
@given(seed=seeds, most=st.sampled_from([MOST, SUMS]))
def test_what_arrives_lies_on_the_grid_and_within_its_range(encoding: str, seed: int, most: float) -> None:
    """Sums are exact only for multiples of the unit."""
    taken = round_trip(messages(np.random.default_rng(seed), 5, 40, most), encoding)
    assert (taken / UNIT == np.rint(taken / UNIT)).all()
    assert ((taken >= 0) & (taken <= most)).all()


@pytest.mark.parametrize("encoding", ENCODINGS)
@given(seed=seeds)
def test_what_has_travelled_once_travels_on_unchanged(encoding: str, seed: int) -> None:
    once = round_trip(messages(np.random.default_rng(seed), 5, 40), encoding)
    again = round_trip(once, encoding)
    # int8 rounds its steps to the unit each time: half a unit for each rounding.
    assert np.abs(again - once).max() <= (UNIT if encoding == "int8" else 0)


@pytest.mark.parametrize("encoding", ["float32", "float16"])
@pytest.mark.parametrize("unit", [2.0**-6, UNIT], ids=["features", "later rounds"])
def test_every_number_of_a_message_survives_float32_and_float16(encoding: str, unit: float) -> None:
    every = (np.arange(int(MOST / unit) + 1) * unit).astype(np.float32)
    assert every[-1] == MOST
    assert decode(encode(every, encoding), every.size, encoding, MOST).tobytes() == every.tobytes()
    assert round_trip(every[None], encoding).tobytes() == every.tobytes()


def test_sums_over_neighbours_lose_in_float16_what_its_mantissa_cannot_hold() -> None:
    every = (np.arange(int(SUMS / UNIT) + 1) * UNIT).astype(np.float32)
    taken = round_trip(every[None], "float16")[0]
    assert np.abs(taken - every).max() <= 2.0**-1  # half the spacing of float16 at 2048
    assert (np.abs(taken - every) <= every * 2.0**-11).all()
    assert round_trip(every[None], "float32").tobytes() == every.tobytes()


@given(seed=seeds, most=st.sampled_from([MOST, SUMS]))
def test_eight_bits_are_off_by_half_a_step_at_most(seed: int, most: float) -> None:
    sent = messages(np.random.default_rng(seed), 6, 50, most)
    step = sent.max(axis=1, keepdims=True) / 255
    # Half a step, plus half a unit because the result is rounded to the unit.
    assert (np.abs(round_trip(sent, "int8") - sent) <= step / 2 * 1.0001 + UNIT / 2).all()


def test_eight_bits_keep_zeros_and_the_largest_number() -> None:
    sent = messages(np.random.default_rng(3), 20, 30)
    taken = round_trip(sent, "int8")
    assert (taken[sent == 0] == 0).all()
    largest = sent == sent.max(axis=1, keepdims=True)
    assert (taken[largest] == sent[largest]).all()


def test_eight_bits_make_a_difference() -> None:
    """Otherwise the tests could not tell whether int8 is used at all."""
    sent = messages(np.random.default_rng(3), 20, 30)
    assert (round_trip(sent, "int8") != sent).mean() > 0.2


def test_a_row_does_not_depend_on_its_company() -> None:
    sent = messages(np.random.default_rng(4), 40, 100)
    for encoding in ENCODINGS:
        whole = round_trip(sent, encoding)
        for row, taken in zip(sent, whole, strict=True):
            assert round_trip(row[None], encoding).tobytes() == taken.tobytes()
        assert round_trip(sent[::-3], encoding).tobytes() == whole[::-3].tobytes()


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_encoding_changes_no_message_in_place(encoding: str) -> None:
    sent = messages(np.random.default_rng(5), 3, 9)
    before = sent.copy()
    encode(sent[1], encoding)
    round_trip(sent, encoding)
    assert sent.tobytes() == before.tobytes()


@pytest.mark.parametrize(
    ("encoding", "data"),
    [
        ("float32", "0000003f 00000041"),
        ("float16", "0038 0048"),
        ("int8", "00000041 10 ff"),
    ],
)
def test_the_bytes_are_those_of_the_page(encoding: str, data: str) -> None:
    """Little-endian IEEE 754; int8: the largest number as float32, then values in 255ths of it."""
    assert encode(np.array([0.5, 8.0], np.float32), encoding).hex() == data.replace(" ", "")


@pytest.mark.parametrize(("encoding", "size"), [("float32", 512), ("float16", 256), ("int8", 132)])
def test_128_features_take_so_many_bytes(encoding: str, size: int) -> None:
    assert encoded_bytes(128, encoding) == size == len(encode(np.zeros(128, np.float32), encoding))


@pytest.mark.parametrize(("encoding", "rounds"), [("float32", [32, 128]), ("float16", [16, 64]), ("int8", [12, 36])])
def test_sizes_of_a_policys_messages_depend_on_the_encoding(encoding: str, rounds: list[int]) -> None:
    config = PolicyConfig("MAGAT-F-8-P3", taps=3)  # sends 8 numbers, then 8 + 3 * 8
    assert round_bytes(config, encoding) == rounds
    assert bytes_per_tick(config, encoding) == sum(rounds)
    assert longest_payload(config, encoding) == rounds[1]


def floats(dtype: str) -> Callable[..., bytes]:
    return lambda *values: np.array(values, dtype).tobytes()


@pytest.mark.parametrize(("encoding", "payload"), [("float32", floats("<f4")), ("float16", floats("<f2"))])
@pytest.mark.parametrize(
    ("values", "why"),
    [
        pytest.param([0, 1], "bytes, not", id="too short"),
        pytest.param([0, 1, 2, 3], "bytes, not", id="too long"),
        pytest.param([], "bytes, not", id="empty"),
        pytest.param([0, np.nan, 1], "other than multiples of 1/256 from 0 to 8", id="nan"),
        pytest.param([0, np.inf, 1], "other than multiples", id="infinity"),
        pytest.param([-np.inf, 0, 1], "other than multiples", id="minus infinity"),
        pytest.param([0, 1, -0.015625], "other than multiples", id="below"),
        pytest.param([8.015625, 1, 1], "other than multiples", id="above"),
        pytest.param([0.01, 1, 1], "other than multiples", id="off the grid"),
        pytest.param([UNIT / 2, 1, 1], "other than multiples", id="half a unit"),
        pytest.param([6e-8, 1, 1], "other than multiples", id="next to nothing"),
    ],
)
def test_numbers_that_no_robot_sends_are_refused(
    encoding: str, payload: Callable[..., bytes], values: list[float], why: str
) -> None:
    with pytest.raises(PayloadError, match=why):
        decode(payload(*values), 3, encoding, MOST)
    assert decode(payload(0, UNIT, 8), 3, encoding, MOST).tolist() == [0, UNIT, 8]


@pytest.mark.parametrize("scale", [np.nan, np.inf, -np.inf, -1.0, -1e-30, 8.001, 1e30], ids=str)
def test_a_scale_that_no_robot_sends_is_refused(scale: float) -> None:
    with pytest.raises(PayloadError, match="not from 0 to 8"):
        decode(np.array([scale], "<f4").tobytes() + b"\1\2\3", 3, "int8", MOST)


@given(scale=st.floats(0, 8, width=32), steps=st.binary(min_size=3, max_size=3))
def test_any_scale_within_the_range_makes_numbers_on_the_grid(scale: float, steps: bytes) -> None:
    """The scale itself need not be a multiple of the unit."""
    values = decode(np.array([scale], "<f4").tobytes() + steps, 3, "int8", MOST)
    assert (values / UNIT == np.rint(values / UNIT)).all()
    assert ((values >= 0) & (values <= MOST)).all()


@pytest.mark.parametrize("size", [0, 3, 6, 8])
def test_eight_bits_of_another_size_are_refused(size: int) -> None:
    with pytest.raises(PayloadError, match=f"{size} bytes, not 7"):
        decode(bytes(size), 3, "int8", MOST)


@pytest.mark.parametrize("encoding", ENCODINGS)
@given(data=st.binary(max_size=40), size=st.integers(0, 9))
def test_damaged_bytes_are_refused_or_make_a_message(encoding: str, data: bytes, size: int) -> None:
    try:
        values = decode(data, size, encoding, MOST)
    except PayloadError:
        return
    assert values.shape == (size,)
    assert ((values >= 0) & (values <= MOST) & (values / UNIT == np.rint(values / UNIT))).all()
