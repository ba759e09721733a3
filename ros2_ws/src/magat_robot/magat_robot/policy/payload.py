# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The encodings of messages: feature vectors as bytes, and back.

In every encoding, decoded values are multiples of the unit of `fixed_point`, so that sums over them are exact and do
not depend on their order. Encoding may round values; simulations in one process apply the same rounding to their
messages by `round_trip`.
"""

import numpy as np
import numpy.typing as npt

from magat_robot.policy.config import PolicyConfig
from magat_robot.policy.grids import EXPONENT_BITS

_STEPS = 255  # of int8, which is unsigned: features are never negative
_UNIT = 2.0**-EXPONENT_BITS

Values = npt.NDArray[np.float32]


class PayloadError(ValueError):
    """A payload that is no valid message of this policy; the text says why."""


def encode(values: Values, encoding: str) -> bytes:
    """Encode a message ``[n]`` (a row of `LatentState.messages`) as bytes, little-endian.

    float32 and float16 are IEEE 754. int8 is the largest value as float32, followed by each value in 255ths of the
    largest, one unsigned byte each.
    """
    if encoding == "int8":
        scale, steps = _quantised(values[None])
        return scale.astype("<f4").tobytes() + steps.tobytes()
    return values.astype({"float32": "<f4", "float16": "<f2"}[encoding]).tobytes()


def decode(payload: bytes, size: int, encoding: str, most: float) -> Values:
    """Decode a received payload: ``[size]`` float32.

    Args:
        payload: the bytes.
        size: number of values.
        encoding: name of the encoding.
        most: the largest valid value, `PolicyConfig.largest`.

    Raises:
        PayloadError: the number of bytes is wrong, or a value is NaN, out of range or no multiple of the unit.
    """
    wanted = encoded_bytes(size, encoding)
    if len(payload) != wanted:
        raise PayloadError(
            f"a payload of {len(payload)} bytes, not {wanted}: does its sender use another policy or encoding?"
        )
    if encoding == "int8":
        scale = np.frombuffer(payload, "<f4", count=1).astype(np.float32)
        # In this form NaN is refused, too.
        if not (scale >= 0.0).all() or not (scale <= most).all():
            raise PayloadError(f"a payload with the largest value {scale[0]}, which is not from 0 to {most:g}")
        return _dequantised(scale, np.frombuffer(payload, np.uint8, offset=4)[None])[0]
    values = np.frombuffer(payload, {"float32": "<f4", "float16": "<f2"}[encoding]).astype(np.float32)
    inside = (values >= 0) & (values <= most)
    units = np.where(inside, values, 0) / _UNIT
    if not (inside & (units == np.rint(units))).all():
        raise PayloadError(f"a payload with values other than multiples of 1/{1 / _UNIT:g} from 0 to {most:g}")
    return values


def encoded_bytes(size: int, encoding: str) -> int:
    """Bytes of a message of ``size`` values in an encoding."""
    return {"float32": 4 * size, "float16": 2 * size, "int8": 4 + size}[encoding]


def round_bytes(config: PolicyConfig, encoding: str) -> list[int]:
    """Bytes of a robot's payload in each round of a tick."""
    return [encoded_bytes(size, encoding) for size in config.message_sizes]


def bytes_per_tick(config: PolicyConfig, encoding: str) -> int:
    """Bytes of a robot's payloads in a tick, all rounds together, without the headers of the messages."""
    return sum(round_bytes(config, encoding))


def longest_payload(config: PolicyConfig, encoding: str) -> int:
    """Bytes of the longest payload that a robot sends in a tick."""
    return max(round_bytes(config, encoding))


def round_trip(messages: Values, encoding: str) -> Values:
    """``messages`` ``[R, n]`` encoded and decoded again: the values that their receivers get."""
    if encoding == "int8":
        return _dequantised(*_quantised(messages))
    return messages.astype(np.float16).astype(np.float32) if encoding == "float16" else messages


def _quantised(values: Values) -> tuple[Values, npt.NDArray[np.uint8]]:
    scale = values.max(axis=1, initial=0.0)
    steps = np.rint(values / np.maximum(scale, _UNIT)[:, None] * np.float32(_STEPS))
    return scale, steps.astype(np.uint8)


def _dequantised(scale: Values, steps: npt.NDArray[np.uint8]) -> Values:
    values = steps * (scale[:, None] / np.float32(_STEPS))
    return (np.rint(values / np.float32(_UNIT)) * np.float32(_UNIT)).astype(np.float32)
