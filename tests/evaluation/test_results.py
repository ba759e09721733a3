# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of results: what is on it was measured, and nothing is measured twice."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from example_report import report
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

from magat_cli import main as cli
from magat_evaluation import points
from magat_evaluation import results_page as results
from magat_evaluation.baselines import BASELINES
from magat_evaluation.candidates import Candidate, Setting, bytes_per_step
from magat_evaluation.evaluate import evaluate_candidate
from magat_evaluation.points import Point, measure_points
from magat_evaluation.report import Report
from magat_evaluation.report_files import read_csv, write_csv
from magat_evaluation.sets import TEST_SETS, CaseSet
from magat_evaluation.studies import curves, link_loss, test_sets
from magat_evaluation.studies import study as studies
from magat_evaluation.studies.study import Picture, Study, all_studies
from magat_evaluation.tables import MEASURES
from magat_robot.policy import models
from magat_robot.policy.models import all_policies
from magat_robot.policy.store import save
from magat_sim.shield import SHIELD_VERSIONS, SHIELDS
from magat_sim.simulator import Rules

QUIET = Console(quiet=True)
SMALL = CaseSet.square(8, 3, 4)
DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The policies that were really measured, one after the other."""
    asked: list[str] = []

    def measure(candidate: Candidate, *rest: object) -> Report:
        asked.append(candidate.name)
        return evaluate_candidate(candidate, *rest)

    monkeypatch.setattr(points, "evaluate_candidate", measure)
    return asked


def candidate(policies: dict[str, Path], name: str, loss: float) -> Candidate:
    return Candidate.of_policy(policies[name], Setting(rules=Rules(loss)), name)


def study(policies: dict[str, Path], losses: tuple[float, ...] = (0.0, 0.5), which: CaseSet = SMALL) -> Study:
    each = [Point(candidate(policies, name, loss), which) for name in policies for loss in losses]
    heading = ("map (robots)", "policy", "lost", "cases", *MEASURES)
    return Study("losses", "Losses", tuple(each), heading, link_loss.row, (Picture("Losses", "", link_loss.draw),))


def test_what_is_kept_is_what_was_measured(policies: dict[str, Path], tmp_path: Path) -> None:
    found = measure_points(study(policies).points, tmp_path / "losses.csv", QUIET)
    assert found == measure_points(study(policies).points, tmp_path / "losses.csv", QUIET)
    names = ["first", "first", "second", "second"]
    assert [(one.policy, one.link_loss) for one in found] == list(zip(names, [0.0, 0.5] * 2, strict=True))
    for one in found:
        alone = evaluate_candidate(candidate(policies, one.policy, one.link_loss), SMALL, QUIET)
        assert one == dataclasses.replace(alone, seconds=None)
        assert one.bytes_per_step == 100
    assert len({one.delta_ft for one in found}) == 4


def test_a_point_that_is_there_is_not_measured_again(
    policies: dict[str, Path], tmp_path: Path, counted: list[str], random_network: Callable
) -> None:
    path = tmp_path / "losses.csv"
    measure_points(study(policies).points, path, QUIET)
    assert len(counted) == 4
    before = path.read_text()
    measure_points(study(policies).points, path, QUIET)
    assert (len(counted), path.read_text()) == (4, before)
    # Another share, more cases, another map, another bound of the expert; other weights.
    for changed, new in (
        (study(policies, (0.0, 0.5, 0.75)), 2),
        (study(policies, which=CaseSet.square(8, 3, 5)), 4),
        (study(policies, which=CaseSet.square(9, 3, 5)), 4),
        (study(policies, which=CaseSet.square(9, 3, 5, expert_w=5.0)), 4),
    ):
        counted.clear()
        measure_points(changed.points, path, QUIET)
        assert len(counted) == new
    counted.clear()
    save(random_network("MAGAT-F-16", seed=5), policies["second"], "# card\n")
    reports = measure_points(study(policies, which=CaseSet.square(9, 3, 5)).points, path, QUIET)
    assert counted == ["second"] * 2
    assert len(reports) == 4


def test_a_point_is_measured_again_after_a_change_of_shield_or_cases(
    policies: dict[str, Path], tmp_path: Path, counted: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, which = tmp_path / "losses.csv", study({"first": policies["first"]}, (0.0,)).points
    measure_points(which, path, QUIET)
    monkeypatch.setattr("magat_evaluation.candidates.SHIELD_VERSIONS", {**SHIELD_VERSIONS, "pibt": 2})
    measure_points(which, path, QUIET)
    assert len(counted) == 1, "of another shield"
    monkeypatch.setattr("magat_evaluation.candidates.SHIELD_VERSIONS", {**SHIELD_VERSIONS, "idle": 2})
    measure_points(which, path, QUIET)
    assert len(counted) == 2
    monkeypatch.setattr("magat_evaluation.candidates.GENERATOR_VERSION", 1_000)
    measure_points(which, path, QUIET)
    assert len(counted) == 3


def test_each_shield_has_a_version() -> None:
    assert SHIELD_VERSIONS.keys() == SHIELDS.keys()


def test_nothing_on_the_page_of_results_is_measured_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(points, "evaluate_candidate", lambda *_: pytest.fail("measured again"))
    policies = all_policies()
    for name, make in all_studies().items():
        built, path = make(policies), tmp_path / f"{name}.csv"
        rows = built.current(read_csv(DOCS / path.name))
        kept = {report.key for report in rows if report.policy in (*policies, *BASELINES)}
        counts = {report.key.cases for report in rows}
        asked = [point for most in counts for point in built.select(policies, most=most)]
        known = list({point.key: point for point in asked if point.key in kept}.values())
        assert len(known) == len(kept)
        write_csv(rows, path)
        assert len(measure_points(known, path, QUIET)) == len(kept)


def test_the_page_of_results_is_printed_again_from_its_files(tmp_path: Path) -> None:
    for file in DOCS.glob("*.csv"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    assert cli.main(["results", "--no-measure", "--output", str(tmp_path)]) == 0
    assert (tmp_path / "results.md").read_bytes() == (DOCS / "results.md").read_bytes()


def test_what_was_measured_before_an_interruption_is_kept(
    policies: dict[str, Path], tmp_path: Path, counted: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "losses.csv"
    measure_points(study({"second": policies["second"]}).points, path, QUIET)
    working = points.evaluate_candidate

    def interrupted(*arguments: object) -> Report:
        if len(counted) == 3:
            raise KeyboardInterrupt
        return working(*arguments)

    monkeypatch.setattr(points, "evaluate_candidate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        measure_points(study(policies).points, path, QUIET)
    assert [(row.policy, row.link_loss) for row in read_csv(path)] == [
        ("second", 0.0),
        ("second", 0.5),
        ("first", 0.0),
    ]
    monkeypatch.setattr(points, "evaluate_candidate", working)
    measure_points(study(policies).points, path, QUIET)
    assert len(counted) == 4


def written(studies: list[Study], names: list[str], docs: Path, policies: dict[str, Path]) -> Path:
    """The page, after all points of the named studies were measured."""
    asked = {one.name: one.points for one in studies if one.name in names}
    return results.write_results(studies, policies, asked, docs, QUIET)


def test_the_page_shows_each_study_with_its_picture_and_rows(policies: dict[str, Path], tmp_path: Path) -> None:
    page = written([study(policies)], ["losses"], tmp_path / "docs", policies)
    files = ["losses-cases.csv", "losses.csv", "losses.png", "results.md"]
    assert sorted(file.name for file in page.parent.iterdir()) == files
    text = page.read_text()
    assert "## Losses\n\n![Losses](losses.png)\n\n| map (robots) | policy | lost |" in text
    for row in read_csv(page.parent / "losses.csv"):
        low, high = row.alpha_interval
        named = f"| 8x8 (3) | {row.policy} | {row.link_loss:g} | 4 |"
        assert f"{named} {row.alpha:.3f} ({low:.3f} to {high:.3f}) | {row.delta_ft:.3f} ± " in text
    with Image.open(page.parent / "losses.png") as image:
        grey = np.asarray(image.convert("L"))
    assert 0.005 < (grey < 200).mean() < 0.3, "ink on white paper"


def test_bytes_are_those_that_a_robot_counts(random_network: Callable) -> None:
    config = random_network("MAGAT-F-16").config
    encodings = ("float32", "float16", "int8")
    found = {encoding: bytes_per_step(config.with_changes(encoding=encoding)) for encoding in encodings}
    assert found == {"float32": 36 + 64, "float16": 36 + 32, "int8": 36 + 20}
    hops = random_network("MAGAT-F-16-P2", taps=3, layers=2).config.with_changes(encoding="float16")
    assert bytes_per_step(hops) == 4 * 36 + 2 * (16 + 3 * 16 + 32 + 3 * 32)


def test_the_studies_are_of_the_policies_given(policies: dict[str, Path]) -> None:
    for name, make in all_studies().items():
        built = make(policies)
        assert built.name == name
        assert {point.candidate.name for point in built.points if point.candidate.digest} == set(policies)
        assert len({point.key for point in built.points}) == len(built.points)
    losses = link_loss.link_loss(policies).points
    assert {point.candidate.rules.link_loss for point in losses} == {0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 1.0}
    assert min(point.cases.cases for point in losses) >= 200


def test_the_command_writes_the_page(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(models, "model_folders", lambda: iter([tmp_path / "models"]))
    monkeypatch.setattr(studies, "all_studies", lambda: {"losses": study})
    command = ["results", "--study", "losses", "--output", str(tmp_path / "out")]
    assert cli.main([*command, "--policy", "second"]) == 0
    assert "results.md" in capsys.readouterr().err
    page = (tmp_path / "out" / "results.md").read_text()
    assert "| 8x8 (3) | second |" in page
    assert "| 8x8 (3) | first |" not in page
    assert cli.main([*command, "--policy", "first"]) == 0
    both = (tmp_path / "out" / "results.md").read_text()
    assert both.count("| 8x8 (3) | first |") == both.count("| 8x8 (3) | second |") == 2, "what is not named stays"
    assert cli.main([*command, "--policy", "first", "--shield", "pibt"]) == 0
    before = {file.name: file.read_bytes() for file in (tmp_path / "out").iterdir()}
    monkeypatch.setattr(points, "evaluate_candidate", lambda *_: pytest.fail("measured"))
    assert cli.main(["results", "--no-measure", "--output", str(tmp_path / "out")]) == 0
    assert {file.name: file.read_bytes() for file in (tmp_path / "out").iterdir()} == before
    assert cli.main(["results", "--no-measure", "--cases", "3", "--output", str(tmp_path / "out")]) == 1
    assert cli.main(["results", "--policy", "nothing", "--output", str(tmp_path / "none")]) == 1
    assert not (tmp_path / "none").exists()


def test_studies_that_are_not_asked_for_stay_as_they_were(
    policies: dict[str, Path], tmp_path: Path, counted: list[str]
) -> None:
    docs = tmp_path / "docs"
    other = dataclasses.replace(study(policies, (0.5, 0.25)), name="other", title="Other")
    written([study(policies), other], ["losses"], docs, policies)
    assert "## Other" not in (docs / "results.md").read_text()
    assert len(counted) == 4
    page = written([study(policies), other], ["other"], docs, policies).read_text()
    assert len(counted) == 6, "what one study has measured, others need not"
    assert page.index("## Losses") < page.index("## Other")


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
    test_sets.draw(sizes, tmp_path / "set.png")
    alpha, delta_ft, p_rg = ([line[2] for line in lines if line[0] == 0][i] for i in range(3))
    assert (alpha, delta_ft, p_rg) == ([0.9, 0.7], [0.1, 0.1], [0.99, 0.5])
    assert [values for number, _, values in lines if number == 1] == [[0.9], [0.2], [0.99]]
    assert [np.round(where).tolist() for number, where, _ in lines if number == 0] == [[0, 1]] * 3
    assert all(where[0] > 0 for number, where, _ in lines if number == 1), "side by side"


def test_a_test_set_is_of_policies_controls_and_baselines_under_each_shield(
    policies: dict[str, Path], tmp_path: Path, random_network: Callable
) -> None:
    silent = {"MAGAT-F-16-K1": tmp_path / "models" / "MAGAT-F-16-K1"}
    save(random_network("MAGAT-F-16", taps=1), silent["MAGAT-F-16-K1"], "# card\n")
    large = test_sets.full_test_set("large", policies | silent).points
    sizes = [(100, 500, 5.0), (200, 500, 5.0), (200, 1000, 5.0)]
    assert [(p.cases.width, p.cases.robots, p.cases.expert_w) for p in large if p.candidate.name == "expert"] == sizes
    here = [p.candidate for p in large if p.cases.width == 100]
    for shield, planners in (("idle", {"expert", "greedy"}), ("pibt", {"PIBT", "greedy"}), ("pibt-memory", {"greedy"})):
        found = {(one.name, one.rules.link_loss) for one in here if one.rules.shield == shield}
        mute = {(name, 1.0) for name in policies}
        assert found == {(name, 0.0) for name in (*planners, *policies, *silent)} | mute, "K = 1 is mute as it is"
    dense = test_sets.full_test_set("same-density", policies).points
    assert {"HCA", "Replan"} < {point.candidate.name for point in dense}
    assert dense[0].candidate.rules.shield == "idle"
    assert all(point.cases.numbers[0] == 26_000 for point in (*large, *dense))


def test_policies_that_are_trained_several_times_have_more_cases(policies: dict[str, Path]) -> None:
    named = {"GNN-F-128": policies["first"], "GNN-F-128-S1": policies["first"], "GNN-F-64": policies["second"]}
    points_of_set = test_sets.full_test_set("increasing-density", named).points
    many = {(p.candidate.name, p.cases.robots, p.candidate.rules) for p in points_of_set if p.cases.cases == 1000}
    assert many == {(name, 60, Rules()) for name in ("GNN-F-128", "GNN-F-128-S1")}
    assert {point.cases.cases for point in points_of_set} == {200, 1000}


def test_some_points_of_a_study_can_be_selected(policies: dict[str, Path]) -> None:
    large = test_sets.full_test_set("large", policies)
    some = large.select({"first"}, {"pibt"}, most=7)
    assert {(p.candidate.name, p.candidate.rules.shield, p.cases.cases) for p in some} == {
        (name, "pibt", 7) for name in ("first", "PIBT", "greedy")
    }
    assert large.select(policies) == list(large.points)


def test_rows_that_no_longer_hold_are_left_out(policies: dict[str, Path]) -> None:
    built = study(policies, (0.0,))
    first, second = (point.key for point in built.points)
    good, other = (report(**dataclasses.asdict(key), unsolved_by_expert=0) for key in (first, second))
    training = dataclasses.replace(good, policy="GNN-F-128-S1", digest="ef")
    changes = ({"digest": "ab"}, {"temperature": 0.1}, {"first_case": 25_501}, {"shield_version": 0}, {"robots": 4})
    wrong = [dataclasses.replace(good, **change) for change in changes]
    wrong.append(dataclasses.replace(training, generator_version=0))
    fewer = dataclasses.replace(other, cases=2)
    assert built.current([training, fewer, *wrong, good]) == [good, fewer, training]


def test_a_set_is_evaluated_by_name_and_resumed(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture,
    counted: list[str],
) -> None:  # fmt: skip
    monkeypatch.setitem(TEST_SETS, "large", [SMALL, CaseSet.square(9, 3, 4, expert_w=5.0)])
    monkeypatch.chdir(tmp_path)
    command = ["evaluate", "--set", "large", "--cases", "3", "--json"]
    for policy in ("first", "first", "PIBT"):
        assert cli.main([*command, "--policy", str(policies.get(policy, policy))]) == 0
    first, again, pibt = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert counted == ["first", "first", "PIBT", "PIBT"]
    assert first == again
    assert [(one["width"], one["cases"], one["shield"]) for one in first] == [(8, 3, "idle"), (9, 3, "idle")]
    assert [(one["policy"], one["shield"], one["digest"]) for one in pibt] == [("PIBT", "pibt", "")] * 2
    assert len(read_csv(Path("runs/sets/large.csv"))) == 4
