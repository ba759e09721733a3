"""What a robot's message looks like on the air: the encodings of feature vectors.

Whatever the encoding, what a receiver makes of a payload lies on the grid of `fixed_point`, so that its sums have no
order. `carried` says what becomes of a message on its way: simulations in one process put their messages through it.
"""

import numpy as np
import numpy.typing as npt

from magat_robot.policy.grids import EXPONENT_BITS

_STEPS = 255  # of the 8-bit encoding; features are never negative
_UNIT = 2.0**-EXPONENT_BITS

Values = npt.NDArray[np.float32]


class PayloadError(ValueError):
    """A payload that cannot be used; the message says why."""


def encode(values: Values, encoding: str) -> bytes:
    """``values`` ``[n]`` (see `LatentState.messages`) as bytes, little-endian.

    float32 and float16 are IEEE 754; int8 is the largest value as float32, then each value in 255ths of it, unsigned.
    """
    if encoding == "int8":
        scale, steps = _quantised(values[None])
        return scale.astype("<f4").tobytes() + steps.tobytes()
    return values.astype({"float32": "<f4", "float16": "<f2"}[encoding]).tobytes()


def decode(payload: bytes, size: int, encoding: str, most: float) -> Values:
    """What `encode` made of ``[size]`` values.

    Args:
        payload: as it came.
        size: how many values there are.
        encoding: by name.
        most: the largest value that makes sense.

    Raises:
        PayloadError: another number of bytes, or values off the grid or out of range (NaN is both).
    """
    wanted = encoded_bytes(size, encoding)
    if len(payload) != wanted:
        raise PayloadError(f"a payload of {len(payload)} bytes, not {wanted}: a robot with another policy or encoding?")
    if encoding == "int8":
        scale = np.frombuffer(payload, "<f4", count=1).astype(np.float32)
        # Written so that NaN fails, too.
        if not (scale >= 0.0).all() or not (scale <= most).all():
            raise PayloadError(f"a payload scaled by {scale[0]}, which is not from 0 to {most:g}")
        return _dequantised(scale, np.frombuffer(payload, np.uint8, offset=4)[None])[0]
    values = np.frombuffer(payload, {"float32": "<f4", "float16": "<f2"}[encoding]).astype(np.float32)
    inside = (values >= 0) & (values <= most)
    units = np.where(inside, values, 0) / _UNIT
    if not (inside & (units == np.rint(units))).all():
        raise PayloadError(f"a payload with values other than multiples of 1/{1 / _UNIT:g} from 0 to {most:g}")
    return values


def encoded_bytes(size: int, encoding: str) -> int:
    """Bytes of an encoded message of ``size`` values."""
    return {"float32": 4 * size, "float16": 2 * size, "int8": 4 + size}[encoding]


def carried(messages: Values, encoding: str) -> Values:
    """``messages`` ``[R, n]`` as their receivers decode them."""
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
