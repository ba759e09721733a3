"""The page of results: what is on it was measured, and nothing is measured twice."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from magat_bringup import cli, models, results
from magat_bringup.evaluation import Setting, evaluate_policy
from magat_bringup.measured import StandardSet
from magat_bringup.results import Point, Study
from magat_robot.policy.store import save
from magat_sim.simulator import Rules
from magat_training.cases import SET_SEED, SPLITS

QUIET = Console(quiet=True)
SMALL = StandardSet(8, 3, 4)


@pytest.fixture
def policies(tmp_path: Path, random_network: Callable) -> dict[str, Path]:
    """Two policies."""
    folders = {name: tmp_path / "models" / name for name in ("first", "second")}
    for seed, folder in enumerate(folders.values()):
        save(random_network("MAGAT-F-16", seed=seed), folder, "# card\n")
    return folders


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The policies that were really measured, one after the other."""
    asked: list[Path] = []

    def measure(folder: Path, *rest: object) -> dict:
        asked.append(folder)
        return evaluate_policy(folder, *rest)

    monkeypatch.setattr(results, "evaluate_policy", measure)
    return asked


def study(policies: dict[str, Path], losses: tuple[float, ...] = (0.0, 0.5), which: StandardSet = SMALL) -> Study:
    points = [Point(name, policies[name], Setting(rules=Rules(loss)), which) for name in policies for loss in losses]
    return Study("losses", "Losses", "What is lost.", tuple(points), results._loss_rows, results._draw_losses)


def test_what_is_kept_is_what_was_measured(policies: dict[str, Path], tmp_path: Path) -> None:
    measured = results.measured(study(policies), tmp_path / "losses.csv", QUIET)
    again = results.measured(study(policies), tmp_path / "losses.csv", QUIET)
    names = ["first", "first", "second", "second"]
    assert [(one["policy"], one["link_loss"]) for one in measured] == list(zip(names, [0.0, 0.5] * 2, strict=True))
    for fresh, kept in zip(measured, again, strict=True):
        setting = Setting(rules=Rules(fresh["link_loss"]))
        alone = evaluate_policy(policies[fresh["policy"]], SPLITS["test"][:4], SET_SEED, setting, SMALL.size, QUIET)
        assert {name: fresh[name] for name in kept} == kept
        assert {name: alone[name] for name in kept if name != "policy"} == {
            k: v for k, v in kept.items() if k != "policy"
        }
    assert len({one["delta_ft"] for one in measured}) == 4


def test_a_point_that_is_there_is_not_measured_again(
    policies: dict[str, Path], tmp_path: Path, counted: list[Path], random_network: Callable
) -> None:
    path = tmp_path / "losses.csv"
    results.measured(study(policies), path, QUIET)
    assert len(counted) == 4
    before = path.read_text()
    results.measured(study(policies), path, QUIET)
    assert (len(counted), path.read_text()) == (4, before)
    # Another share, more cases, another map; other weights.
    for changed, new in (
        (study(policies, (0.0, 0.5, 0.75)), 2),
        (study(policies, which=StandardSet(8, 3, 5)), 4),
        (study(policies, which=StandardSet(9, 3, 5)), 4),
    ):
        counted.clear()
        results.measured(changed, path, QUIET)
        assert len(counted) == new
    counted.clear()
    save(random_network("MAGAT-F-16", seed=5), policies["second"], "# card\n")
    reports = results.measured(study(policies, which=StandardSet(9, 3, 5)), path, QUIET)
    assert counted == [policies["second"]] * 2
    assert len(results.read_csv(path)) == len(reports) == 4, "rows of other weights are gone"


def test_what_was_measured_before_an_interruption_is_kept(
    policies: dict[str, Path], tmp_path: Path, counted: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "losses.csv"
    results.measured(study({"second": policies["second"]}), path, QUIET)
    working = results.evaluate_policy

    def interrupted(folder: Path, *rest: object) -> dict:
        if len(counted) == 3:
            raise KeyboardInterrupt
        return working(folder, *rest)

    monkeypatch.setattr(results, "evaluate_policy", interrupted)
    with pytest.raises(KeyboardInterrupt):
        results.measured(study(policies), path, QUIET)
    assert [(row["policy"], row["link_loss"]) for row in results.read_csv(path)] == [
        ("second", 0.0),
        ("second", 0.5),
        ("first", 0.0),
    ]
    monkeypatch.setattr(results, "evaluate_policy", working)
    results.measured(study(policies), path, QUIET)
    assert len(counted) == 4


def test_the_page_shows_each_study_with_its_picture_and_rows(policies: dict[str, Path], tmp_path: Path) -> None:
    page = results.results([study(policies)], tmp_path / "docs", QUIET)
    assert sorted(file.name for file in page.parent.iterdir()) == ["losses.csv", "losses.png", "results.md"]
    text = page.read_text()
    assert "## Losses\n\nWhat is lost.\n\n![Losses](losses.png)\n\n| map (robots) | policy | lost |" in text
    for report in results.read_csv(page.parent / "losses.csv"):
        low, high = report["alpha_interval"]
        named = f"| 8x8 (3) | {report['policy']} | {report['link_loss']:g} | 4 |"
        assert f"{named} {report['alpha']:.3f} ({low:.3f} to {high:.3f}) | {report['delta_ft']:.3f} ± " in text
    with Image.open(page.parent / "losses.png") as image:
        grey = np.asarray(image.convert("L"))
    assert 0.005 < (grey < 200).mean() < 0.3, "ink on white paper"


def test_bytes_are_those_that_a_robot_counts(
    policies: dict[str, Path], random_network: Callable, tmp_path: Path
) -> None:
    found = {
        encoding: results.bytes_per_step(policies["first"], encoding) for encoding in ("float32", "float16", "int8")
    }
    assert found == {"float32": 36 + 64, "float16": 36 + 32, "int8": 36 + 20}
    save(random_network("MAGAT-F-16-P2", taps=3, layers=2), tmp_path / "hops", "")
    assert results.bytes_per_step(tmp_path / "hops", "float16") == 4 * 36 + 2 * (16 + 3 * 16 + 32 + 3 * 32)


def test_the_studies_are_of_the_policies_given(policies: dict[str, Path]) -> None:
    for build in results.STUDIES:
        built = build(policies)
        assert {point.policy for point in built.points} == set(policies)
        assert len(set(built.points)) == len(built.points)
    losses = results.link_loss(policies).points
    assert {point.setting.rules.link_loss for point in losses} == {0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 1.0}
    assert min(point.cases.cases for point in losses) >= 200


def test_the_command_writes_the_page(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(models, "model_folders", lambda: iter([tmp_path / "models"]))
    monkeypatch.setattr(results, "STUDIES", [study])
    assert cli.main(["results", "--policy", "second", "--output", str(tmp_path / "out")]) == 0
    assert "results.md" in capsys.readouterr().err
    page = (tmp_path / "out" / "results.md").read_text()
    assert "second" in page
    assert "first |" not in page
    assert cli.main(["results", "--policy", "nothing", "--output", str(tmp_path / "none")]) == 1
    assert not (tmp_path / "none").exists()
