# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Random numbers and orders of the operating system, which nobody can predict or repeat; free of ROS.

They are for what must not tell robots anything: tags, and orders of messages. Generators such as NumPy's PCG64 are
unfit for this: their state follows from some of their output (Bouillaguet et al., "Practical seed-recovery for the PCG
pseudo-random number generator", 2020), and with it everything that they draw later.
"""

import os
from array import array
from collections.abc import Iterable
from typing import TypeVar

T = TypeVar("T")


def random_tags(count: int) -> list[int]:
    """``count`` random numbers from 1 to 2**64 - 1, all different."""
    tags: dict[int, None] = {}  # not a set, whose order would depend on the values
    while len(tags) < count:
        tags |= dict.fromkeys(tag for tag in _uint64(count - len(tags)) if tag)
    return list(tags)


def shuffled(items: Iterable[T]) -> list[T]:
    """The items in random order."""
    items = list(items)
    keys = _uint64(len(items))
    return [items[place] for place in sorted(range(len(items)), key=keys.__getitem__)]


def _uint64(count: int) -> array:
    return array("Q", os.urandom(8 * count))
