# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The bench of the expert: the right cases, the right figures."""

import math

import numpy as np
import pytest
from rich.console import Console

from magat_bench.expert import LARGE_SETS, SETS, ExpertSet, bench_expert, measure, table
from magat_cli import main as cli
from magat_expert import Solution, SolveStatus


def solution(seconds: float, cost: int = 0, lower_bound: int = 0, expansions: int = 0) -> Solution:
    status = SolveStatus.SOLVED if cost else SolveStatus.TIMED_OUT
    return Solution(status, None, np.zeros(1, bool), cost, lower_bound, 0, seconds, 0, expansions)


def test_the_figures_are_those_of_the_searches():
    speed = measure([solution(0.001, 12, 10, 50), solution(0.003, 10, 10, 150), solution(0.002, 0, 99, 100)])

    assert speed.cases == 3
    assert (speed.mean, speed.median, speed.longest) == pytest.approx((2.0, 2.0, 3.0))
    assert speed.p95 == pytest.approx(2.9)
    assert speed.expansions_per_second == pytest.approx(50_000)
    assert speed.cost_ratio == pytest.approx(1.1), "of the solved cases only"
    assert speed.solved == pytest.approx(2 / 3)
    assert math.isnan(measure([solution(0.1)]).cost_ratio)


def test_a_set_is_drawn_by_its_seed():
    which = ExpertSet(6, 3, 1.1)
    first, again, other = (list(which.cases(2, seed)) for seed in (1, 1, 2))
    assert [case.obstacles.shape for case in first] == [(6, 6), (6, 6)]
    np.testing.assert_array_equal(first[1].starts, again[1].starts)
    assert any((a.starts != b.starts).any() for a, b in zip(first, other, strict=True))


def test_every_set_has_its_row():
    console = Console(width=200, quiet=True)
    counts = [(ExpertSet(8, 4, 1.1), 3), (ExpertSet(10, 5, 5.0), 2)]
    speeds = bench_expert(counts, 7, 5.0, console)
    assert [speed.cases for speed in speeds] == [3, 2]
    for (which, _), speed in zip(counts, speeds, strict=True):
        assert speed.solved == 1.0
        assert 1.0 <= speed.cost_ratio <= which.w
        assert 0.0 < speed.median <= speed.p95 <= speed.longest
    assert table(counts, speeds).row_count == 2


def test_the_command_prints_the_table(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setattr("magat_bench.expert.SETS", (ExpertSet(6, 2, 1.1),))
    monkeypatch.setattr("magat_bench.expert.LARGE_SETS", (ExpertSet(9, 2, 5.0),))
    assert cli.main(["bench-expert", "--cases", "2", "--large", "--large-cases", "1"]) == 0
    printed = capsys.readouterr().out
    assert "6x6 (2)" in printed
    assert "9x9 (2)" in printed
    assert "100 %" in printed


@pytest.mark.parametrize("options", [["--cases", "0"], ["--time-limit", "0"], ["--time-limit", "nan"]])
def test_senseless_options_are_refused(options):
    with pytest.raises(SystemExit):
        cli.main(["bench-expert", *options])


def test_the_sets_are_those_of_the_specification():
    assert [which.name for which in SETS + LARGE_SETS] == [
        *("20x20 (10)", "28x28 (20)", "35x35 (30)", "40x40 (40)", "50x50 (60)", "50x50 (100)", "65x65 (100)"),
        *("100x100 (500)", "200x200 (500)", "200x200 (1000)"),
    ]
