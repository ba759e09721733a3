# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``measures.json`` in a policy's folder: its reports on the standard sets, a JSON list, made by ``magat measure``.

Each report names the weights by their digest. When the folder gets other weights, its reports are stale, see
`Report.stale`, and tables show them as such.
"""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from magat_evaluation.candidates import Candidate, Setting
from magat_evaluation.evaluate import evaluate_candidate
from magat_evaluation.report import Report
from magat_evaluation.sets import CaseSet
from magat_node.files import write_atomically
from magat_node.progress import tracked
from magat_robot.policy.config import ModelError

MEASURES = "measures.json"


def measure(folder: Path, sets: Sequence[CaseSet], console: Console, temperature: float | None = None) -> list[Report]:
    """Evaluate a policy on ``sets``, and keep each report in its folder as soon as it is measured, see `keep`.

    Args:
        folder: of the policy.
        sets: e.g. `STANDARD_SETS`, which take a minute and a half.
        console: shows the progress.
        temperature: for sampling; the policy's own if None.

    Returns:
        The new reports, in the order of ``sets``.

    Raises:
        InvalidCaseError: a set has no cases that can be drawn and solved.
        ModelError: the policy, or its ``measures.json``, cannot be used.
    """
    read(folder)  # find a damaged file before the work
    candidate = Candidate.of_policy(folder, Setting(temperature))
    reports = []
    for cases in tracked(sets, "sets", len(sets), console):
        report = evaluate_candidate(candidate, cases, console)
        reports.append(dataclasses.replace(report, outcomes=None))  # the folder has no place for it
        keep(folder, reports[-1])
    return reports


def keep(folder: Path, report: Report) -> None:
    """Add ``report`` to the ``measures.json`` in ``folder``.

    It replaces a report of the same set, shield and temperature, of whatever weights and number of cases.

    Raises:
        ModelError: the existing file cannot be used.
    """
    others = [old for old in read(folder) if _place(old) != _place(report)]
    reports = sorted([*others, report], key=_place)
    with write_atomically(folder / MEASURES) as draft:
        draft.write_text(json.dumps([one.to_json() for one in reports], indent=2, allow_nan=False) + "\n")


def read(folder: Path) -> list[Report]:
    """The reports in the ``measures.json`` in ``folder``, smaller maps first; none if there is no such file.

    Raises:
        ModelError: the file is damaged.
    """
    file = folder / MEASURES
    advice = "delete it, and run `magat measure` again"
    try:
        reports = json.loads(file.read_text())
    except FileNotFoundError:
        return []
    except (OSError, ValueError) as error:
        raise ModelError(f"{file} cannot be read ({error}): {advice}") from error
    if not isinstance(reports, list) or not all(isinstance(report, dict) for report in reports):
        raise ModelError(f"{file} is damaged, it holds no list of reports: {advice}")
    return sorted((_report(file, number, values, advice) for number, values in enumerate(reports, 1)), key=_place)


def _report(file: Path, number: int, values: dict[str, Any], advice: str) -> Report:
    try:
        return Report.from_json(values)
    except ValueError as error:
        raise ModelError(f"{file} is damaged, report {number}: {error}: {advice}") from error


def _place(report: Report) -> tuple[Any, ...]:
    """What a new report has in common with the one it replaces; also their order."""
    size = (report.width, report.height, report.robots, report.density, report.expert_w)
    return (*size, report.seed, report.first_case, report.shield, report.temperature)
