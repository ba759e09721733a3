"""Success against flowtime: the same measures as an evaluation's, in a table, a file and a picture."""

import csv
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

from magat_cli import main as cli
from magat_evaluation.evaluate import Setting, evaluate_policy
from magat_evaluation.report_files import write_csv
from magat_evaluation.splits import SET_SEED, SPLITS
from magat_evaluation.studies import frontier
from magat_robot.policy import models
from magat_robot.policy.config import ModelError
from magat_robot.policy.store import WEIGHTS, save
from magat_sim.shield import SHIELDS
from magat_sim.simulator import Rules

SIZE = {"width": 8, "height": 8, "robots": 3, "density": 0.1}
QUIET = Console(quiet=True)


def point(temperature: float, alpha: float, delta_ft: float, **changes: Any) -> dict[str, Any]:
    return {
        "temperature": temperature, "alpha": alpha, "alpha_interval": (alpha - 0.1, min(1.0, alpha + 0.02)),
        "delta_ft": delta_ft, "delta_ft_half_width": 0.01, "p_rg": 0.9, "alpha_strict": 0.8, "delta_ft_strict": 0.3,
        "cases": 300, "unsolved_by_expert": 0, **SIZE, "seed": 1, "first_case": 21000, "shield": "idle",
        "encoding": "float32", "link_loss": 0.0, "digest": "ab" * 32, "bytes_per_step": 548, "makespan": 20.0,
        "moves_blocked": 1.5, "stranded": {0: 270, 2: 30},
    } | changes  # fmt: skip


def settings(*temperatures: float, shields: tuple[str, ...] = ("idle",)) -> list[Setting]:
    return [Setting(one, rules=Rules(shield=shield)) for shield in shields for one in temperatures]


def line(policy: str, *points: dict[str, Any]) -> list[dict[str, Any]]:
    return [one | {"policy": policy} for one in points]


def shades(path: Path) -> np.ndarray:
    """The picture in grey, ``[height, width]``."""
    with Image.open(path) as image:
        assert image.format == "PNG"
        return np.asarray(image.convert("L"), dtype=int)


def test_each_point_is_an_evaluation_at_its_temperature(policies: dict[str, Path], tmp_path: Path) -> None:
    numbers = SPLITS["valid"][:4]
    asked = settings(3.0, 0.5, 3.0, shields=("pibt", "idle"))
    found = frontier.frontier(policies, asked, numbers, SET_SEED, SIZE, tmp_path / "new" / "a.csv", QUIET)
    each = [(name, shield, one) for name in policies for shield in ("idle", "pibt") for one in (0.5, 3.0)]
    assert [(one["policy"], one["shield"], one["temperature"]) for one in found] == each, "in order, each once"
    for one in found:
        setting = Setting(one["temperature"], rules=Rules(shield=one["shield"]))
        alone = evaluate_policy(policies[one["policy"]], numbers, SET_SEED, setting, SIZE, QUIET)
        assert one | {"seconds": 0} == alone | {"seconds": 0, "policy": one["policy"]}
    assert len({one["digest"] for one in found}) == 2


def test_what_was_measured_before_is_kept(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, random_network: Callable
) -> None:
    last = (SPLITS["valid"][:4], SET_SEED, SIZE, tmp_path / "a.csv", QUIET)
    before = frontier.frontier(policies, settings(0.5, 1.0), *last)
    measured: list[Setting] = []

    def measure(folder: Path, numbers: Any, seed: int, setting: Setting, *rest: Any) -> dict:
        measured.append(setting)
        return evaluate_policy(folder, numbers, seed, setting, *rest)

    monkeypatch.setattr(frontier, "evaluate_policy", measure)
    both = frontier.frontier(policies, settings(0.5, 1.0, shields=("idle", "pibt")), *last)
    assert [setting.rules.shield for setting in measured] == ["pibt"] * 4
    assert [one["alpha"] for one in both if one["shield"] == "idle"] == [one["alpha"] for one in before]
    save(random_network("MAGAT-F-16", seed=5), policies["second"], "# card\n")
    frontier.frontier(policies, settings(0.5, 1.0), *last)
    assert len(measured) == 4 + 2, "of the weights that have changed"


@pytest.mark.parametrize("wrong", [0.0, -1.0, 101.0, math.nan, math.inf])
def test_a_temperature_out_of_range_is_refused_before_any_work(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: float
) -> None:
    monkeypatch.setattr(frontier, "evaluate_policy", lambda *_: pytest.fail("too late"))
    with pytest.raises(ModelError, match=f"temperature {wrong} is not within"):
        frontier.frontier(
            policies, settings(1.0, wrong), SPLITS["valid"][:4], SET_SEED, SIZE, tmp_path / "a.csv", QUIET
        )


def test_a_damaged_policy_is_refused_before_any_work(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frontier, "evaluate_policy", lambda *_: pytest.fail("too late"))
    (policies["second"] / WEIGHTS).write_bytes(b"")
    with pytest.raises(ModelError, match=r"second.* is damaged"):
        frontier.frontier(policies, settings(1.0), SPLITS["valid"][:4], SET_SEED, SIZE, tmp_path / "a.csv", QUIET)


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


def test_the_table_says_what_reaches_the_target() -> None:
    reports = line("a", point(0.5, 0.969, 0.05), point(1.0, 0.97, 0.08), point(2.0, 1.0, 0.081))
    console = Console(width=80)
    with console.capture() as capture:
        console.print(frontier.table(reports))
    lines = capture.get().splitlines()
    assert "300 cases of 8x8 (3)" in lines[0]
    assert [row.split()[1:3] for row in lines[2:]] == [["idle", "0.5"], ["idle", "1"], ["idle", "2"]]
    assert [row.split()[-1] for row in lines[2:]] == ["missed", "reached", "missed"]
    assert "0.970  0.870 to 0.990  0.080 ± 0.010  0.9000" in lines[3]


def test_the_picture_shows_the_points_and_the_target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    far = line("a", point(0.5, 0.7, 0.3), point(1.0, 0.8, 0.4))
    frontier.draw(far, tmp_path / "one.png")
    one = shades(tmp_path / "one.png")
    assert min(one.shape) > 500
    assert 0.01 < (one < 240).mean() < 0.3, "ink on white paper"
    frontier.draw(far[:1], tmp_path / "fewer.png")
    frontier.draw(far + line("b", point(0.5, 0.75, 0.35)), tmp_path / "more.png")
    monkeypatch.setattr(frontier, "TARGET_DELTA_FT", 0.2)
    frontier.draw(far, tmp_path / "wider.png")
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
    monkeypatch.setattr(frontier, "robot_colour", lambda _: "#000000")
    monkeypatch.setattr(Figure, "legend", lambda *_, **__: None)  # which names them
    for name, value in ({"_LABELS": (6.0,)} | alike).items():
        monkeypatch.setattr(frontier, name, value)
    here, there = ([point(0.5, 0.7, x), point(1.0, 0.8, x)] for x in (0.1, 0.4))
    for name, (one, other) in {"one": (here, there), "other": (there, here)}.items():
        frontier.draw(line("a", *one) + line("b", *other), tmp_path / f"{name}.png")
    assert (shades(tmp_path / "one.png") != shades(tmp_path / "other.png")).any() == differ


def test_each_shield_has_a_picture_below_the_others(tmp_path: Path) -> None:
    idle, pibt = ([point(0.5, 0.7, x) | {"shield": shield}] for x, shield in ((0.1, "idle"), (0.4, "pibt")))
    frontier.draw(line("a", *idle), tmp_path / "one.png")
    frontier.draw(line("a", *idle) + line("a", *pibt), tmp_path / "two.png")
    one, two = shades(tmp_path / "one.png"), shades(tmp_path / "two.png")
    assert two.shape[0] > one.shape[0]
    assert two.shape[1] == one.shape[1]


def test_points_at_the_edge_can_be_drawn(tmp_path: Path) -> None:
    rounded = point(1.0, 1.0, 0.0, alpha_interval=(0.2, 1.0 - 1e-16))
    frontier.draw(line(r"$\no{formula$", rounded), tmp_path / "edge.png")
    assert (shades(tmp_path / "edge.png") < 128).any()


def test_one_case_gives_a_point_without_an_interval(tmp_path: Path) -> None:
    for name, half in (("none", math.nan), ("zero", 0.0)):
        frontier.draw(line("a", point(1.0, 1.0, 2.0, delta_ft_half_width=half)), tmp_path / name)
    assert (shades(tmp_path / "none") == shades(tmp_path / "zero")).all()


def test_the_command_writes_table_file_and_picture(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setattr(models, "model_folders", lambda: iter([tmp_path / "models"]))
    monkeypatch.setenv("COLUMNS", "100")
    output = tmp_path / "new" / "folder"
    size = ["--width", "8", "--height", "8", "--robots", "3"]
    command = ["frontier", "--cases", "3", "--temperatures", "0.5", "2", "--output", str(output), *size]
    assert cli.main(command) == 0
    printed = [row.split() for row in capsys.readouterr().out.splitlines()]
    each = [[name, shield, one] for name in policies for shield in SHIELDS for one in ("0.5", "2")]
    assert [row[:3] for row in printed[2:]] == each
    assert sorted(file.name for file in output.iterdir()) == ["frontier.csv", "frontier.png"]
    with (output / "frontier.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {(row["first_case"], row["width"], row["cases"]) for row in rows} == {(str(SPLITS["valid"].start), "8", "3")}
    assert (shades(output / "frontier.png") < 128).any()
    assert cli.main([*command, "--policy", "second"]) == 0
    assert "first" not in capsys.readouterr().out


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
