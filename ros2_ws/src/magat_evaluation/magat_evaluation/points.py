# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Points: candidates on sets of cases, whose reports are kept in CSV files.

A file has a row for each point. A point is measured again only when its key changes, see `EvaluationKey`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from magat_evaluation.candidates import Candidate
from magat_evaluation.evaluate import evaluate_candidate
from magat_evaluation.executor import Workers
from magat_evaluation.report import EvaluationKey, Report
from magat_evaluation.report_files import read_csv, write_csv
from magat_evaluation.sets import CaseSet
from magat_node.progress import progress_bars


@dataclass(frozen=True)
class Point:
    """One evaluation."""

    candidate: Candidate
    cases: CaseSet

    @property
    def key(self) -> EvaluationKey:
        """What identifies it."""
        return self.candidate.key(self.cases)


def measure_points(
    points: Sequence[Point],
    path: Path,
    console: Console,
    workers: Workers = 1,
    title: str = "points",
    others: Sequence[Path] = (),
) -> list[Report]:
    """The reports of ``points``, in order, measured where ``path`` and ``others`` do not have them.

    Args:
        points: what to measure.
        path: CSV file of the reports. Each is written as soon as it is measured.
        console: shows the progress.
        workers: see `executor`.
        title: of the progress.
        others: files that may hold some of the reports; those are copied to ``path``.

    Raises:
        InvalidCaseError: a set has no cases that can be drawn and solved.
        ModelError: a policy cannot be used.
        ReportFileError: a file cannot be read.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    known = {report.key: report for report in read_csv(path)}
    elsewhere = {report.key: report for other in others for report in read_csv(other)}
    keys = [point.key for point in points]
    with progress_bars(console) as progress:
        task = progress.add_task(title, total=len(points))
        for point, key in zip(points, keys, strict=True):
            if key not in known:
                progress.update(task, description=f"{title}: {escape(key.policy)}, {point.cases.name}")
                known[key] = elsewhere.get(key) or evaluate_candidate(point.candidate, point.cases, console, workers)
                write_csv(list(known.values()), path)
            progress.advance(task)
    kept = {report.key: report for report in read_csv(path)}
    return [kept[key] for key in keys]
