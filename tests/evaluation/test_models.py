# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The list of policies: all that are there, verified, with what was measured of them."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from safetensors.torch import load_file

from magat_cli import main as cli
from magat_evaluation.listing import describe, listing
from magat_evaluation.measures_file import MEASURES, measure
from magat_evaluation.sets import CaseSet
from magat_robot.policy import models
from magat_robot.policy.config import ModelError
from magat_robot.policy.models import all_policies
from magat_robot.policy.store import CONFIG, WEIGHTS, save


@pytest.fixture(scope="module")
def measured_folder(tmp_path_factory: pytest.TempPathFactory, random_network: Callable) -> Path:
    """A policy that was measured on a tiny set; not to be changed."""
    folder = tmp_path_factory.mktemp("measured")
    save(random_network("MAGAT-F-16", temperature=0.5), folder, "# card\n")
    measure(folder, [CaseSet.square(8, 3, 4)], Console(quiet=True))
    return folder


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, measured_folder: Path) -> Path:
    """The only folder of models, with the measured policy in it and what is none."""
    (tmp_path / "good").mkdir()
    for file in measured_folder.iterdir():
        (tmp_path / "good" / file.name).write_bytes(file.read_bytes())
    (tmp_path / "empty").mkdir()
    (tmp_path / "README.md").write_text("policies")
    monkeypatch.setattr(models, "model_folders", lambda: iter([tmp_path, tmp_path / "nowhere"]))
    monkeypatch.setenv("COLUMNS", "100")
    return tmp_path


def damage(folder: Path) -> None:
    data = bytearray((folder / WEIGHTS).read_bytes())
    data[-1] ^= 1
    (folder / WEIGHTS).write_bytes(data)


def words(text: str) -> list[list[str]]:
    return [line.split() for line in text.splitlines()]


def test_the_list_says_what_a_policy_is_and_how_good(here: Path, capsys: Any) -> None:
    assert cli.main(["models"]) == 0
    output = capsys.readouterr().out
    digest = json.loads((here / "good" / CONFIG).read_text())["sha256"]
    (measures,) = json.loads((here / "good" / MEASURES).read_text())
    tensors = load_file(here / "good" / WEIGHTS)
    trained = sum(t.numel() for name, t in tensors.items() if "running_" not in name and "num_batches" not in name)
    lines = words(output)
    assert ["good", digest[:12], "0.5", "16", "100", f"{trained:,}", "1"] in lines
    assert ["8x8", "(3)"] in lines
    low, high = measures["alpha_interval"]
    assert f"{measures['alpha']:.3f} ({low:.3f} to {high:.3f})" in output
    assert f"{measures['delta_ft']:.3f} ± {measures['delta_ft_half_width']:.3f}" in output
    assert "empty" not in output
    assert "stale" not in output


def test_json_says_the_same(here: Path, capsys: Any) -> None:
    assert cli.main(["models", "--json"]) == 0
    (policy,) = json.loads(capsys.readouterr().out)
    (measures,) = json.loads((here / "good" / MEASURES).read_text())
    assert policy == json.loads(json.dumps(describe("good", here / "good").to_json()))
    assert (policy["name"], policy["policy"], policy["error"]) == ("good", "MAGAT-F-16", None)
    assert (policy["temperature"], policy["floats"], policy["bytes"]) == (0.5, 16, 36 + 64)
    assert policy["measures"] == [measures | {"stale": False}]


@pytest.mark.parametrize("arguments", [["models"], ["models", "--json"]])
def test_a_damaged_policy_is_listed_with_the_reason_and_fails(here: Path, capsys: Any, arguments: list[str]) -> None:
    (here / "good").rename(here / "sound")
    (here / "broken").mkdir()
    for name in (WEIGHTS, CONFIG):
        (here / "broken" / name).write_bytes((here / "sound" / name).read_bytes())
    assert cli.main(arguments) == 0
    capsys.readouterr()
    damage(here / "broken")
    assert cli.main(arguments) == 1
    output = capsys.readouterr().out
    assert "is damaged or of another policy" in " ".join(output.split())
    assert "broken" in output
    assert "sound" in output, "one bad policy hides no good one"


def test_what_is_damaged_is_red(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    damage(here / "good")
    console = Console(width=300, force_terminal=True, color_system="standard", no_color=False)
    with console.capture() as capture:
        console.print(listing([describe("good", here / "good")]))
    assert "\x1b[31mgood\x1b[0m" in capture.get()
    assert "\x1b[31mgood: " in capture.get()


@pytest.mark.parametrize("name", [WEIGHTS, CONFIG])
def test_half_a_policy_is_listed_as_damaged(here: Path, capsys: Any, name: str) -> None:
    (here / "good" / name).unlink()
    assert cli.main(["models"]) == 1
    assert f"{name} is missing" in " ".join(capsys.readouterr().out.split())


def test_damaged_measures_are_no_secret(here: Path, capsys: Any) -> None:
    (here / "good" / MEASURES).write_text("[{]")
    assert cli.main(["models"]) == 1
    assert f"{MEASURES} cannot be read" in " ".join(capsys.readouterr().out.split())


def test_measures_of_other_weights_are_listed_as_stale(here: Path, capsys: Any, random_network: Callable) -> None:
    old = json.loads((here / "good" / MEASURES).read_text())[0]["digest"]
    save(random_network("MAGAT-F-16", seed=1), here / "good", "# trained again\n")
    assert cli.main(["models"]) == 0
    output = capsys.readouterr().out
    assert "none, 1 stale" in output
    assert f"stale, of {old[:12]}" in output
    assert describe("good", here / "good").to_json()["measures"][0]["stale"]


def test_a_policy_that_was_never_measured_is_listed(here: Path, capsys: Any) -> None:
    (here / "good" / MEASURES).unlink()
    assert cli.main(["models"]) == 0
    assert words(capsys.readouterr().out)[1][-1] == "none"


def test_one_name_in_two_folders_leads_to_each_of_them(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "more").mkdir()
    (here / "more" / "good").symlink_to(here / "good")
    (here / "more" / "other").symlink_to(here / "good")
    monkeypatch.setattr(models, "model_folders", lambda: iter([here, here / "more", here]))
    found = all_policies()
    assert list(found) == ["good", str(here / "more" / "good"), "other"]
    assert found["good"] == here / "good"


def test_no_policies_at_all_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(models, "model_folders", lambda: iter([tmp_path]))
    with pytest.raises(ModelError, match=f"no policies in {tmp_path}"):
        all_policies()
    assert cli.main(["models"]) == 1
