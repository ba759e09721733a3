# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The pictures of studies: measures as curves with their intervals, and how many robots reached their goals."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter, ScalarFormatter

from magat_evaluation.report import Report
from magat_evaluation.sets import CaseSet
from magat_pictures.colours import INK, robot_colour, tint

# Lines differ by these in print without colour.
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
DASHES = ("-", "--", "-.", ":")
#: Groups of bars in a histogram at most; where there are more numbers of robots, some share one.
GROUPS = 16
#: What curves are measured on.
CURVE_SETS = (CaseSet.result(20, 10, 400), CaseSet.result(50, 60, 200))


@dataclass(frozen=True)
class Measure:
    """The vertical axis of curves."""

    label: str
    value: Callable[[Report], float]
    #: How far the interval reaches below and above the value.
    errors: Callable[[Report], tuple[float, float]]


def alpha_errors(report: Report) -> tuple[float, float]:
    """How far alpha's interval reaches below and above it; at least 0 in spite of rounding."""
    low, high = report.alpha_interval
    return max(0.0, report.alpha - low), max(0.0, high - report.alpha)


ALPHA = Measure(r"$\alpha$", lambda report: report.alpha, alpha_errors)
DELTA_FT = Measure(r"$\delta_{FT}$", lambda report: report.delta_ft, lambda report: (report.delta_ft_error,) * 2)
P_RG = Measure(r"$p_{rg}$", lambda report: report.p_rg, lambda _: (0.0, 0.0))


@dataclass(frozen=True)
class Across:
    """The horizontal axis of curves."""

    label: str
    value: Callable[[Report], float]
    log: bool = False
    #: Labels at 0, 1, ... if the values are indices.
    names: Sequence[str] = ()


def draw_curves(
    reports: Sequence[Report], column: Callable[[Report], str], across: Across, measures: Sequence[Measure], path: Path
) -> None:
    """Draw ``measures``, from top to bottom, into the PNG file ``path``.

    There is a line for each policy, and a column of pictures for each value of ``column``.
    """
    titles = list(dict.fromkeys(map(column, reports)))
    figure = Figure(figsize=(4.6 * len(titles), 0.6 + 2.9 * len(measures)), facecolor="white", layout="constrained")
    grid = figure.subplots(len(measures), len(titles), sharex=True, sharey="row", squeeze=False)
    for (row, column_number), axes in np.ndenumerate(grid):
        measure, title = measures[row], titles[column_number]
        for number, policy in enumerate(_policies(reports)):
            points = sorted((r for r in reports if (column(r), r.policy) == (title, policy)), key=across.value)
            if points:
                _line(axes, number, points, across, measure)
        _tidy(axes)
        if row == 0:
            axes.set_title(title, loc="left", fontsize=10)
        if column_number == 0:
            axes.set_ylabel(measure.label)
        if across.log:
            axes.set_xscale("log", base=2)
            axes.xaxis.set_major_formatter(ScalarFormatter())
        if across.names:
            axes.set_xticks(range(len(across.names)), across.names, rotation=30, ha="right", fontsize=8)
    for axes in grid[-1]:
        axes.set_xlabel(across.label)
    legend(figure)
    figure.savefig(path, format="png", dpi=120)


def _line(axes: Axes, number: int, points: Sequence[Report], across: Across, measure: Measure) -> None:
    colour = robot_colour(number)
    axes.errorbar(
        [across.value(point) for point in points], [measure.value(point) for point in points],
        yerr=np.transpose([measure.errors(point) for point in points]),
        color=colour, ecolor=tint(colour, 0.45), elinewidth=0.9, capsize=2.0, linewidth=1.4, markersize=6.0,
        linestyle=DASHES[number % len(DASHES)], marker=MARKERS[number % len(MARKERS)],
        label=_plain(points[0].policy),
    )  # fmt: skip


def set_and_cases(report: Report) -> str:
    """The title of a column of curves, e.g. 20x20 (10), 400 cases."""
    return f"{report.set_name}, {report.cases} cases"


def draw_arrivals(reports: Sequence[Report], path: Path) -> None:
    """Draw histograms of how many robots reached their goals into the PNG file ``path``.

    There is a column of pictures for each set, a row for each shield, and a colour for each policy. Reports without
    these numbers are left out.
    """
    kept = [report for report in reports if report.stranded]
    sets, shields = (list(dict.fromkeys(getattr(report, name) for report in kept)) for name in ("set_name", "shield"))
    figure = Figure(figsize=(4.6 * len(sets), 0.6 + 2.9 * len(shields)), facecolor="white", layout="constrained")
    grid = figure.subplots(len(shields), len(sets), sharex="col", sharey=True, squeeze=False)
    policies = _policies(kept)
    for (row, column), axes in np.ndenumerate(grid):
        here = [r for r in kept if r.set_name == sets[column]]
        width = -(-(max(max(r.stranded) for r in here) + 1) // GROUPS)  # robots per group of bars
        for report in here:
            if report.shield == shields[row]:
                _bars(axes, report, width, policies)
        _tidy(axes)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        if row == 0:
            axes.set_title(f"{sets[column]}, {here[0].cases} cases", loc="left", fontsize=10)
        if column == 0:
            axes.set_ylabel(f"cases, {shields[row]} shield")
    for axes in grid[-1]:
        axes.set_xlabel("robots that reached their goals")
    legend(figure)
    figure.savefig(path, format="png", dpi=120)


def _bars(axes: Axes, report: Report, width: int, policies: Sequence[str]) -> None:
    """The bars of one policy. A group of bars covers ``width`` numbers of robots, counted downwards from all robots."""
    groups: Counter[int] = Counter()
    for stranded, cases in report.stranded.items():
        groups[stranded // width] += cases
    number = policies.index(report.policy)
    thin = 0.8 * width / len(policies)
    middle = report.robots - width * np.array(list(groups)) - (width - 1) / 2
    axes.bar(
        middle + (number + 0.5) * thin - 0.4 * width, np.array(list(groups.values())) / report.cases, thin,
        color=robot_colour(number), label=_plain(report.policy),
    )  # fmt: skip


def _policies(reports: Sequence[Report]) -> list[str]:
    return list(dict.fromkeys(report.policy for report in reports))


def _plain(name: str) -> str:
    """``name``, with dollar signs escaped for matplotlib."""
    return name.replace("$", r"\$")


def _tidy(axes: Axes) -> None:
    axes.grid(color=tint(INK, 0.1), linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def legend(figure: Figure) -> None:
    """Add a legend to ``figure`` with one entry for each policy."""
    entries: dict[str, Any] = {}
    for axes in figure.axes:
        handles, labels = axes.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.legend(handles=list(entries.values()), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
