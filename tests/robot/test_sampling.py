# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The random numbers of robots, and the weighted choices by them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from magat_robot.policy.sampling import choose, uniform

MASK = 2**64 - 1
streams = st.integers(0, MASK)


def splitmix(seed: int, tick: int) -> float:
    """SplitMix64 in Python integers: the output after ``tick + 1`` steps, scaled to [0, 1)."""
    z = (seed + (tick + 1) * 0x9E3779B97F4A7C15) & MASK
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    return ((z ^ (z >> 31)) >> 11) / 2**53


@given(st.lists(streams, min_size=1, max_size=20), st.integers(0, 10**9))
def test_draws_are_splitmix_numbers_one_by_one_or_together(seeds: list[int], tick: int) -> None:
    together = uniform(np.array(seeds, dtype=np.uint64), tick)
    assert together.dtype == np.float64
    assert ((together >= 0) & (together < 1)).all()
    assert together.tolist() == [splitmix(seed, tick) for seed in seeds]
    assert together.tolist() == [float(uniform(np.array([seed], dtype=np.uint64), tick)[0]) for seed in seeds]


def test_splitmix_gives_the_published_numbers() -> None:
    # First outputs of the authors' generator with the seed 1234567.
    published = [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431]
    stream = np.array([1234567], dtype=np.uint64)
    assert [int(uniform(stream, tick)[0] * 2**53) for tick in range(4)] == [value >> 11 for value in published]


def test_streams_and_ticks_draw_numbers_of_their_own() -> None:
    draws = np.stack([uniform(np.arange(200, dtype=np.uint64), tick) for tick in range(200)])
    assert len(np.unique(draws)) == draws.size


@pytest.mark.parametrize("along", ["streams", "ticks"])
def test_draws_are_spread_evenly(along: str) -> None:
    if along == "streams":
        draws = uniform(np.arange(20_000, dtype=np.uint64), 5)
    else:
        draws = np.concatenate([uniform(np.array([77], dtype=np.uint64), tick) for tick in range(20_000)])
    counts = np.histogram(draws, bins=100, range=(0, 1))[0]
    # Chi-square with 99 degrees of freedom exceeds 160 with probability 1e-4.
    assert ((counts - 200) ** 2 / 200).sum() < 160
    assert abs(np.corrcoef(draws[:-1], draws[1:])[0, 1]) < 0.03


@given(
    st.lists(st.lists(st.integers(0, 2**24), min_size=5, max_size=5).filter(any), min_size=1, max_size=8),
    st.data(),
)
def test_an_alternative_is_chosen_for_its_share_of_the_draws(rows: list[list[int]], data: st.DataObject) -> None:
    draws = [data.draw(st.integers(0, 2**53 - 1)) / 2**53 for _ in rows]
    chosen = choose(np.array(rows, dtype=np.float64), np.array(draws))
    assert chosen.dtype == np.int64
    for row, draw, choice in zip(rows, draws, chosen.tolist(), strict=True):
        assert 0 <= choice < 5
        assert row[choice] > 0
        ticket = int(draw * 2**53) * sum(row) >> 53  # index of the unit of weight that is drawn
        assert sum(row[:choice]) <= ticket < sum(row[: choice + 1])


@pytest.mark.parametrize(("draw", "expected"), [(0.0, 1), (0.5 - 2**-53, 1), (0.5, 3), (1 - 2**-53, 3)])
def test_draws_at_the_edges_never_choose_a_weight_of_zero(draw: float, expected: int) -> None:
    for unit in (1.0, 2.0**24, 2.0**40):
        weights = np.array([[0, unit, 0, unit, 0]])
        assert choose(weights, np.array([draw])).tolist() == [expected]


def test_a_single_unit_among_many_can_be_chosen() -> None:
    weights = np.array([[0.0, 2.0**24, 1.0, 0.0, 0.0]])
    assert choose(weights, np.array([1 - 2**-53])).tolist() == [2]


def test_choices_come_as_often_as_their_weights_say() -> None:
    weights = np.array([3.0, 0.0, 1.0, 5.0, 1.0])
    chosen = choose(np.tile(weights, (20_000, 1)), uniform(np.arange(20_000, dtype=np.uint64), 0))
    counts = np.bincount(chosen, minlength=5)
    assert counts[1] == 0
    expected = 20_000 * weights[weights > 0] / 10
    # Chi-square with 3 degrees of freedom exceeds 21 with probability 1e-4.
    assert ((counts[weights > 0] - expected) ** 2 / expected).sum() < 21
