# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Comparisons: paired, with intervals that hold the truth as often as they say, and that say when they know nothing."""

import numpy as np
import pytest

from magat_evaluation.comparison import Estimate, combine


def test_what_is_hard_for_all_cancels() -> None:
    rng = np.random.default_rng(1)
    hard = rng.normal(size=200)
    one, other = hard + 0.1 + 0.05 * rng.normal(size=200), hard + 0.05 * rng.normal(size=200)
    paired = combine([(1.0, [one]), (-1.0, [other])], rate=False)
    assert paired.value == pytest.approx(one.mean() - other.mean())
    assert 0.08 < paired.low < 0.1 < paired.high < 0.12
    assert (paired.cases, paired.trainings) == (200, 1)
    assert combine([(1.0, [one]), (-1.0, [other])], rate=False) == paired, "the same draws"


def test_the_interval_of_a_mean_is_that_of_the_normal_distribution() -> None:
    values = np.random.default_rng(2).normal(size=400)
    found, half = combine([(1.0, [values])], rate=False), 1.96 * values.std(ddof=1) / 20
    assert found.high - found.value == pytest.approx(half, rel=0.15)
    assert found.value - found.low == pytest.approx(half, rel=0.15)


def test_rates_without_failures_leave_room_for_some() -> None:
    ones = np.ones(200)
    level = combine([(1.0, [ones])], rate=True)
    assert (level.value, level.high) == (1.0, pytest.approx(1.0))
    assert 0.97 < level.low < 0.99
    equal = combine([(1.0, [ones]), (-1.0, [ones])], rate=True)
    assert equal.value == 0.0
    assert -0.03 < equal.low < -0.005
    assert 0.005 < equal.high < 0.03


def test_only_common_cases_count() -> None:
    long, short = np.r_[np.zeros(50), np.ones(50)], np.zeros(50)
    assert combine([(1.0, [long]), (-1.0, [short])], rate=False).value == 0.0


def test_trainings_widen_the_interval_by_what_they_differ() -> None:
    rng = np.random.default_rng(3)
    cases = 0.01 * rng.normal(size=300)
    apart = [cases + shift for shift in (-0.1, 0.0, 0.1)]
    one, three = combine([(1.0, [cases])], rate=False), combine([(1.0, apart)], rate=False)
    assert three.trainings == 3
    assert three.value == pytest.approx(one.value)
    assert three.high - three.low > 20 * (one.high - one.low)
    alike = combine([(1.0, [cases] * 3)], rate=False)
    assert alike.high - alike.low == pytest.approx(one.high - one.low, rel=0.01)


@pytest.mark.parametrize(
    ("low", "high", "above", "within"),
    [(0.1, 0.2, True, False), (-0.1, 0.2, None, None), (-0.2, -0.1, False, False), (-0.01, 0.02, None, True)],
)
def test_what_an_interval_shows(low: float, high: float, above: bool | None, within: bool | None) -> None:
    estimate = Estimate((low + high) / 2, low, high, cases=10, trainings=1)
    assert (estimate.above(0.0), estimate.within(0.05)) == (above, within)
