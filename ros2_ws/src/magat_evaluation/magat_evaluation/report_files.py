"""CSV files of reports, a row each."""

import csv
from collections.abc import Sequence
from pathlib import Path

from magat_evaluation.report import COLUMNS, Report
from magat_node.errors import MagatError
from magat_node.files import write_atomically


class ReportFileError(MagatError, ValueError):
    """A file of reports cannot be read."""


def write_csv(reports: Sequence[Report], path: Path) -> None:
    """Write ``reports`` to ``path``, with a heading; the rows of one policy stand together, otherwise in order."""
    policies = list(dict.fromkeys(report.policy for report in reports))
    with write_atomically(path) as draft, draft.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(r.to_row() for r in sorted(reports, key=lambda report: policies.index(report.policy)))


def read_csv(path: Path) -> list[Report]:
    """The reports that `write_csv` wrote; none if there is no such file.

    Raises:
        ReportFileError: a value is missing or of the wrong kind.
    """
    if not path.is_file():
        return []
    reports = []
    with path.open(newline="") as file:
        for line, row in enumerate(csv.DictReader(file), 2):
            try:
                reports.append(Report.from_row(row))
            except ValueError as error:
                raise ReportFileError(
                    f"{path} cannot be read, line {line}: {error}. Delete the file to measure its points again"
                ) from error
    return reports
