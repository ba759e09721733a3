# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat evaluate``: what it prints is JSON, and says on what a policy was measured."""

import json
from pathlib import Path
from typing import Any

import pytest

from magat_cli import main as cli
from magat_evaluation.report import Report
from magat_evaluation.sets import CaseSet
from magat_node.errors import MagatError

SIZE = ["--width", "8", "--height", "8", "--robots", "3"]


def no_number(text: str) -> Any:
    raise AssertionError(f"{text} is no JSON")


@pytest.mark.parametrize("what", [["--policy", "PIBT"], []])
def test_one_case_is_printed_as_json_without_an_interval(
    policies: dict[str, Path], capsys: pytest.CaptureFixture, what: list[str]
) -> None:
    policy = what or ["--policy", str(policies["first"])]
    assert cli.main(["evaluate", "--cases", "1", "--json", *SIZE, *policy]) == 0
    values = json.loads(capsys.readouterr().out, parse_constant=no_number)
    assert values["delta_ft_half_width"] is None
    assert values["map"] is None
    report = Report.from_json(values)
    assert (report.cases, report.width, report.shield_version, report.expert_w) == (1, 8, 1, 1.1)
    assert report.delta_ft_error == 0.0


def test_a_table_of_one_case_has_no_interval_of_delta_ft(capsys: pytest.CaptureFixture) -> None:
    assert cli.main(["evaluate", "--cases", "1", "--policy", "PIBT", *SIZE]) == 0
    (row,) = [line for line in capsys.readouterr().out.splitlines() if "delta_FT, first" in line]
    assert "nan" not in row
    assert " to " not in row


def test_a_split_has_only_so_many_cases() -> None:
    with pytest.raises(MagatError, match="the split valid has 4500 cases, not 4501: ask for fewer"):
        CaseSet.square(20, 10, 4501, split="valid")
    assert CaseSet.square(20, 10, 2, split="valid").numbers == range(21_000, 21_002)
