# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files of reports and of what became of each case: they hold all of it, and a damaged one is refused."""

import json
from pathlib import Path

import pytest
from example_report import report
from rich.console import Console

from magat_evaluation.candidates import Candidate
from magat_evaluation.evaluate import evaluate_candidate
from magat_evaluation.outcomes import Outcomes
from magat_evaluation.report import Report
from magat_evaluation.report_files import ReportFileError, outcomes_file, read_csv, write_csv
from magat_evaluation.sets import CaseSet


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
    assert not outcomes_file(tmp_path / "rows.csv").exists()
    assert [Report.from_json(json.loads(json.dumps(row.to_json(), allow_nan=False))) for row in rows] == rows


def test_outcomes_are_in_a_file_of_their_own(tmp_path: Path) -> None:
    outcomes = Outcomes((0, 3), (1, 0), (-2, 120), (40, 980), (17, 90))
    rows = [report(outcomes=outcomes), report(shield="pibt")]
    write_csv(rows, tmp_path / "rows.csv")
    assert read_csv(tmp_path / "rows.csv") == rows
    assert outcomes.values("alpha", 10).tolist() == [1, 0]
    assert outcomes.values("p_rg", 10).tolist() == pytest.approx([1, 0.7])
    assert outcomes.values("alpha_strict", 10).tolist() == [1, 0]
    assert outcomes.values("delta_ft", 10).tolist() == pytest.approx([-0.002, 0.12])
    assert outcomes.values("makespan", 10).tolist() == [17, 90]
    text = outcomes_file(tmp_path / "rows.csv").read_text()
    outcomes_file(tmp_path / "rows.csv").write_text(text.replace("17 90", "17"))
    with pytest.raises(ReportFileError, match=r"rows-cases\.csv cannot be read, line 2: the outcomes are incomplete"):
        read_csv(tmp_path / "rows.csv")


def test_outcomes_give_the_measures_of_their_report(policies: dict[str, Path]) -> None:
    one = evaluate_candidate(Candidate.of_policy(policies["first"]), CaseSet.square(8, 3, 4), Console(quiet=True))
    assert one.outcomes is not None
    for measure in ("alpha", "alpha_strict", "delta_ft", "delta_ft_strict", "p_rg", "makespan"):
        mean = one.outcomes.values(measure, one.robots).mean()
        assert mean == pytest.approx(getattr(one, measure), abs=0.0005), measure


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
