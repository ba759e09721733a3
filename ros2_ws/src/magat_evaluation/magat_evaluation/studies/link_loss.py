# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Success and flowtime with lost radio links."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from magat_evaluation.candidates import Candidate, Setting
from magat_evaluation.points import Point
from magat_evaluation.report import Report
from magat_evaluation.studies.curves import ALPHA, CURVE_SETS, DELTA_FT, Across, draw_curves, set_and_cases
from magat_evaluation.studies.study import Picture, Study, register
from magat_evaluation.tables import MEASURES, measure_cells
from magat_sim.simulator import Rules

#: Shares of the radio links that are lost; those up to 0.5 are in the picture.
LOSSES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 1.0)
DRAWN = 0.5


@register("link_loss")
def link_loss(policies: Mapping[str, Path]) -> Study:
    """Success and flowtime over the share of lost links."""
    return Study(
        "link_loss",
        "Lost links",
        tuple(
            Point(Candidate.of_policy(folder, Setting(rules=Rules(loss)), name), cases)
            for cases in CURVE_SETS
            for name, folder in policies.items()
            for loss in LOSSES
        ),
        ("map (robots)", "policy", "lost", "cases", *MEASURES),
        row,
        (Picture("Lost links", "", draw),),
    )


def row(report: Report) -> tuple[str, ...]:
    """The row of a report."""
    return (report.set_name, report.policy, f"{report.link_loss:g}", str(report.cases), *measure_cells(report))


def draw(reports: Sequence[Report], path: Path) -> None:
    """Draw alpha and delta_FT over the share of lost links into a PNG file."""
    shown = [report for report in reports if report.link_loss <= DRAWN]
    across = Across("share of the radio links that are lost", lambda report: report.link_loss)
    draw_curves(shown, set_and_cases, across, [ALPHA, DELTA_FT], path)
