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
from magat_evaluation.candidates import Candidate, Setting, bytes_per_step
from magat_evaluation.evaluate import evaluate_candidate
from magat_evaluation.paper import aims_table, claims_table
from magat_evaluation.points import Point, measure_points
from magat_evaluation.report import Report
from magat_evaluation.report_files import ReportFileError, read_csv, write_csv
from magat_evaluation.sets import TEST_SETS, CaseSet
from magat_evaluation.studies import curves, link_loss, test_sets
from magat_evaluation.studies import study as studies
from magat_evaluation.studies.study import Picture, Study, all_studies
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
    heading = ("map (robots)", "policy", "lost", "cases", "alpha", "delta_FT", "p_rg")
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


def test_nothing_of_the_page_of_results_is_measured_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(points, "evaluate_candidate", lambda *_: pytest.fail("measured again"))
    for name, make in all_studies().items():
        kept = {report.key for report in read_csv(DOCS / f"{name}.csv")}
        built = make(all_policies())
        asked = [*built.points, *built.with_cases(200).points]
        known = list({point.key: point for point in asked if point.key in kept}.values())
        assert len(known) == len(kept), f"{name}.csv has rows of other weights, shields or cases"
        path = tmp_path / f"{name}.csv"
        path.write_bytes((DOCS / path.name).read_bytes())
        assert len(measure_points(known, path, QUIET)) == len(kept)
        assert path.read_bytes() == (DOCS / path.name).read_bytes()


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


def test_the_page_shows_each_study_with_its_picture_and_rows(policies: dict[str, Path], tmp_path: Path) -> None:
    page = results.write_results([study(policies)], ["losses"], tmp_path / "docs", QUIET)
    assert sorted(file.name for file in page.parent.iterdir()) == ["losses.csv", "losses.png", "results.md"]
    text = page.read_text()
    assert "## Losses\n\n![Losses](losses.png)\n\n| map (robots) | policy | lost |" in text
    for report in read_csv(page.parent / "losses.csv"):
        low, high = report.alpha_interval
        named = f"| 8x8 (3) | {report.policy} | {report.link_loss:g} | 4 |"
        assert f"{named} {report.alpha:.3f} ({low:.3f} to {high:.3f}) | {report.delta_ft:.3f} ± " in text
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
    assert cli.main(["results", "--policy", "second", "--output", str(tmp_path / "out")]) == 0
    assert "results.md" in capsys.readouterr().err
    page = (tmp_path / "out" / "results.md").read_text()
    assert "second" in page
    assert "first |" not in page
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
    results.write_results([study(policies), other], ["losses"], docs, QUIET)
    assert "## Other" not in (docs / "results.md").read_text()
    assert len(counted) == 4
    page = results.write_results([study(policies), other], ["other"], docs, QUIET).read_text()
    assert len(counted) == 6, "what one study has measured, others need not"
    assert page.index("## Losses") < page.index("## Other")


def report(**changes: object) -> Report:
    """What there is of a point on 30 cases."""
    values = {
        "policy": "a", "temperature": 0.75, "encoding": "int8", "link_loss": 0.0, "alpha": 0.9,
        "alpha_interval": (0.8, 0.95), "alpha_strict": 0.8, "alpha_strict_interval": (0.7, 0.9), "delta_ft": 0.1,
        "delta_ft_half_width": 0.01, "p_rg": 0.99, "delta_ft_strict": 0.3, "cases": 30, "unsolved_by_expert": 2,
        "width": 100, "height": 100, "robots": 500, "density": 0.1, "expert_w": 5.0, "generator_version": 1, "seed": 1,
        "first_case": 0, "shield": "idle", "shield_version": 3, "digest": "ab", "bytes_per_step": 164,
        "makespan": 200.5, "moves_blocked": 7.0, "stranded": {0: 27, 1: 2, 40: 1},
    }  # fmt: skip
    return Report(**values | changes)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"shield": "pibt", "stranded": {0: 30}},
        {"delta_ft_half_width": None, "makespan": None, "moves_blocked": None, "stranded": {}, "bytes_per_step": None},
        {"policy": "PIBT, of others", "digest": "", "encoding": ""},
    ],
)
def test_files_hold_all_of_a_report(tmp_path: Path, changes: dict[str, object]) -> None:
    rows = [report(**changes)]
    write_csv(rows, tmp_path / "rows.csv")
    assert read_csv(tmp_path / "rows.csv") == rows
    assert "nan" not in (tmp_path / "rows.csv").read_text()
    assert [Report.from_json(json.loads(json.dumps(row.to_json(), allow_nan=False))) for row in rows] == rows


def test_the_cases_of_a_key_are_those_that_were_asked_for() -> None:
    assert report().key.cases == 32
    assert report().key != report(expert_w=1.1).key
    assert report().key == report(alpha=0.5, cases=32, unsolved_by_expert=0).key


@pytest.mark.parametrize(("column", "value"), [("expert_w", ""), ("robots", "5.0"), ("alpha_low", "x")])
def test_a_damaged_file_is_refused_with_its_line(tmp_path: Path, column: str, value: str) -> None:
    write_csv([report(), report(shield="pibt")], tmp_path / "rows.csv")
    heading, first, second = (line.split(",") for line in (tmp_path / "rows.csv").read_text().splitlines())
    second[heading.index(column)] = value
    (tmp_path / "rows.csv").write_text("\n".join(map(",".join, (heading, first, second))))
    with pytest.raises(ReportFileError, match=r"rows\.csv cannot be read, line 3: .*Delete the file"):
        read_csv(tmp_path / "rows.csv")


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


def test_a_test_set_is_of_policies_in_settings_and_of_baselines(policies: dict[str, Path]) -> None:
    built = test_sets.full_test_set("large", policies)
    each = len(SHIELDS) * 2 + 1
    assert [(p.cases.width, p.cases.robots, p.cases.expert_w) for p in built.points[::each]] == [
        (100, 500, 5.0),
        (200, 500, 5.0),
        (200, 1000, 5.0),
    ]
    shields = [(p.candidate.name, p.candidate.rules.shield) for p in built.points[: each - 1]]
    assert shields == [(name, shield) for name in policies for shield in SHIELDS]
    assert (built.points[each - 1].candidate.name, built.points[each - 1].candidate.digest) == ("PIBT", "")
    assert {p.cases.cases for p in built.with_cases(7).points} == {7}


def of_maps(name: str, **changes: object) -> list[Report]:
    """Reports of all maps of a test set."""
    places = ({"width": w.width, "height": w.height, "robots": w.robots} for w in TEST_SETS[name])
    return [report(**(place | changes)) for place in places]


def test_the_papers_numbers_stand_beside_ours() -> None:
    good = {"policy": "MAGAT-B-32-P4", "alpha": 1.0, "alpha_interval": (0.99, 1.0), "delta_ft": 0.03, "p_rg": 1.0}
    worst = {"alpha": 0.5, "alpha_interval": (0.4, 0.6), "delta_ft": 0.2, "p_rg": 0.9}
    reports = of_maps("same-density", **good) + of_maps("increasing-density", **good)
    for place in (3, 13):  # 40x40 (40), 50x50 (100)
        reports[place] = dataclasses.replace(reports[place], **worst)
    text = f"{claims_table(reports)}\n{aims_table(reports)}"
    assert "| alpha | 50x50 (100) | MAGAT-B-32-P4 | 0.95 | 0.500 (0.400 to 0.600) |  |  |" in text
    sixty = "| alpha | 50x50, 10 to 60 robots | MAGAT-B-32-P4 | above 0.92 (most MAGAT policies) |"
    assert f"{sixty} 1.000 (0.990 to 1.000), 50x50 (10) |  |  |" in text
    assert "| delta_FT | same-density | MAGAT-B-32-P4 | below 0.065 | 0.200 ± 0.010, 40x40 (40) |  |  |" in text
    aim = "| MAGAT-B-32-P4 | 0.75 | idle | 0.500 (0.400 to 0.600), 40x40 (40) | 0.200 ± 0.010, 40x40 (40) |"
    assert f"{aim}  | missed |" in text, "the large set was not measured, but what was is not enough"
    assert "p_rg" not in text
    assert "F-32-P4" not in text


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
    reports[4] = dataclasses.replace(reports[4], **changes)
    [row] = [line for line in aims_table(reports).splitlines() if line.startswith("| MAGAT-B-32-P4 | 0.75")]
    assert row.split(" | ")[-1] == f"{aim} |", row


def test_what_was_not_measured_as_a_whole_is_not_told() -> None:
    some = of_maps("large", policy="GNN-F-128", shield="pibt")[:2]
    text = claims_table(some)
    assert "| p_rg | 100x100 (500) | GNN-F-128 | 0.986 |  | 0.9900 |  |" in text
    assert "| p_rg | large |" not in text
    assert claims_table(of_maps("large", policy="mine")) == ""


def test_the_page_begins_with_the_comparison(policies: dict[str, Path], tmp_path: Path) -> None:
    large = test_sets.test_set("large", [Candidate.of_policy(policies["first"], name="GNN-F-128")])
    rows = of_maps("large", policy="GNN-F-128")
    write_csv(rows, tmp_path / "large.csv")
    page = results.write_results([large], [], tmp_path, QUIET).read_text()
    assert 0 < page.index("## Comparison with the paper") < page.index("## Test set: large")
    assert "| p_rg | large | GNN-F-128 | at least 0.986 | 0.9900, 100x100 (500) |  |  |" in page


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
