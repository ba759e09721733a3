# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""CSV files of reports, a row each, and beside each of them a file with what became of every case.

The outcomes of ``NAME.csv`` are in ``NAME-cases.csv``, a row a report, found by the short name of the report's key.
They are plain text, so that version control keeps what a new measurement adds, and not the whole file again.
"""

import csv
import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from magat_evaluation.outcomes import Outcomes
from magat_evaluation.report import COLUMNS, Report
from magat_node.errors import MagatError
from magat_node.files import write_atomically

_NAMED = ("point", "policy", "set")
_OUTCOMES = tuple(field.name for field in dataclasses.fields(Outcomes))


class ReportFileError(MagatError, ValueError):
    """A file of reports cannot be read."""


def write_csv(reports: Sequence[Report], path: Path) -> None:
    """Write ``reports`` to ``path``, with a heading; the rows of one policy stand together, otherwise in order.

    Outcomes are written first, so that after an interruption no report is without those that it had.
    """
    policies = list(dict.fromkeys(report.policy for report in reports))
    ordered = sorted(reports, key=lambda report: policies.index(report.policy))
    cases = [
        {"point": one.key.id, "policy": one.label, "set": one.set_name} | one.outcomes.to_row()
        for one in ordered
        if one.outcomes is not None
    ]
    if cases:
        _write(cases, (*_NAMED, *_OUTCOMES), outcomes_file(path))
    _write([report.to_row() for report in ordered], COLUMNS, path)
    if not cases:
        outcomes_file(path).unlink(missing_ok=True)


def read_csv(path: Path) -> list[Report]:
    """The reports that `write_csv` wrote, with their outcomes; none if there is no such file.

    Raises:
        ReportFileError: a value is missing or of the wrong kind.
    """
    outcomes: dict[str | None, Outcomes] = {}
    for line, row in _rows(outcomes_file(path)):
        try:
            outcomes[row.get("point")] = Outcomes.from_row(row)
        except ValueError as error:
            raise _damaged(outcomes_file(path), line, error) from error
    reports = []
    for line, row in _rows(path):
        try:
            report = Report.from_row(row)
        except ValueError as error:
            raise _damaged(path, line, error) from error
        reports.append(dataclasses.replace(report, outcomes=outcomes.get(report.key.id)))
    return reports


def outcomes_file(path: Path) -> Path:
    """The file of the outcomes of the reports in ``path``."""
    return path.with_name(f"{path.stem}-cases.csv")


def _rows(path: Path) -> list[tuple[int, Mapping[str, str | None]]]:
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        return list(enumerate(csv.DictReader(file), 2))


def _write(rows: Iterable[Mapping[str, str]], columns: Sequence[str], path: Path) -> None:
    with write_atomically(path) as draft, draft.open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _damaged(path: Path, line: int, error: ValueError) -> ReportFileError:
    return ReportFileError(f"{path} cannot be read, line {line}: {error}. Delete the file to measure its points again")
