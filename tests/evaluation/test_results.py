"""The page of results: what is on it was measured, and nothing is measured twice."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

from magat_cli import main as cli
from magat_evaluation import points
from magat_evaluation import results_page as results
from magat_evaluation.evaluate import Setting, evaluate_policy
from magat_evaluation.paper import beside_paper
from magat_evaluation.points import Point, bytes_per_step, measured
from magat_evaluation.report_files import read_csv, write_csv
from magat_evaluation.sets import TEST_SETS, StandardSet
from magat_evaluation.splits import SET_SEED, SPLITS
from magat_evaluation.studies import curves, studies
from magat_evaluation.studies.studies import Picture, Study
from magat_robot.policy import models
from magat_robot.policy.store import save
from magat_sim.simulator import Rules

QUIET = Console(quiet=True)
SMALL = StandardSet(8, 3, 4)


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The policies that were really measured, one after the other."""
    asked: list[Path] = []

    def measure(folder: Path, *rest: object) -> dict:
        asked.append(folder)
        return evaluate_policy(folder, *rest)

    monkeypatch.setattr(points, "evaluate_policy", measure)
    return asked


def study(policies: dict[str, Path], losses: tuple[float, ...] = (0.0, 0.5), which: StandardSet = SMALL) -> Study:
    each = [Point(name, policies[name], Setting(rules=Rules(loss)), which) for name in policies for loss in losses]
    picture = Picture("Losses", "", studies._draw_losses)
    return Study("losses", "Losses", "What is lost.", tuple(each), studies._loss_rows, (picture,))


def test_what_is_kept_is_what_was_measured(policies: dict[str, Path], tmp_path: Path) -> None:
    found = measured(study(policies).points, tmp_path / "losses.csv", QUIET)
    assert found == measured(study(policies).points, tmp_path / "losses.csv", QUIET)
    names = ["first", "first", "second", "second"]
    assert [(one["policy"], one["link_loss"]) for one in found] == list(zip(names, [0.0, 0.5] * 2, strict=True))
    for one in found:
        setting = Setting(rules=Rules(one["link_loss"]))
        alone = evaluate_policy(policies[one["policy"]], SPLITS["test"][:4], SET_SEED, setting, SMALL.size, QUIET)
        assert one == {name: alone.get(name) for name in one} | {"policy": one["policy"], "bytes_per_step": 100}
    assert len({one["delta_ft"] for one in found}) == 4


def test_a_point_that_is_there_is_not_measured_again(
    policies: dict[str, Path], tmp_path: Path, counted: list[Path], random_network: Callable
) -> None:
    path = tmp_path / "losses.csv"
    measured(study(policies).points, path, QUIET)
    assert len(counted) == 4
    before = path.read_text()
    measured(study(policies).points, path, QUIET)
    assert (len(counted), path.read_text()) == (4, before)
    # Another share, more cases, another map; other weights.
    for changed, new in (
        (study(policies, (0.0, 0.5, 0.75)), 2),
        (study(policies, which=StandardSet(8, 3, 5)), 4),
        (study(policies, which=StandardSet(9, 3, 5)), 4),
    ):
        counted.clear()
        measured(changed.points, path, QUIET)
        assert len(counted) == new
    counted.clear()
    save(random_network("MAGAT-F-16", seed=5), policies["second"], "# card\n")
    reports = measured(study(policies, which=StandardSet(9, 3, 5)).points, path, QUIET)
    assert counted == [policies["second"]] * 2
    assert len(reports) == 4


def test_what_was_measured_before_an_interruption_is_kept(
    policies: dict[str, Path], tmp_path: Path, counted: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "losses.csv"
    measured(study({"second": policies["second"]}).points, path, QUIET)
    working = points.evaluate_policy

    def interrupted(folder: Path, *rest: object) -> dict:
        if len(counted) == 3:
            raise KeyboardInterrupt
        return working(folder, *rest)

    monkeypatch.setattr(points, "evaluate_policy", interrupted)
    with pytest.raises(KeyboardInterrupt):
        measured(study(policies).points, path, QUIET)
    assert [(row["policy"], row["link_loss"]) for row in read_csv(path)] == [
        ("second", 0.0),
        ("second", 0.5),
        ("first", 0.0),
    ]
    monkeypatch.setattr(points, "evaluate_policy", working)
    measured(study(policies).points, path, QUIET)
    assert len(counted) == 4


def test_the_page_shows_each_study_with_its_picture_and_rows(policies: dict[str, Path], tmp_path: Path) -> None:
    page = results.results([study(policies)], ["losses"], tmp_path / "docs", QUIET)
    assert sorted(file.name for file in page.parent.iterdir()) == ["losses.csv", "losses.png", "results.md"]
    text = page.read_text()
    assert "## Losses\n\nWhat is lost.\n\n![Losses](losses.png)\n\n| map (robots) | policy | lost |" in text
    for report in read_csv(page.parent / "losses.csv"):
        low, high = report["alpha_interval"]
        named = f"| 8x8 (3) | {report['policy']} | {report['link_loss']:g} | 4 |"
        assert f"{named} {report['alpha']:.3f} ({low:.3f} to {high:.3f}) | {report['delta_ft']:.3f} ± " in text
    with Image.open(page.parent / "losses.png") as image:
        grey = np.asarray(image.convert("L"))
    assert 0.005 < (grey < 200).mean() < 0.3, "ink on white paper"


def test_bytes_are_those_that_a_robot_counts(
    policies: dict[str, Path], random_network: Callable, tmp_path: Path
) -> None:
    found = {encoding: bytes_per_step(policies["first"], encoding) for encoding in ("float32", "float16", "int8")}
    assert found == {"float32": 36 + 64, "float16": 36 + 32, "int8": 36 + 20}
    save(random_network("MAGAT-F-16-P2", taps=3, layers=2), tmp_path / "hops", "")
    assert bytes_per_step(tmp_path / "hops", "float16") == 4 * 36 + 2 * (16 + 3 * 16 + 32 + 3 * 32)


def test_the_studies_are_of_the_policies_given(policies: dict[str, Path]) -> None:
    for build in studies.STUDIES.values():
        built = build(policies)
        assert {point.policy for point in built.points if point.folder is not None} == set(policies)
        assert len(set(built.points)) == len(built.points)
    losses = studies.link_loss(policies).points
    assert {point.setting.rules.link_loss for point in losses} == {0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 1.0}
    assert min(point.cases.cases for point in losses) >= 200


def test_the_command_writes_the_page(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(models, "model_folders", lambda: iter([tmp_path / "models"]))
    monkeypatch.setattr(studies, "STUDIES", {"losses": study})
    assert cli.main(["results", "--policy", "second", "--output", str(tmp_path / "out")]) == 0
    assert "results.md" in capsys.readouterr().err
    page = (tmp_path / "out" / "results.md").read_text()
    assert "second" in page
    assert "first |" not in page
    assert cli.main(["results", "--policy", "nothing", "--output", str(tmp_path / "none")]) == 1
    assert not (tmp_path / "none").exists()


def test_studies_that_are_not_wanted_stay_as_they_were(
    policies: dict[str, Path], tmp_path: Path, counted: list[Path]
) -> None:
    docs = tmp_path / "docs"
    other = dataclasses.replace(study(policies, (0.5, 0.25)), name="other", title="Other")
    results.results([study(policies), other], ["losses"], docs, QUIET)
    assert "## Other" not in (docs / "results.md").read_text()
    assert len(counted) == 4
    page = results.results([study(policies), other], ["other"], docs, QUIET).read_text()
    assert len(counted) == 6, "what one study has measured, others need not"
    assert page.index("## Losses") < page.index("## Other")


def report(**changes: object) -> dict:
    """What there is of a point on 30 cases."""
    return {
        "policy": "a", "temperature": 0.75, "encoding": "int8", "link_loss": 0.0, "alpha": 0.9,
        "alpha_interval": (0.8, 0.95), "delta_ft": 0.1, "delta_ft_half_width": 0.01, "p_rg": 0.99,
        "alpha_strict": 0.8, "delta_ft_strict": 0.3, "cases": 30, "unsolved_by_expert": 0, "width": 100,
        "height": 100, "robots": 500, "density": 0.1, "seed": 1, "first_case": 0, "shield": "idle", "digest": "ab",
        "bytes_per_step": 164, "makespan": 200.5, "moves_blocked": 7.0, "stranded": {0: 27, 1: 2, 40: 1},
    } | changes  # fmt: skip


def test_a_file_holds_all_of_a_report_and_older_ones_what_they_have(tmp_path: Path) -> None:
    rows = [report(), report(shield="pibt", stranded={0: 30})]
    write_csv(rows, tmp_path / "rows.csv")
    assert read_csv(tmp_path / "rows.csv") == rows
    assert "0:27 1:2 40:1" in (tmp_path / "rows.csv").read_text()
    lines = [line.rsplit(",", 3)[0] for line in (tmp_path / "rows.csv").read_text().splitlines()]
    (tmp_path / "older.csv").write_text("\n".join(lines))
    older = read_csv(tmp_path / "older.csv")
    assert [one["stranded"] for one in older] == [{}, {}]
    assert all(np.isnan(one["makespan"]) and one["bytes_per_step"] == 164 for one in older)


def test_the_histogram_shows_in_which_share_of_the_cases_how_many_robots_arrived(tmp_path: Path) -> None:
    axes = Figure().add_subplot()
    curves._bars(axes, report(), 5, ["a", "b"])
    # Groups of five: 496 to 500 robots, and 456 to 460.
    assert [bar.get_height() for bar in axes.patches] == pytest.approx([29 / 30, 1 / 30])
    assert [bar.get_x() for bar in axes.patches] == pytest.approx([498 - 2, 458 - 2])
    assert [bar.get_width() for bar in axes.patches] == pytest.approx([2, 2])
    pictures = {
        "one": [report(), report(shield="pibt")],
        "with an older one": [report(stranded={}), report(), report(shield="pibt")],
        "other": [report(), report(shield="pibt", stranded={0: 10, 3: 20})],
        "alone": [report()],
    }
    for name, reports in pictures.items():
        curves.draw_arrivals(reports, tmp_path / name)
    drawn = {name: (tmp_path / name).read_bytes() for name in pictures}
    assert drawn["one"] == drawn["with an older one"]
    assert len(set(drawn.values())) == 3


def test_a_set_is_drawn_by_shield_and_in_the_order_of_its_sizes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines: list[tuple] = []
    monkeypatch.setattr(
        curves, "_line",
        lambda axes, number, points, across, measure: lines.append(
            (number, [across.value(p) for p in points], [measure.value(p) for p in points])
        ),
    )  # fmt: skip
    sizes = [report(), report(width=65, alpha=0.7, p_rg=0.5), report(policy="PIBT", shield="pibt", delta_ft=0.2)]
    studies._draw_set(sizes, tmp_path / "set.png")
    alpha, delta_ft, p_rg = ([line[2] for line in lines if line[0] == 0][i] for i in range(3))
    assert (alpha, delta_ft, p_rg) == ([0.9, 0.7], [0.1, 0.1], [0.99, 0.5])
    assert [values for number, _, values in lines if number == 1] == [[0.9], [0.2], [0.99]]
    assert [np.round(where).tolist() for number, where, _ in lines if number == 0] == [[0, 1]] * 3
    assert all(where[0] > 0 for number, where, _ in lines if number == 1), "side by side"


def test_a_test_set_is_of_policies_in_settings_and_of_baselines(policies: dict[str, Path]) -> None:
    settings = [Setting(), Setting(rules=Rules(shield="pibt"))]
    built = studies.test_set("large", policies, settings, ["PIBT"])
    assert [(p.cases.side, p.cases.robots, p.cases.expert_w) for p in built.points[::5]] == [
        (100, 500, 5.0),
        (200, 500, 5.0),
        (200, 1000, 5.0),
    ]
    shields = [(p.policy, p.setting.rules.shield) for p in built.points[:4]]
    assert shields == [("first", "idle"), ("first", "pibt"), ("second", "idle"), ("second", "pibt")]
    assert (built.points[4].policy, built.points[4].folder) == ("PIBT", None)
    assert {p.cases.cases for p in studies.with_cases(built, 7).points} == {7}


def of_maps(name: str, **changes: object) -> list[dict]:
    """Reports of all maps of a test set."""
    places = ({"width": w.side, "height": w.side, "robots": w.robots} for w in TEST_SETS[name])
    return [report(**(place | changes)) for place in places]


def test_the_papers_numbers_stand_beside_ours() -> None:
    good = {"policy": "MAGAT-B-32-P4", "alpha": 1.0, "alpha_interval": (0.99, 1.0), "delta_ft": 0.03, "p_rg": 1.0}
    worst = {"alpha": 0.5, "alpha_interval": (0.4, 0.6), "delta_ft": 0.2, "p_rg": 0.9}
    reports = of_maps("same-density", **good) + of_maps("increasing-density", **good)
    reports[3] |= worst  # 40x40 (40)
    reports[13] |= worst  # 50x50 (100)
    text = "\n".join(beside_paper(reports))
    assert "| alpha | 50x50 (100) | MAGAT-B-32-P4 | 0.95 | 0.500 (0.400 to 0.600) |  |  |" in text
    sixty = "| alpha | 50x50, 10 to 60 robots | MAGAT-B-32-P4 | above 0.92 (most MAGAT policies) |"
    assert f"{sixty} 1.000 (0.990 to 1.000), 50x50 (10) |  |  |" in text
    assert "| delta_FT | same-density | MAGAT-B-32-P4 | below 0.065 | 0.200 ± 0.010, 40x40 (40) |  |  |" in text
    aim = "| MAGAT-B-32-P4 | 0.75 | idle | 0.500 (0.400 to 0.600), 40x40 (40) | 0.200 ± 0.010, 40x40 (40) |"
    assert f"{aim}  | missed |" in text, "the large set was not measured, but what was is not enough"
    assert "p_rg" not in text
    assert "F-32-P4" not in text.split("|", 1)[1]


@pytest.mark.parametrize(
    ("changes", "large", "aim"),
    [
        ({}, True, "reached"),
        ({}, False, ""),
        ({"alpha": 0.985}, True, "missed"),
        ({"alpha": 0.985}, False, "missed"),
        ({"delta_ft": 0.081}, True, "missed"),
    ],
)
def test_whether_the_aim_is_reached_is_told(changes, large, aim) -> None:
    good = {"policy": "MAGAT-B-32-P4", "alpha": 0.99, "alpha_interval": (0.97, 1.0), "delta_ft": 0.08, "p_rg": 1.0}
    reports = of_maps("same-density", **good) + of_maps("increasing-density", **good)
    reports += of_maps("large", **good | {"alpha": 0.95}) if large else []
    reports[4] |= changes
    [row] = [
        line for line in "\n".join(beside_paper(reports)).splitlines() if line.startswith("| MAGAT-B-32-P4 | 0.75")
    ]
    assert row.split(" | ")[-1] == f"{aim} |", row


def test_what_was_not_measured_as_a_whole_is_not_told() -> None:
    some = of_maps("large", policy="GNN-F-128", shield="pibt")[:2]
    text = "\n".join(beside_paper(some))
    assert "| p_rg | 100x100 (500) | GNN-F-128 | 0.986 |  | 0.9900 |  |" in text
    assert "| p_rg | large |" not in text
    assert beside_paper(of_maps("large", policy="mine")) == []


def test_the_page_begins_with_the_comparison(policies: dict[str, Path], tmp_path: Path) -> None:
    large = studies.test_set("large", {"GNN-F-128": policies["first"]}, [Setting()], [])
    rows = of_maps("large", policy="GNN-F-128")
    write_csv(rows, tmp_path / "large.csv")
    page = results.results([large], [], tmp_path, QUIET).read_text()
    assert 0 < page.index("## Beside the paper") < page.index("## Test set: large")
    assert "| p_rg | large | GNN-F-128 | at least 0.986 | 0.9900, 100x100 (500) |  |  |" in page


def test_a_set_is_evaluated_by_name_and_resumed(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture,
    counted: list[Path],
) -> None:  # fmt: skip
    monkeypatch.setitem(TEST_SETS, "large", [SMALL, StandardSet(9, 3, 4, expert_w=5.0)])
    monkeypatch.chdir(tmp_path)
    command = ["evaluate", "--set", "large", "--cases", "3", "--json"]
    for policy in ("first", "first", "PIBT"):
        assert cli.main([*command, "--policy", str(policies.get(policy, policy))]) == 0
    first, again, pibt = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert len(counted) == 2
    assert first == again
    assert [(one["width"], one["cases"], one["shield"]) for one in first] == [(8, 3, "idle"), (9, 3, "idle")]
    assert [(one["policy"], one["shield"], one["digest"]) for one in pibt] == [("PIBT", "pibt", "")] * 2
    assert len(read_csv(Path("runs/sets/large.csv"))) == 4
