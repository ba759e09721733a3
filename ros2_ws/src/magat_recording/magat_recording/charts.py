# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The pictures of ``magat analyze``: attention, timing and entropy of decisions. Sizes are in inches."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from magat_pictures.colours import ALARM, INK, ROBOT_INKS, tint
from magat_recording.findings import CONFLICT_DISTANCE, PERCENTILES, Findings
from magat_sim.measures import Z_95

_LINE = ROBOT_INKS[0]


def save_charts(findings: Findings, folder: Path) -> None:
    """Write timing.png, decisions.png and, if there is attention, attention.png."""
    charts = {"timing": timing_chart(findings), "decisions": decisions_chart(findings)}
    if findings.attention:
        charts["attention"] = attention_chart(findings)
    for name, figure in charts.items():
        figure.savefig(folder / f"{name}.png", dpi=160)


def attention_chart(findings: Findings) -> Figure:
    """Attention by distance, by number of neighbours, and between robots in conflict."""
    tables = findings.attention
    figure, (distance, density, conflict) = _sheet(3)
    _points(distance, tables["distance"], "distance", "relative")
    distance.axhline(1.0, color=tint(INK, 0.4), linewidth=0.8, linestyle="--")
    distance.set(xlabel="distance, up to (cells)", ylabel="attention, equal share = 1", title="by distance")
    table = tables["neighbours"]
    _points(density, table, "neighbours", "effective")
    density.plot(table.neighbours, table.neighbours, color=tint(INK, 0.4), linewidth=0.8, linestyle="--")
    density.set(xlabel="neighbours heard", ylabel="effective neighbours", title="by density")
    table = tables["conflict"].set_index("conflict").reindex([False, True])
    conflict.bar(
        [0, 1], table.relative, yerr=table.half_width, color=[tint(INK, 0.35), ALARM], width=0.6, ecolor=INK, capsize=3
    )
    conflict.axhline(1.0, color=tint(INK, 0.4), linewidth=0.8, linestyle="--")
    conflict.set(
        xticks=[0, 1], xticklabels=["others", "in conflict"], ylabel="attention, equal share = 1",
        title=f"within {CONFLICT_DISTANCE} cells",
    )  # fmt: skip
    return figure


def timing_chart(findings: Findings) -> Figure:
    """The wall time of ticks, and the time that each robot took to answer."""
    recording = findings.recording
    figure, (ticks, robots) = _sheet(2)
    milliseconds = 1e3 * recording.ticks.seconds
    ticks.plot(np.arange(len(milliseconds)), milliseconds, color=_LINE, linewidth=0.7)
    for name, quantile in PERCENTILES.items():
        if name != "max":
            ticks.axhline(milliseconds.quantile(quantile), color=tint(INK, 0.5), linewidth=0.8, linestyle="--")
            ticks.annotate(name, (len(milliseconds), milliseconds.quantile(quantile)), fontsize=7, color=INK)
    for begin in np.flatnonzero(recording.ticks.episode.diff().fillna(0))[:200]:
        ticks.axvline(begin, color=tint(INK, 0.15), linewidth=0.6)
    ticks.set(xlabel="ticks, all episodes", ylabel="milliseconds per tick", ylim=(0, None), title="ticks")
    latency = 1e3 * recording.robots.set_index("robot").latency.dropna()
    each = [latency.loc[[robot]] if robot in latency.index else [] for robot in range(len(recording.names))]
    robots.boxplot(each, showfliers=False, medianprops={"color": ALARM}, boxprops={"color": INK}, widths=0.6)
    robots.set(xlabel="robot", ylabel="milliseconds to answer", title="robots")
    robots.set_xticks(range(1, len(each) + 1), [str(robot) for robot in range(len(each))], fontsize=6)
    return figure


def decisions_chart(findings: Findings) -> Figure:
    """The entropy of decisions: by number of neighbours, and in each tick of the longest episode."""
    robots = findings.recording.robots
    figure, (density, episode) = _sheet(2)
    groups = robots[robots.entropy.notna()].groupby("neighbours").entropy
    table = pd.DataFrame({"entropy": groups.mean(), "half_width": Z_95 * groups.sem()}).reset_index()
    _points(density, table, "neighbours", "entropy")
    density.set(xlabel="neighbours heard", ylabel="entropy of the decision (bits)", title="by density")
    if len(robots):
        number = int(robots.groupby("episode").tick.max().idxmax())
        grid = robots[robots.episode == number].pivot(index="robot", columns="tick", values="entropy")
        image = episode.imshow(grid, aspect="auto", cmap="Blues", vmin=0.0, interpolation="nearest")
        figure.colorbar(image, ax=episode, label="bits")
        for stuck in findings.deadlocks[findings.deadlocks.episode == number].itertuples():
            for robot in stuck.robots:
                place = (stuck.begin - 0.5, robot - 0.5)
                episode.add_patch(Rectangle(place, stuck.ticks, 1, fill=False, edgecolor=ALARM, linewidth=1.2))
        episode.set(xlabel="tick", ylabel="robot", title=f"episode {number}; deadlocks in red")
        episode.yaxis.set_major_locator(MaxNLocator(integer=True))
    return figure


def _sheet(panels: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(3.6 * panels, 3.0), facecolor="white", layout="constrained")
    axes = list(figure.subplots(1, panels))
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(labelsize=7)
        axis.title.set_fontsize(9)
        axis.xaxis.label.set_fontsize(8)
        axis.yaxis.label.set_fontsize(8)
    return figure, axes


def _points(axis: Axes, table: pd.DataFrame, x: str, y: str) -> None:
    axis.errorbar(table[x], table[y], yerr=table.half_width, color=_LINE, marker="o", markersize=4, capsize=3)
