# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tags and orders that tell nothing."""

import itertools

import numpy as np

from magat_node import unpredictable
from magat_node.unpredictable import random_tags, shuffled


def test_tags_are_all_different_and_fill_64_bits() -> None:
    tags = random_tags(5000)
    assert len(set(tags)) == 5000
    # None of 5,000 lies in a given 128th of the range once in 10^17 runs.
    assert 0 < min(tags) < 2**57
    assert 2**64 - 2**57 < max(tags) < 2**64


def test_tags_that_come_twice_or_are_zero_are_drawn_again(monkeypatch) -> None:
    values = iter([5, 0, 5, 9, 7, 7, 3])
    monkeypatch.setattr(
        unpredictable.os, "urandom", lambda size: b"".join(next(values).to_bytes(8, "little") for _ in range(size // 8))
    )
    assert random_tags(4) == [5, 9, 7, 3]


def test_the_place_of_a_tag_tells_no_bit_of_it() -> None:
    """The order of a Python set would."""
    drawn = np.array([random_tags(10) for _ in range(2000)], dtype=np.uint64)
    bits = (drawn[:, :, None] >> np.arange(64, dtype=np.uint64)) & np.uint64(1)
    # 640 means of 2,000 fair bits, each with standard deviation 0.0112: one beyond 0.067 in a million runs.
    assert abs(bits.mean(axis=0) - 0.5).max() < 0.067


def test_every_order_is_as_likely_as_every_other() -> None:
    counts = dict.fromkeys(itertools.permutations("abcd"), 0)
    for _ in range(4800):
        counts[tuple(shuffled("abcd"))] += 1
    chi_squared = sum((count - 200) ** 2 / 200 for count in counts.values())
    assert chi_squared < 80  # 23 degrees of freedom: beyond 80 in 3 of 100 million runs


def test_any_items_are_shuffled_once_each() -> None:
    assert shuffled([]) == []
    assert sorted(shuffled(i % 3 for i in range(9))) == [0, 0, 0, 1, 1, 1, 2, 2, 2]
