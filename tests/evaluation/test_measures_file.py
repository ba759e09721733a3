# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What was measured of a policy: the right figures, kept as a whole, and never those of other weights."""

import dataclasses
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from magat_cli import main as cli
from magat_evaluation import evaluate as evaluation
from magat_evaluation import measures_file, sets
from magat_evaluation.candidates import Candidate
from magat_evaluation.cases import solved_cases
from magat_evaluation.measures_file import MEASURES, keep, measure, read
from magat_evaluation.planners import evaluate, evaluate_planner
from magat_evaluation.report import Report
from magat_evaluation.sets import STANDARD_SETS, CaseSet
from magat_evaluation.splits import FIRST_RESULT, SET_SEED, SPLITS
from magat_evaluation.tables import markdown, table
from magat_robot.policy.config import ModelError
from magat_robot.policy.store import load, save
from magat_sim.measures import summarise

SETS = (CaseSet.square(8, 3, 5), CaseSet.square(9, 4, 3))
QUIET = Console(quiet=True)


@pytest.fixture
def folder(tmp_path: Path, random_network: Callable) -> Path:
    """A saved policy of which nothing has been measured."""
    save(random_network("MAGAT-F-16"), tmp_path / "policy", "# card\n")
    return tmp_path / "policy"


def report(**changes: Any) -> Report:
    """A report as an evaluation makes it."""
    return Report.from_json(values(**changes))


def values(**changes: Any) -> dict[str, Any]:
    """The same as in a file."""
    return {
        "policy": "MAGAT-F-16", "digest": "ab" * 32, "temperature": 1.25, "encoding": "float32", "link_loss": 0.0,
        "shield": "idle", "shield_version": 1, "width": 20, "height": 20, "robots": 10, "density": 0.1,
        "expert_w": 1.1, "generator_version": 1, "seed": SET_SEED, "first_case": 25500, "unsolved_by_expert": 0,
        "cases": 1000, "alpha": 0.978, "alpha_interval": [0.967, 0.985], "alpha_strict": 0.977,
        "alpha_strict_interval": [0.966, 0.984],
        "delta_ft": 0.151, "delta_ft_strict": 0.162, "delta_ft_half_width": 0.007, "p_rg": 0.99781, "makespan": 30.0,
        "moves_blocked": 8.5, "seconds": 11.0,
    } | changes  # fmt: skip


def printed(renderable: object, width: int = 100) -> str:
    console = Console(width=width, file=io.StringIO())
    console.print(renderable)
    return console.file.getvalue()


def test_the_standard_sets_are_those_of_the_figures() -> None:
    assert [(which.width, which.robots, which.cases) for which in STANDARD_SETS] == [
        (20, 10, 1000),
        (50, 60, 200),
        (65, 100, 100),
    ]
    assert all(which.density == 0.1 and which.height == which.width for which in STANDARD_SETS)
    assert all(which.numbers[0] == FIRST_RESULT for which in STANDARD_SETS)


def test_what_is_kept_was_measured_on_the_first_test_cases(folder: Path) -> None:
    reports = measure(folder, SETS, QUIET)
    assert reports == read(folder)
    assert [one.set_name for one in reports] == ["8x8 (3)", "9x9 (4)"]
    policy = load(folder)
    for which, one in zip(SETS, reports, strict=True):
        solved = list(solved_cases(SPLITS["test"][: which.cases], workers=1, **which.size))
        expected = dataclasses.asdict(summarise(evaluate(policy, solved)))
        assert {name: getattr(one, name) for name in expected} == expected
        assert (one.cases, one.first_case, one.digest) == (which.cases, SPLITS["test"].start, policy.digest)


def test_the_size_of_the_batches_changes_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (whole,) = measure(folder, SETS[:1], QUIET)
    monkeypatch.setattr(evaluation, "BATCH_ROBOTS", 7)
    sizes: list[int] = []

    def watched(planner: Any, batch: list, **rest: Any) -> list:
        sizes.append(len(batch))
        return evaluate_planner(planner, batch, **rest)

    monkeypatch.setattr(evaluation, "evaluate_planner", watched)
    (parts,) = measure(folder, SETS[:1], QUIET)
    assert sizes == [2, 2, 1], "of 3 robots each"
    assert dataclasses.replace(parts, seconds=0) == dataclasses.replace(whole, seconds=0)


def test_a_report_replaces_one_of_the_same_set_shield_and_temperature(tmp_path: Path) -> None:
    others = [report(temperature=1.0), report(width=50), report(shield="none"), report(first_case=21000)]
    for one in [report(alpha=0.5, digest="cd" * 32, cases=10), *others, report()]:
        keep(tmp_path, one)
    kept = read(tmp_path)
    assert len(kept) == 5
    assert [one for one in kept if one not in others] == [report()]


def test_maps_are_sorted_by_size_however_they_were_kept(tmp_path: Path) -> None:
    for side in (65, 20, 50):
        keep(tmp_path, report(width=side, height=side))
    assert [one.width for one in read(tmp_path)] == [20, 50, 65]


def test_a_write_that_fails_halfway_leaves_the_file_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep(tmp_path, report())
    write = Path.write_text

    def write_half(self: Path, text: str) -> None:
        write(self, text[: len(text) // 2])
        raise OSError("no space left")

    monkeypatch.setattr(Path, "write_text", write_half)
    with pytest.raises(OSError, match="no space left"):
        keep(tmp_path, report(width=50))
    assert read(tmp_path) == [report()]


def test_who_reads_during_a_write_gets_the_whole_old_file(tmp_path: Path) -> None:
    keep(tmp_path, report())
    with (tmp_path / MEASURES).open() as reader:
        keep(tmp_path, report(width=50))
        assert [Report.from_json(one) for one in json.load(reader)] == [report()]
    assert len(read(tmp_path)) == 2
    assert [file.name for file in tmp_path.iterdir()] == [MEASURES]


def test_an_interrupted_measurement_keeps_the_sets_it_has(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(candidate: Candidate, cases: CaseSet, console: Console) -> Report:
        if cases == SETS[1]:
            raise KeyboardInterrupt
        return report(robots=cases.robots)

    monkeypatch.setattr(measures_file, "evaluate_candidate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        measure(folder, SETS, QUIET)
    assert [one.robots for one in read(folder)] == [SETS[0].robots]


def test_nothing_measured_is_no_error(tmp_path: Path) -> None:
    assert read(tmp_path) == []


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "cannot be read"),
        ("[{", "cannot be read"),
        ("{}", "no list of reports"),
        ("[1]", "no list of reports"),
        (json.dumps([values(), {}]), "report 2: policy is None"),
        (json.dumps([values(alpha="0.9")]), "report 1: alpha is '0.9'"),
        (json.dumps([values(cases=True)]), "report 1: cases is True"),
        (json.dumps([values(alpha_interval=[0.9])]), r"report 1: alpha_interval is \[0.9\]"),
        (json.dumps([values(alpha_interval=["0.9", 1])]), "report 1: alpha_interval"),
    ],
)
def test_a_damaged_file_is_refused_with_what_to_do(
    folder: Path, monkeypatch: pytest.MonkeyPatch, content: str, said: str
) -> None:
    (folder / MEASURES).write_text(content)
    with pytest.raises(ModelError, match=rf"{MEASURES} .*{said}.*`magat measure`"):
        read(folder)
    monkeypatch.setattr(measures_file, "evaluate_candidate", lambda *_: pytest.fail("all that work for nothing"))
    with pytest.raises(ModelError, match=said):
        measure(folder, SETS, QUIET)


def test_reports_of_other_weights_are_stale_until_measured_again(folder: Path, random_network: Callable) -> None:
    measure(folder, SETS[:1], QUIET)
    (old,) = read(folder)
    assert not old.stale(load(folder).digest)
    digest = save(random_network("MAGAT-F-16", seed=1), folder, "# another\n")
    assert old.stale(digest)
    measure(folder, SETS[:1], QUIET)
    (new,) = read(folder)
    assert not new.stale(digest)


def test_markdown_has_a_row_a_report() -> None:
    lines = markdown([report(), report(width=50, height=50, robots=60, cases=200)], "ab" * 32).splitlines()
    assert [line.count("|") for line in lines] == [10] * 4
    assert lines[0].startswith("| set | cases | T | alpha")
    assert lines[2:] == [
        "| 20x20 (10) | 1000 | 1.25 | 0.978 (0.967 to 0.985) | 0.151 ± 0.007 | 0.162 | 30.0 | 0.9978 | 0.977 |",
        "| 50x50 (60) | 200 | 1.25 | 0.978 (0.967 to 0.985) | 0.151 ± 0.007 | 0.162 | 30.0 | 0.9978 | 0.977 |",
    ]


def test_figures_of_other_weights_are_never_shown() -> None:
    old = report(digest="0123456789abcdef" * 4)
    row = markdown([old], "ab" * 32).splitlines()[2]
    text = printed(table([("mine", "ab" * 32, old)]))
    assert row.count("|") == 10
    for shown in (row, text):
        assert "stale, of 0123456789ab" in shown
        assert "0.978" not in shown
        assert "0.151" not in shown


def test_the_table_puts_policies_side_by_side_on_each_set() -> None:
    entries = [
        (name, "ab" * 32, report(width=side, height=side, alpha=alpha))
        for name, alpha in (("[first]", 0.5), ("second", 0.25))
        for side in (20, 50)
    ]
    lines = [line.split() for line in printed(table(entries), 110).splitlines()]
    assert [line[0] for line in lines[1:]] == ["20x20", "[first]", "second", "50x50", "[first]", "second"]
    assert lines[2][1:] == [
        "1000",
        "1.25",
        "0.500",
        "(0.967",
        "to",
        "0.985)",
        "0.151",
        "±",
        "0.007",
        "0.162",
        "30.0",
        "0.9978",
    ]
    assert lines[3][3] == "0.250"


def test_the_command_measures_and_prints(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setattr(sets, "STANDARD_SETS", SETS)
    assert cli.main(["measure", "--policy", str(folder), "--cases", "4"]) == 0
    assert [(one.width, one.cases) for one in read(folder)] == [(8, 4), (9, 3)]
    output = capsys.readouterr().out
    assert "8x8 (3)" in output
    assert "9x9 (4)" in output
    assert cli.main(["measure", "--policy", str(folder), "--cases", "2", "--temperature", "3"]) == 0
    assert [(one.width, one.temperature) for one in read(folder)] == [(8, 1.0), (8, 3.0), (9, 1.0), (9, 3.0)]


def test_an_expert_that_solves_nothing_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluation, "solved_cases", lambda *_, **__: iter(()))
    assert cli.main(["evaluate", "--policy", str(folder), "--cases", "2"]) == 1
