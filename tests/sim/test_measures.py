# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Intervals, the expert's flowtime, and the measures of a set."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from magat_sim.measures import (
    Z_95,
    EpisodeMeasures,
    Flowtime,
    expert_flowtime,
    first_visits,
    last_arrivals,
    summarise,
    wilson,
)

EPISODE = EpisodeMeasures(
    success=True,
    success_strict=True,
    p_rg=1.0,
    stranded=0,
    flowtime=Flowtime(110, 130),
    expert_flowtime=Flowtime(100, 100),
    makespan=20,
    t_max=60,
    ticks=20,
    moves_blocked=4,
)


@pytest.mark.parametrize(
    ("successes", "cases", "interval"),
    [
        (9, 10, (0.5958, 0.9821)),
        (5, 10, (0.2366, 0.7634)),
        (0, 10, (0.0, 0.2775)),
        (10, 10, (0.7225, 1.0)),
        (1, 1, (0.2065, 1.0)),
        (91, 100, (0.8377, 0.9519)),
        (950, 1000, (0.9347, 0.9619)),
    ],
)
def test_wilson_intervals_are_those_of_the_tables(successes: int, cases: int, interval: tuple[float, float]) -> None:
    assert wilson(successes, cases) == pytest.approx(interval, abs=5e-5)


@given(st.integers(1, 5000), st.data())
def test_wilson_solves_its_equation_and_mirrors(cases: int, data: st.DataObject) -> None:
    successes = data.draw(st.integers(0, cases))
    rate = successes / cases
    low, high = wilson(successes, cases)
    assert 0 <= low <= rate + 1e-12
    assert rate - 1e-12 <= high <= 1
    for bound in (low, high):
        # The bounds p are where |rate - p| is z standard errors of p.
        assert (rate - bound) ** 2 == pytest.approx(Z_95**2 * bound * (1 - bound) / cases, abs=1e-9)
    assert wilson(cases - successes, cases) == pytest.approx((1 - high, 1 - low), abs=1e-12)


@pytest.mark.parametrize(("successes", "cases"), [(0, 0), (3, 2), (-1, 4)])
def test_wilson_refuses_impossible_counts(successes: int, cases: int) -> None:
    with pytest.raises(ValueError, match=f"{successes} successes of {cases} cases"):
        wilson(successes, cases)


def test_the_experts_flowtime_on_paths_drawn_by_hand() -> None:
    goals = np.array([[2, 0], [0, 1], [5, 5]])
    paths = np.array(
        [
            [[0, 0], [0, 1], [5, 5]],
            [[1, 0], [0, 2], [5, 5]],
            [[2, 0], [0, 1], [5, 5]],  # robot 0 is on its goal at 2
            [[3, 0], [0, 1], [5, 5]],  # and leaves it
            [[2, 0], [0, 1], [5, 5]],  # until 4
        ],
        dtype=np.int16,
    )
    assert expert_flowtime(paths, goals) == Flowtime(first_visit=2 + 0 + 0, last_arrival=4 + 2 + 0)


def test_first_visits_and_last_arrivals_robot_by_robot() -> None:
    on_goal = np.array(
        [
            [1, 0, 0, 1],
            [1, 0, 1, 0],
            [1, 0, 0, 0],
            [1, 1, 1, 0],
        ],
        dtype=bool,
    )
    assert first_visits(on_goal).tolist() == [0, 3, 1, 0]
    assert last_arrivals(on_goal).tolist() == [0, 3, 3, 4]


def test_delta_ft_compares_each_flowtime_with_the_experts() -> None:
    assert EPISODE.delta_ft == pytest.approx(0.10)
    assert EPISODE.delta_ft_strict == pytest.approx(0.30)
    assert math.isnan(replace(EPISODE, expert_flowtime=None).delta_ft)
    nothing_to_do = replace(EPISODE, expert_flowtime=Flowtime(0, 0))
    assert nothing_to_do.delta_ft == 1.0
    assert replace(nothing_to_do, flowtime=Flowtime(0, 0)).delta_ft == 0.0


def test_a_set_is_summarised_by_rates_means_and_intervals() -> None:
    failed = replace(
        EPISODE,
        success=False,
        success_strict=False,
        p_rg=0.8,
        stranded=2,
        flowtime=Flowtime(150, 190),
        makespan=60,
        moves_blocked=10,
    )
    late = replace(EPISODE, success_strict=False, flowtime=Flowtime(100, 120), makespan=25, moves_blocked=0)
    summary = summarise([EPISODE, failed, late, EPISODE])
    assert summary.cases == 4
    assert summary.alpha == 0.75
    assert summary.alpha_interval == wilson(3, 4)
    assert summary.alpha_strict == 0.5
    assert summary.alpha_strict_interval == wilson(2, 4)
    assert summary.delta_ft == pytest.approx((0.1 + 0.5 + 0.0 + 0.1) / 4)
    assert summary.delta_ft_strict == pytest.approx((0.3 + 0.9 + 0.2 + 0.3) / 4)
    deviation = math.sqrt(((0.1 - 0.175) ** 2 * 2 + (0.5 - 0.175) ** 2 + 0.175**2) / 3)
    assert summary.delta_ft_half_width == pytest.approx(Z_95 * deviation / 2)
    assert summary.p_rg == pytest.approx(0.95)
    assert summary.stranded == {0: 3, 2: 1}
    assert summary.makespan == pytest.approx((20 + 60 + 25 + 20) / 4)
    assert summary.moves_blocked == pytest.approx((4 + 10 + 0 + 4) / 4)


def test_the_mean_of_one_case_has_no_interval() -> None:
    summary = summarise([EPISODE])
    assert (summary.alpha, summary.delta_ft) == (1.0, pytest.approx(0.1))
    assert math.isnan(summary.delta_ft_half_width)
