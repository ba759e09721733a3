# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks the lengths in serialised messages, from the definitions of their types, before they are deserialised.

The layout is CDR (OMG DDSI-RTPS): a header of four bytes, then the fields, each aligned to its size. Free of rclpy.
"""

import importlib
import re
import struct
from functools import cache
from typing import Any, NamedTuple

#: Sizes of primitive fields, bytes.
_SIZES = {
    "boolean": 1, "octet": 1, "byte": 1, "char": 1, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2, "int32": 4,
    "uint32": 4, "int64": 8, "uint64": 8, "float": 4, "float32": 4, "double": 8, "float64": 8,
}  # fmt: skip
_SEQUENCE = re.compile(r"sequence<([^,>]+)(?:,.*)?>")
_ARRAY = re.compile(r"(.+)\[(\d+)\]")
_LENGTHS = (struct.Struct(">I"), struct.Struct("<I"))
_HEADER = 4


class _Field(NamedTuple):
    """A field of a message."""

    #: Bytes of one value; 0 if it varies: a string, or a message.
    size: int
    #: The fields of a message; None for a string.
    parts: "tuple[_Field, ...] | None"
    #: Number of values in an array; None in a sequence, whose length is in the data.
    values: int | None


def is_complete(data: bytes, kind: type) -> bool:
    """Whether ``data`` has a header, and every string and sequence of the message ``kind`` ends within it."""
    if len(data) < _HEADER or data[0] != 0 or data[1] > 1:  # of plain CDR, big-endian or little-endian
        return False
    at, fields = _split(kind)
    return at <= len(data) - _HEADER and (not fields or _end(data, at, fields, _LENGTHS[data[1]]) >= 0)


@cache
def _split(kind: type) -> tuple[int, tuple[_Field, ...]]:
    """Where the first fields of a message end, whose places are the same in every message, and the others."""
    at, fields = 0, _layout(kind)
    for number, (size, _, values) in enumerate(fields):
        if not size or values is None:
            return at, fields[number:]
        at = (at + size - 1) // size * size + size * values
    return at, ()


def _end(data: bytes, at: int, fields: tuple[_Field, ...], length: struct.Struct) -> int:
    """Where ``fields`` end that begin at ``at``; -1 if that is beyond the data. Places do not count the header."""
    size_of_data = len(data) - _HEADER
    for size, parts, values in fields:
        if values is None:
            at = (at + 3) & ~3
            if at + 4 > size_of_data:
                return -1
            (values,) = length.unpack_from(data, at + _HEADER)
            at += 4
            if values > size_of_data - at:  # a value has at least one byte
                return -1
        if size:
            if values:
                at = ((at + size - 1) & -size) + size * values
        else:
            for _ in range(values):
                at = _string_end(data, at, length) if parts is None else _end(data, at, parts, length)
                if at < 0:
                    return -1
        if at > size_of_data:
            return -1
    return at


def _string_end(data: bytes, at: int, length: struct.Struct) -> int:
    at = (at + 3) & ~3
    if at + 4 > len(data) - _HEADER:
        return -1
    (characters,) = length.unpack_from(data, at + _HEADER)
    at += 4 + characters
    return at if at <= len(data) - _HEADER else -1


@cache
def _layout(kind: Any) -> tuple[_Field, ...]:
    return tuple(_field(text) for text in kind.get_fields_and_field_types().values())


def _field(text: str) -> _Field:
    """The field of a type as `get_fields_and_field_types` writes it."""
    count: int | None = 1
    if match := _SEQUENCE.fullmatch(text):
        text, count = match[1], None
    elif match := _ARRAY.fullmatch(text):
        text, count = match[1], int(match[2])
    if text in _SIZES:
        return _Field(_SIZES[text], None, count)
    if text.startswith("string"):
        return _Field(0, None, count)
    package, _, name = text.partition("/")
    return _Field(0, _layout(getattr(importlib.import_module(f"{package}.msg"), name)), count)
