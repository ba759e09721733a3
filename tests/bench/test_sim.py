# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The bench of the batched simulator: what it counts, and where it says the time goes."""

from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

from magat_bench import sim as bench_sim
from magat_bench.sim import MOVE, PARTS, SimSet
from magat_cli import main as cli
from magat_robot.policy.store import save
from magat_sim import simulator
from magat_sim.simulator import DEFAULT_RULES

SMALL = SimSet(12, 8, 3, 15)
QUIET = Console(quiet=True)


@pytest.fixture
def folder(tmp_path: Path, random_network: Callable) -> Path:
    save(random_network("MAGAT-F-16"), tmp_path / "policy", "# card\n")
    return tmp_path / "policy"


def test_steps_of_robots_are_counted_while_their_worlds_run(folder: Path) -> None:
    (speed,) = bench_sim.bench_sim(folder, [SMALL], DEFAULT_RULES, 1, QUIET)
    assert (speed.steps, speed.robot_steps) == (15, 3 * 8 * 15)
    assert speed.seconds > 0


def test_the_parts_make_up_the_whole_and_what_is_slow_has_a_large_share(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (speed,) = bench_sim.bench_sim(folder, [SMALL], DEFAULT_RULES, 1, QUIET)
    assert list(speed.shares) == [*PARTS, MOVE]
    assert all(share > 0 for share in speed.shares.values())
    assert sum(speed.shares.values()) == pytest.approx(1)

    quick = simulator.SHIELDS["idle"]

    def slow(*arguments: object) -> object:
        for _ in range(400):
            quick(*arguments)
        return quick(*arguments)

    monkeypatch.setitem(simulator.SHIELDS, "idle", slow)
    monkeypatch.setitem(PARTS, "shield", [slow])
    (slowed,) = bench_sim.bench_sim(folder, [SMALL], DEFAULT_RULES, 1, QUIET)
    assert slowed.shares["shield"] > max(2 * speed.shares["shield"], 0.3)


def test_the_command_prints_a_row_a_set(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(bench_sim, "SETS", (SMALL, SimSet(9, 2, 2, 4)))
    monkeypatch.setenv("COLUMNS", "140")
    assert cli.main(["bench-sim", "--policy", str(folder), "--sets", "9x9 (2)"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert "2 of 9x9 (2)" in lines[2]
    assert cli.main(["bench-sim", "--policy", str(folder), "--sets", "9x9"]) == 1
    assert "no set '9x9'" in capsys.readouterr().err
