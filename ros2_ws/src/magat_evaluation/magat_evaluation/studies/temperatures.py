# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Success against flowtime over sampling temperatures: the frontier of a policy. Not on the page of results."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import patches, patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from magat_evaluation.candidates import Candidate, Setting
from magat_evaluation.points import Point
from magat_evaluation.report import Report
from magat_evaluation.sets import CaseSet
from magat_evaluation.studies.curves import DASHES, MARKERS, alpha_errors, legend
from magat_evaluation.studies.study import Picture, Study
from magat_evaluation.tables import MEASURES, measure_cells
from magat_pictures.colours import INK, robot_colour, tint
from magat_sim.simulator import Rules

TEMPERATURES = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
#: The target region, after the paper: at least this alpha, at most this delta_FT.
TARGET_ALPHA, TARGET_DELTA_FT = 0.97, 0.08

# Height of the temperature above its point, in points on paper, by policy.
_LABELS = (6.0, 16.0, -13.0, -23.0)


def frontier(
    policies: Mapping[str, Path], shields: Sequence[str], temperatures: Sequence[float], cases: CaseSet
) -> Study:
    """Policies under several shields at several sampling temperatures, all on the same cases.

    Args:
        policies: folder of each, by its name.
        shields: one or more.
        temperatures: in any order.
        cases: from the validation split if a temperature is to be chosen.

    Raises:
        ModelError: a policy cannot be used, or a temperature is out of range.
    """
    points = [
        Point(Candidate.of_policy(folder, Setting(temperature, rules=Rules(shield=shield)), name), cases)
        for name, folder in policies.items()
        for shield in sorted(set(shields))
        for temperature in sorted(set(temperatures))
    ]
    return Study(
        "frontier",
        f"alpha against delta_FT on {cases.cases} cases of {cases.name}, numbers from {cases.numbers[0]}",
        tuple(points),
        ("policy", "shield", "T", *MEASURES, "target"),
        row,
        (Picture("alpha against delta_FT over sampling temperatures", "", draw),),
    )


def row(report: Report) -> tuple[str, ...]:
    """The row of a report."""
    reached = report.alpha >= TARGET_ALPHA and report.delta_ft <= TARGET_DELTA_FT
    shown = (report.policy, report.shield, f"{report.temperature:g}", *measure_cells(report))
    return (*shown, "reached" if reached else "missed")


def draw(reports: Sequence[Report], path: Path) -> None:
    """Draw alpha against delta_FT into a PNG file: a picture for each shield, a line for each policy."""
    policies, shields = (
        list(dict.fromkeys(getattr(point, name) for point in reports)) for name in ("policy", "shield")
    )
    # One above the other, because the temperatures at the points need width.
    figure = Figure(figsize=(11.0, 2.0 + 3.0 * len(shields)), facecolor="white", layout="constrained")
    pictures = figure.subplots(len(shields), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    right = 1.08 * max(TARGET_DELTA_FT, *(point.delta_ft + point.delta_ft_error for point in reports))
    bottom = min(TARGET_ALPHA, *(point.alpha_interval[0] for point in reports))
    margin = 0.2 * (1.0 - bottom)
    pictures[0].set(xlim=(min(0.0, *(point.delta_ft - point.delta_ft_error for point in reports)), right))
    pictures[0].set(ylim=(bottom - margin, 1.0 + margin))
    figure.supylabel(r"$\alpha$, share of cases in which every robot reaches its goal", fontsize=10)
    for axes, shield in zip(pictures, shields, strict=True):
        target = patches.Rectangle(
            (-1.0, TARGET_ALPHA), 1.0 + TARGET_DELTA_FT, 1.0 - TARGET_ALPHA, hatch="//", facecolor=tint(INK, 0.06),
            edgecolor=tint(INK, 0.35), linewidth=0.8, zorder=0,
            label=rf"target: $\alpha \geq {TARGET_ALPHA:g}$, $\delta_{{FT}} \leq {TARGET_DELTA_FT:g}$",
        )  # fmt: skip
        axes.add_patch(target)
        for number, policy in enumerate(policies):
            points = [point for point in reports if (point.policy, point.shield) == (policy, shield)]
            if points:
                _line(axes, number, points)
        axes.set_title(f"{shield} shield", loc="left", fontsize=10)
        axes.grid(color=tint(INK, 0.1), linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    pictures[-1].set_xlabel(r"$\delta_{FT}$, how much longer the ways are than the expert's")
    figure.suptitle(
        f"{_title(reports[0])}\nnumbers at points: sampling temperature T; bars: 95 % intervals", fontsize=10
    )
    legend(figure)
    figure.savefig(path, format="png", dpi=120)


def _line(axes: Axes, number: int, points: Sequence[Report]) -> None:
    """The line of one policy under one shield, by rising temperature."""
    colour = robot_colour(number)
    delta_ft, alpha = ([getattr(point, name) for point in points] for name in ("delta_ft", "alpha"))
    axes.errorbar(
        delta_ft, alpha, xerr=[point.delta_ft_error for point in points],
        yerr=np.transpose([alpha_errors(point) for point in points]), color=colour,
        ecolor=tint(colour, 0.45), elinewidth=0.9, capsize=2.0, linewidth=1.4, markersize=6.0,
        linestyle=DASHES[number % len(DASHES)], marker=MARKERS[number % len(MARKERS)],
        label=points[0].policy.replace("$", r"\$"),
    )  # fmt: skip
    above = _LABELS[number % len(_LABELS)]
    beside: dict[str, Any] = {"xytext": (0.0, above), "textcoords": "offset points", "ha": "center"}
    beside |= {"path_effects": [patheffects.withStroke(linewidth=2.0, foreground="white")]}
    for x, y, point in zip(delta_ft, alpha, points, strict=True):
        axes.annotate(f"{point.temperature:g}", (x, y), fontsize=8, color=colour, **beside)


def _title(first: Report) -> str:
    return f"alpha against delta_FT on {first.cases} cases of {first.set_name}, numbers from {first.first_case}"
