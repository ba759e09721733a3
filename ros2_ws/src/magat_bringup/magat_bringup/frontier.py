"""``magat frontier``: what success costs in flowtime, over sampling temperatures, as a table, a file and a picture."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib import patches, patheffects
from matplotlib.figure import Figure
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from magat_bringup.curves import DASHES, MARKERS
from magat_bringup.evaluation import Setting, evaluate_policy, set_name
from magat_bringup.measured import Report, half_width
from magat_bringup.record import INK, robot_colour, tint
from magat_robot.policy.config import PolicyConfig
from magat_robot.policy.store import load

TEMPERATURES = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
#: The region to reach, after the paper: at least this alpha, at most this delta_FT.
TARGET_ALPHA, TARGET_DELTA_FT = 0.97, 0.08

# Where the temperature stands beside its point, in points on paper: elsewhere for each policy.
_LABELS = ((5.0, 5.0), (5.0, -12.0), (-5.0, 5.0), (-5.0, -12.0))


def frontier(
    policies: Mapping[str, Path],
    temperatures: Iterable[float],
    numbers: Sequence[int],
    seed: int,
    size: dict[str, Any],
    console: Console,
) -> dict[str, list[Report]]:
    """Score policies at several sampling temperatures, all on the same cases.

    Args:
        policies: folder of each, by its name.
        temperatures: in any order.
        numbers: of the cases; those of the validation split where a temperature is to be chosen.
        seed: of cases and random streams.
        size: width, height, robots and density of the cases.
        console: shows the progress.

    Returns:
        For each policy the reports of `evaluation.evaluate_policy`, by rising temperature.

    Raises:
        InvalidCaseError: no such cases can be drawn, or the expert solves none of them.
        ModelError: a policy cannot be used, or a temperature is out of range; nothing has been computed then.
    """
    rising = sorted(set(temperatures))
    for temperature in rising:
        PolicyConfig(temperature=temperature)
    for folder in policies.values():
        load(folder)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    reports: dict[str, list[Report]] = {name: [] for name in policies}
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=len(policies) * len(rising))
        for name, folder in policies.items():
            for temperature in rising:
                progress.update(task, description=f"{escape(name)}, T = {temperature:g}")
                reports[name].append(evaluate_policy(folder, numbers, seed, Setting(temperature), size, console))
                progress.advance(task)
    return reports


def table(reports: Mapping[str, Sequence[Report]]) -> Table:
    """The frontier for people."""
    result = Table(title=_title(reports), title_justify="left", box=None, pad_edge=False)
    for heading in ("policy", "T", "alpha", "95 % interval", "delta_FT", "p_rg", "target"):
        result.add_column(heading, justify="left" if heading == "policy" else "right")
    for name, points in reports.items():
        for point in points:
            low, high = point["alpha_interval"]
            reached = point["alpha"] >= TARGET_ALPHA and point["delta_ft"] <= TARGET_DELTA_FT
            result.add_row(
                escape(name),
                f"{point['temperature']:g}",
                f"{point['alpha']:.3f}",
                f"{low:.3f} to {high:.3f}",
                f"{point['delta_ft']:.3f} ± {point['delta_ft_half_width']:.3f}",
                f"{point['p_rg']:.4f}",
                "reached" if reached else "missed",
            )
    return result


def draw(reports: Mapping[str, Sequence[Report]], path: Path) -> None:
    """Draw alpha against delta_FT, a line a policy and a point a temperature, into the PNG file ``path``."""
    figure = Figure(figsize=(8.0, 5.6), facecolor="white", layout="constrained")
    axes = figure.add_subplot()
    every = [point for points in reports.values() for point in points]
    right = 1.08 * max(TARGET_DELTA_FT, *(point["delta_ft"] + half_width(point) for point in every))
    bottom = min(TARGET_ALPHA, *(point["alpha_interval"][0] for point in every))
    margin = 0.06 * (1.0 - bottom)
    axes.set(xlim=(min(0.0, *(point["delta_ft"] - half_width(point) for point in every)), right))
    axes.set(ylim=(bottom - margin, 1.0 + margin))
    target = patches.Rectangle(
        (-1.0, TARGET_ALPHA), 1.0 + TARGET_DELTA_FT, 1.0 - TARGET_ALPHA, hatch="//", facecolor=tint(INK, 0.06),
        edgecolor=tint(INK, 0.35), linewidth=0.8, zorder=0,
        label=rf"target: $\alpha \geq {TARGET_ALPHA:g}$, $\delta_{{FT}} \leq {TARGET_DELTA_FT:g}$",
    )  # fmt: skip
    axes.add_patch(target)
    outline = [patheffects.withStroke(linewidth=2.0, foreground="white")]
    for number, (name, points) in enumerate(reports.items()):
        colour = robot_colour(number)
        alpha = [point["alpha"] for point in points]
        ends = [point["alpha_interval"] for point in points]
        below = [max(0.0, a - low) for a, (low, _) in zip(alpha, ends, strict=True)]
        above = [max(0.0, high - a) for a, (_, high) in zip(alpha, ends, strict=True)]
        delta_ft = [point["delta_ft"] for point in points]
        axes.errorbar(
            delta_ft, alpha, xerr=[half_width(point) for point in points], yerr=[below, above], color=colour,
            ecolor=tint(colour, 0.45), elinewidth=0.9, capsize=2.0, linewidth=1.4, markersize=6.0,
            linestyle=DASHES[number % len(DASHES)], marker=MARKERS[number % len(MARKERS)],
            label=name.replace("$", r"\$"),
        )  # fmt: skip
        aside = _LABELS[number % len(_LABELS)]
        beside: dict[str, Any] = {"xytext": aside, "textcoords": "offset points", "path_effects": outline}
        beside["ha"] = "left" if aside[0] > 0.0 else "right"
        for x, y, point in zip(delta_ft, alpha, points, strict=True):
            axes.annotate(f"{point['temperature']:g}", (x, y), fontsize=8, color=colour, **beside)
    axes.set_xlabel(r"$\delta_{FT}$, how much longer the ways are than the expert's")
    axes.set_ylabel(r"$\alpha$, share of cases in which every robot reaches its goal")
    axes.set_title(f"{_title(reports)}\nnumbers at points: sampling temperature T; bars: 95 % intervals", loc="left",
                   fontsize=10)  # fmt: skip
    axes.grid(color=tint(INK, 0.1), linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.savefig(path, format="png", dpi=150)


def _title(reports: Mapping[str, Sequence[Report]]) -> str:
    first = next(point for points in reports.values() for point in points)
    return f"alpha against delta_FT on {first['cases']} cases of {set_name(first)}, numbers from {first['first_case']}"
