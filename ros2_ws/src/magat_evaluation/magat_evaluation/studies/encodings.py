# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Success and flowtime by the encoding of messages."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from magat_evaluation.candidates import Candidate, Setting
from magat_evaluation.points import Point
from magat_evaluation.report import Report
from magat_evaluation.studies.curves import ALPHA, CURVE_SETS, DELTA_FT, Across, draw_curves, set_and_cases
from magat_evaluation.studies.study import Picture, Study, register
from magat_evaluation.tables import MEASURES, measure_cells
from magat_robot.policy.config import ENCODINGS


@register("encodings")
def encodings(policies: Mapping[str, Path]) -> Study:
    """Success and flowtime over the bytes that a robot sends."""
    return Study(
        "encodings",
        "Encodings of messages",
        tuple(
            Point(Candidate.of_policy(folder, Setting(encoding=encoding), name), cases)
            for cases in CURVE_SETS
            for name, folder in policies.items()
            for encoding in ENCODINGS
        ),
        ("map (robots)", "policy", "encoding", "bytes a step", "cases", *MEASURES),
        row,
        (Picture("Encodings of messages", "", draw),),
    )


def row(report: Report) -> tuple[str, ...]:
    """The row of a report."""
    sent = str(report.bytes_per_step)
    return (report.set_name, report.policy, report.encoding, sent, str(report.cases), *measure_cells(report))


def draw(reports: Sequence[Report], path: Path) -> None:
    """Draw alpha and delta_FT over the bytes that a robot sends into a PNG file."""
    across = Across("bytes that a robot sends in a step", lambda report: report.bytes_per_step or 0, log=True)
    draw_curves(reports, set_and_cases, across, [ALPHA, DELTA_FT], path)
