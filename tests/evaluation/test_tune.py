# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Temperatures: chosen for each shield on validation cases, kept in the policy's folder, and used from there."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from magat_cli import main as cli
from magat_evaluation import points
from magat_evaluation import tune as tuning
from magat_evaluation.candidates import Candidate, Setting
from magat_evaluation.evaluate import evaluate_candidate
from magat_evaluation.policies_table import policies_table
from magat_evaluation.report_files import read_csv
from magat_evaluation.sets import CaseSet
from magat_evaluation.splits import SPLITS
from magat_evaluation.tune import TUNING_SETS, score, tune
from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import CONFIG, read_folder, read_temperature, write_temperatures
from magat_robot.policy.models import all_policies
from magat_sim.simulator import Rules

QUIET = Console(quiet=True)
SETS = (CaseSet.square(8, 3, 3, split="valid"), CaseSet.square(9, 4, 2, split="valid"))


def test_cases_are_of_small_and_of_large_maps_and_of_no_test() -> None:
    assert min(which.robots for which in TUNING_SETS) <= 10
    assert max(which.robots for which in TUNING_SETS) >= 100
    assert all(set(which.numbers) <= set(SPLITS["valid"]) for which in TUNING_SETS)


def test_the_best_temperature_of_each_shield_is_kept(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    best = {"idle": 0.5, "pibt": 2.0}

    def measure(candidate: Candidate, *rest: Any) -> Any:
        good = candidate.temperature == best[candidate.rules.shield]
        report = evaluate_candidate(candidate, *rest)
        return dataclasses.replace(report, alpha=1.0 if good else 0.9, delta_ft=0.1)

    monkeypatch.setattr(points, "evaluate_candidate", measure)
    before = read_folder(policies["first"])
    chosen = tune("first", policies["first"], ["idle", "pibt"], [0.5, 1.0, 2.0], SETS, tmp_path / "t.csv", QUIET)
    assert chosen == best
    config, digest, _ = read_folder(policies["first"])
    assert (config, digest) == (before[0].with_changes(temperature=0.5), before[1])
    assert [read_temperature(policies["first"], shield) for shield in ("idle", "pibt", "pibt-memory", "")] == [
        0.5, 2.0, 0.5, 0.5,
    ]  # fmt: skip
    rows = read_csv(tmp_path / "t.csv")
    assert len(rows) == 2 * 3 * 2
    assert score([row for row in rows if (row.shield, row.temperature) == ("pibt", 2.0)]) == pytest.approx(0.9)
    monkeypatch.setattr(points, "evaluate_candidate", lambda *_: pytest.fail("measured again"))
    assert tune("first", policies["first"], ["pibt"], [0.5, 2.0], SETS, tmp_path / "t.csv", QUIET) == {"pibt": 2.0}
    assert read_temperature(policies["first"], "idle") == 0.5, "what is not chosen anew stays"


def test_evaluations_use_the_temperature_of_their_shield(policies: dict[str, Path]) -> None:
    write_temperatures(policies["first"], {"idle": 0.5, "pibt": 0.25}, "idle")
    found = {
        shield: Candidate.of_policy(policies["first"], Setting(rules=Rules(shield=shield))).temperature
        for shield in ("idle", "pibt", "pibt-memory")
    }
    assert found == {"idle": 0.5, "pibt": 0.25, "pibt-memory": 0.5}
    given = Candidate.of_policy(policies["first"], Setting(0.75, rules=Rules(shield="pibt")))
    assert given.temperature == 0.75
    assert "| first | 2 | " in policies_table(policies)
    assert " | 0.5 | 0.25 | 0.5 |  |" in policies_table(policies)


@pytest.mark.parametrize("wrong", [[], {"pibt": "1"}, {"pibt": 1000}, {"pibt": None}])
def test_temperatures_that_cannot_be_used_are_refused(policies: dict[str, Path], wrong: Any) -> None:
    file = policies["first"] / CONFIG
    file.write_text(json.dumps(json.loads(file.read_text()) | {"temperatures": wrong}))
    with pytest.raises(ModelError, match="temperature"):
        read_temperature(policies["first"], "pibt")
    with pytest.raises(ModelError, match=r"temperature 0\.001"):
        write_temperatures(policies["second"], {"idle": 0.001}, "idle")


def test_the_command_tunes_policies(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(tuning, "TUNING_SETS", SETS)
    command = ["tune", "--policy", str(policies["first"]), "--shield", "pibt", "--temperatures", "2", "--cases", "2"]
    assert cli.main([*command, "--output", str(tmp_path / "tune")]) == 0
    assert "T = 2 with pibt" in capsys.readouterr().out
    assert read_temperature(policies["first"], "pibt") == 2.0
    assert {row.cases for row in read_csv(tmp_path / "tune" / "first.csv")} == {2}


def test_the_table_of_policies_says_how_they_were_trained() -> None:
    table = policies_table(all_policies())
    assert all(f"| {name} | " in table for name in all_policies())
    assert "| states | 0 |" in table
