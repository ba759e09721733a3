"""``magat frontier``: what success costs in flowtime, over sampling temperatures, as a table, a file and a picture."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import patches, patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from magat_evaluation.evaluate import Contender, Setting, evaluate_policy, set_name
from magat_evaluation.measures_file import Report, half_width
from magat_evaluation.report_files import identity, read_csv, write_csv
from magat_evaluation.studies.curves import DASHES, MARKERS, alpha_errors, legend
from magat_pictures.colours import INK, robot_colour, tint

TEMPERATURES = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
#: The region to reach, after the paper: at least this alpha, at most this delta_FT.
TARGET_ALPHA, TARGET_DELTA_FT = 0.97, 0.08

# How far above its point the temperature stands, in points on paper: elsewhere for each policy.
_LABELS = (6.0, 16.0, -13.0, -23.0)


def frontier(
    policies: Mapping[str, Path],
    settings: Sequence[Setting],
    numbers: Sequence[int],
    seed: int,
    size: dict[str, Any],
    path: Path,
    console: Console,
) -> list[Report]:
    """Score policies at several sampling temperatures, all on the same cases.

    Args:
        policies: folder of each, by its name.
        settings: temperatures and shields, in any order.
        numbers: of the cases; those of the validation split where a temperature is to be chosen.
        seed: of cases and random streams.
        size: width, height, robots and density of the cases.
        path: CSV file that keeps each report as soon as it is there, and may have some of them.
        console: shows the progress.

    Returns:
        The reports of `evaluation.evaluate_policy`, policy by policy, shield by shield, by rising temperature.

    Raises:
        InvalidCaseError: no such cases can be drawn, or the expert solves none of them.
        ModelError: a policy cannot be used, or a temperature is out of range; nothing has been computed then.
    """
    asked: dict[tuple[Any, ...], tuple[str, Setting]] = {}
    of_cases = {**size, "seed": seed, "first_case": numbers[0], "cases": len(numbers)}
    for name, folder in policies.items():
        for setting in sorted(settings, key=lambda setting: (setting.rules.shield, setting.temperature)):
            contender = Contender.of_policy(folder, setting)
            rules = dataclasses.asdict(setting.rules)
            asked[identity(contender.named | {"policy": name} | rules | of_cases)] = (name, setting)
    known = {which: row for row in read_csv(path) if (which := identity(row)) in asked}
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=len(asked))
        for which, (name, setting) in asked.items():
            progress.update(task, description=f"{escape(name)}, {setting.rules.shield}, T = {setting.temperature:g}")
            if which not in known:
                report = evaluate_policy(policies[name], numbers, seed, setting, size, console)
                known[which] = report | {"policy": name}
                path.parent.mkdir(parents=True, exist_ok=True)
                write_csv(list(known.values()), path)
            progress.advance(task)
    return [known[which] for which in asked]


def table(reports: Sequence[Report]) -> Table:
    """The frontier for people."""
    result = Table(title=_title(reports), title_justify="left", box=None, pad_edge=False)
    for heading in ("policy", "shield", "T", "alpha", "95 % interval", "delta_FT", "p_rg", "target"):
        result.add_column(heading, justify="left" if heading in ("policy", "shield") else "right")
    for point in reports:
        low, high = point["alpha_interval"]
        reached = point["alpha"] >= TARGET_ALPHA and point["delta_ft"] <= TARGET_DELTA_FT
        result.add_row(
            escape(point["policy"]),
            point["shield"],
            f"{point['temperature']:g}",
            f"{point['alpha']:.3f}",
            f"{low:.3f} to {high:.3f}",
            f"{point['delta_ft']:.3f} ± {point['delta_ft_half_width']:.3f}",
            f"{point['p_rg']:.4f}",
            "reached" if reached else "missed",
        )
    return result


def draw(reports: Sequence[Report], path: Path) -> None:
    """Draw alpha against delta_FT into the PNG file ``path``: a picture a shield, a line a policy, a point a T."""
    policies, shields = (list(dict.fromkeys(point[name] for point in reports)) for name in ("policy", "shield"))
    # One above the other: temperatures lie side by side, and their names want room.
    figure = Figure(figsize=(11.0, 2.0 + 3.0 * len(shields)), facecolor="white", layout="constrained")
    pictures = figure.subplots(len(shields), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    right = 1.08 * max(TARGET_DELTA_FT, *(point["delta_ft"] + half_width(point) for point in reports))
    bottom = min(TARGET_ALPHA, *(point["alpha_interval"][0] for point in reports))
    margin = 0.2 * (1.0 - bottom)
    pictures[0].set(xlim=(min(0.0, *(point["delta_ft"] - half_width(point) for point in reports)), right))
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
            points = [point for point in reports if (point["policy"], point["shield"]) == (policy, shield)]
            if points:
                _line(axes, number, points)
        axes.set_title(f"{shield} shield", loc="left", fontsize=10)
        axes.grid(color=tint(INK, 0.1), linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    pictures[-1].set_xlabel(r"$\delta_{FT}$, how much longer the ways are than the expert's")
    figure.suptitle(f"{_title(reports)}\nnumbers at points: sampling temperature T; bars: 95 % intervals", fontsize=10)
    legend(figure)
    figure.savefig(path, format="png", dpi=120)


def _line(axes: Axes, number: int, points: Sequence[Report]) -> None:
    """Those of one policy under one shield, by rising temperature."""
    colour = robot_colour(number)
    delta_ft, alpha = ([point[name] for point in points] for name in ("delta_ft", "alpha"))
    axes.errorbar(
        delta_ft, alpha, xerr=[half_width(point) for point in points],
        yerr=np.transpose([alpha_errors(point) for point in points]), color=colour,
        ecolor=tint(colour, 0.45), elinewidth=0.9, capsize=2.0, linewidth=1.4, markersize=6.0,
        linestyle=DASHES[number % len(DASHES)], marker=MARKERS[number % len(MARKERS)],
        label=points[0]["policy"].replace("$", r"\$"),
    )  # fmt: skip
    above = _LABELS[number % len(_LABELS)]
    beside: dict[str, Any] = {"xytext": (0.0, above), "textcoords": "offset points", "ha": "center"}
    beside |= {"path_effects": [patheffects.withStroke(linewidth=2.0, foreground="white")]}
    for x, y, point in zip(delta_ft, alpha, points, strict=True):
        axes.annotate(f"{point['temperature']:g}", (x, y), fontsize=8, color=colour, **beside)


def _title(reports: Sequence[Report]) -> str:
    first = reports[0]
    return f"alpha against delta_FT on {first['cases']} cases of {set_name(first)}, numbers from {first['first_case']}"
