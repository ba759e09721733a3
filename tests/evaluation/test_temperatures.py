# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Success against flowtime: the same measures as an evaluation's, in a table, a file and a picture."""

import csv
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

from magat_cli import main as cli
from magat_evaluation import points
from magat_evaluation.candidates import Candidate, Setting
from magat_evaluation.evaluate import evaluate_candidate
from magat_evaluation.report import Report
from magat_evaluation.report_files import read_csv, write_csv
from magat_evaluation.sets import CaseSet
from magat_evaluation.splits import SPLITS
from magat_evaluation.studies import temperatures
from magat_evaluation.studies.temperatures import frontier
from magat_robot.policy import models
from magat_robot.policy.config import ModelError
from magat_robot.policy.store import WEIGHTS, save
from magat_sim.shield import SHIELDS
from magat_sim.simulator import Rules

CASES = CaseSet.square(8, 3, 4, split="valid")
QUIET = Console(quiet=True)


def point(temperature: float, alpha: float, delta_ft: float, **changes: Any) -> Report:
    values = {
        "policy": "a", "temperature": temperature, "alpha": alpha,
        "alpha_interval": (alpha - 0.1, min(1.0, alpha + 0.02)), "alpha_strict": 0.8,
        "alpha_strict_interval": (0.7, 0.9), "delta_ft": delta_ft, "delta_ft_half_width": 0.01, "p_rg": 0.9,
        "delta_ft_strict": 0.3, "cases": 300, "unsolved_by_expert": 0, "width": 8, "height": 8, "robots": 3,
        "density": 0.1, "expert_w": 1.1, "generator_version": 1, "seed": 1, "first_case": 21000, "shield": "idle",
        "shield_version": 1, "encoding": "float32", "link_loss": 0.0, "digest": "ab" * 32, "bytes_per_step": 548,
        "makespan": 20.0, "moves_blocked": 1.5, "stranded": {0: 270, 2: 30},
    }  # fmt: skip
    return Report(**values | changes)


def line(policy: str, *points: Report) -> list[Report]:
    return [replace(one, policy=policy) for one in points]


def shades(path: Path) -> np.ndarray:
    """The picture in grey, ``[height, width]``."""
    with Image.open(path) as image:
        assert image.format == "PNG"
        return np.asarray(image.convert("L"), dtype=int)


def test_each_point_is_an_evaluation_at_its_temperature(policies: dict[str, Path], tmp_path: Path) -> None:
    study = frontier(policies, ("pibt", "idle"), (3.0, 0.5, 3.0), CASES)
    found = study.measure(tmp_path / "new", QUIET)
    each = [(name, shield, one) for name in policies for shield in ("idle", "pibt") for one in (0.5, 3.0)]
    assert [(one.policy, one.shield, one.temperature) for one in found] == each, "in order, each once"
    for one in found:
        setting = Setting(one.temperature, rules=Rules(shield=one.shield))
        alone = evaluate_candidate(Candidate.of_policy(policies[one.policy], setting, one.policy), CASES, QUIET)
        assert one == replace(alone, seconds=None)
    assert len({one.digest for one in found}) == 2


def test_what_was_measured_before_is_kept(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, random_network: Callable
) -> None:
    def measure(*shields: str) -> list[Report]:
        return frontier(policies, shields, (0.5, 1.0), CASES).measure(tmp_path, QUIET)

    before = measure("idle")
    measured: list[Candidate] = []

    def evaluate(candidate: Candidate, *rest: Any) -> Report:
        measured.append(candidate)
        return evaluate_candidate(candidate, *rest)

    monkeypatch.setattr(points, "evaluate_candidate", evaluate)
    both = measure("idle", "pibt")
    assert [candidate.rules.shield for candidate in measured] == ["pibt"] * 4
    assert [one for one in both if one.shield == "idle"] == before
    save(random_network("MAGAT-F-16", seed=5), policies["second"], "# card\n")
    measure("idle")
    assert len(measured) == 4 + 2, "of the weights that have changed"
    assert len(read_csv(tmp_path / "frontier.csv")) == 4, "the file holds nothing else"


@pytest.mark.parametrize("wrong", [0.0, -1.0, 101.0, math.nan, math.inf])
def test_a_temperature_out_of_range_is_refused_before_any_work(policies: dict[str, Path], wrong: float) -> None:
    with pytest.raises(ModelError, match=f"temperature {wrong} is not within"):
        frontier(policies, ["idle"], (1.0, wrong), CASES)


def test_a_damaged_policy_is_refused_before_any_work(policies: dict[str, Path]) -> None:
    (policies["second"] / WEIGHTS).write_bytes(b"")
    with pytest.raises(ModelError, match=r"second.* is damaged"):
        frontier(policies, ["idle"], [1.0], CASES)


def test_the_file_holds_a_row_a_point(tmp_path: Path) -> None:
    points = line("a, b", point(0.5, 0.9, 0.1), point(1.0, 0.95, 0.2)) + line("c", point(1.0, 0.5, 0.3))
    write_csv(points, tmp_path / "points.csv")
    with (tmp_path / "points.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["policy"], float(row["temperature"])) for row in rows] == [("a, b", 0.5), ("a, b", 1.0), ("c", 1.0)]
    assert [float(row["alpha"]) for row in rows] == [0.9, 0.95, 0.5]
    assert [float(row["alpha_low"]) for row in rows] == pytest.approx([0.8, 0.85, 0.4])
    assert [float(row["alpha_high"]) for row in rows] == pytest.approx([0.92, 0.97, 0.52])
    assert {(row["delta_ft_half_width"], row["cases"], row["robots"]) for row in rows} == {("0.01", "300", "3")}
    assert all(None not in row and None not in row.values() and "" not in row.values() for row in rows)


def test_the_table_says_what_reaches_the_target(policies: dict[str, Path]) -> None:
    study = frontier(policies, ["idle"], [1.0], CASES)
    reports = line("a", point(0.5, 0.969, 0.05), point(1.0, 0.97, 0.08), point(2.0, 1.0, 0.081))
    console = Console(width=130)
    with console.capture() as capture:
        console.print(study.table(reports))
    lines = capture.get().splitlines()
    assert "4 cases of 8x8 (3)" in lines[0]
    assert [row.split()[1:3] for row in lines[2:]] == [["idle", "0.5"], ["idle", "1"], ["idle", "2"]]
    assert [row.split()[-1] for row in lines[2:]] == ["missed", "reached", "missed"]
    assert "0.970 (0.870 to 0.990)  0.080 ± 0.010    0.300           20.0      0.9000" in lines[3]


def test_the_picture_shows_the_points_and_the_target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    far = line("a", point(0.5, 0.7, 0.3), point(1.0, 0.8, 0.4))
    temperatures.draw(far, tmp_path / "one.png")
    one = shades(tmp_path / "one.png")
    assert min(one.shape) > 500
    assert 0.01 < (one < 240).mean() < 0.3, "ink on white paper"
    temperatures.draw(far[:1], tmp_path / "fewer.png")
    temperatures.draw(far + line("b", point(0.5, 0.75, 0.35)), tmp_path / "more.png")
    monkeypatch.setattr(temperatures, "TARGET_DELTA_FT", 0.2)
    temperatures.draw(far, tmp_path / "wider.png")
    for name in ("fewer", "more", "wider"):
        assert (one != shades(tmp_path / f"{name}.png")).any(), name


@pytest.mark.parametrize(
    ("alike", "differ"),
    [({}, True), ({"MARKERS": ("o",)}, True), ({"DASHES": ("-",)}, True),
     ({"MARKERS": ("o",), "DASHES": ("-",)}, False)],
)  # fmt: skip
def test_lines_differ_without_colour_by_the_policys_marker_and_style(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, alike: dict[str, tuple], differ: bool
) -> None:
    monkeypatch.setattr(temperatures, "robot_colour", lambda _: "#000000")
    monkeypatch.setattr(Figure, "legend", lambda *_, **__: None)  # which names them
    for name, value in ({"_LABELS": (6.0,)} | alike).items():
        monkeypatch.setattr(temperatures, name, value)
    here, there = ([point(0.5, 0.7, x), point(1.0, 0.8, x)] for x in (0.1, 0.4))
    for name, (one, other) in {"one": (here, there), "other": (there, here)}.items():
        temperatures.draw(line("a", *one) + line("b", *other), tmp_path / f"{name}.png")
    assert (shades(tmp_path / "one.png") != shades(tmp_path / "other.png")).any() == differ


def test_each_shield_has_a_picture_below_the_others(tmp_path: Path) -> None:
    idle, pibt = ([point(0.5, 0.7, x, shield=shield)] for x, shield in ((0.1, "idle"), (0.4, "pibt")))
    temperatures.draw(line("a", *idle), tmp_path / "one.png")
    temperatures.draw(line("a", *idle) + line("a", *pibt), tmp_path / "two.png")
    one, two = shades(tmp_path / "one.png"), shades(tmp_path / "two.png")
    assert two.shape[0] > one.shape[0]
    assert two.shape[1] == one.shape[1]


def test_points_at_the_edge_can_be_drawn(tmp_path: Path) -> None:
    rounded = point(1.0, 1.0, 0.0, alpha_interval=(0.2, 1.0 - 1e-16))
    temperatures.draw(line(r"$\no{formula$", rounded), tmp_path / "edge.png")
    assert (shades(tmp_path / "edge.png") < 128).any()


def test_one_case_gives_a_point_without_an_interval(tmp_path: Path) -> None:
    for name, half in (("none", None), ("zero", 0.0)):
        temperatures.draw(line("a", point(1.0, 1.0, 2.0, delta_ft_half_width=half)), tmp_path / name)
    assert (shades(tmp_path / "none") == shades(tmp_path / "zero")).all()


def test_the_command_writes_table_file_and_picture(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setattr(models, "model_folders", lambda: iter([tmp_path / "models"]))
    monkeypatch.setenv("COLUMNS", "130")
    output = tmp_path / "new" / "folder"
    size = ["--width", "8", "--height", "8", "--robots", "3"]
    command = ["frontier", "--cases", "3", "--temperatures", "0.5", "2", "--output", str(output), *size]
    assert cli.main(command) == 0
    printed = [row.split() for row in capsys.readouterr().out.splitlines()]
    each = [[name, shield, one] for name in policies for shield in SHIELDS for one in ("0.5", "2")]
    assert [row[:3] for row in printed[2:]] == each
    files = ["frontier-cases.csv", "frontier.csv", "frontier.png"]
    assert sorted(file.name for file in output.iterdir()) == files
    with (output / "frontier.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {(row["first_case"], row["width"], row["cases"]) for row in rows} == {(str(SPLITS["valid"].start), "8", "3")}
    assert (shades(output / "frontier.png") < 128).any()
    assert cli.main([*command, "--policy", "second"]) == 0
    assert "first " not in capsys.readouterr().out.replace("delta_FT, first", "")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--temperatures", "0"], "temperature 0.0 is not within 0.01 and 100"),
        (["--cases", "5000"], "the split valid has 4500 cases, not 5000"),
        (["--policy", "nothing"], "no policy 'nothing'"),
    ],
)
def test_what_cannot_be_done_is_said(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any, arguments: list[str],
    said: str,
) -> None:  # fmt: skip
    monkeypatch.setattr(models, "model_folders", lambda: iter([tmp_path / "models"]))
    assert cli.main(["frontier", "--output", str(tmp_path / "out"), *arguments]) == 1
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()
