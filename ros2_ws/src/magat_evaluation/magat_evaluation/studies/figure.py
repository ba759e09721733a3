# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The eight panels of the paper's figure of results, with what was measured here. Not a study."""

import re
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator

from magat_evaluation.measured import Measured
from magat_evaluation.paper import DENSER, GNN, MAGAT, PANELS, SAME
from magat_evaluation.studies.curves import legend
from magat_pictures.colours import INK, tint

#: The paper's colours, by features; further policies and baselines by name.
_SIZES = {"128": "tab:red", "64": "tab:blue", "32": "black", "16": "tab:purple"}
_NAMED = {
    "GAT-F-128": "goldenrod", "GNN_baseline-F-128": "goldenrod", "HCA": "burlywood", "Replan": "darkred",
    "greedy": "tab:gray",
}  # fmt: skip
_FAMILIES = {"GNN": (*GNN, "GNN_baseline-F-128"), "MAGAT": (*MAGAT, "GAT-F-128")}
_BASELINES = ("HCA", "Replan", "greedy")


def draw_figure(measured: Measured, path: Path) -> None:
    """Draw success and flowtime of both families on both sets, with the shield idle, into the PNG file ``path``.

    Lines are as in the paper: solid for type F, dashed for type B, colours by features, green for four heads.
    """
    figure = Figure(figsize=(18.0, 8.6), facecolor="white", layout="constrained")
    axes = figure.subplots(2, 4)
    for one, (letter, title) in zip(axes.flat, PANELS.items(), strict=True):
        places = SAME if letter in "abcd" else DENSER
        family = "GNN" if letter in "abef" else "MAGAT"
        measure = "alpha" if letter in "aceg" else "delta_ft"
        for policy in (*_FAMILIES[family], *_BASELINES):
            _line(one, measured, policy, places, measure)
        one.set_title(f"{letter}) {title}", loc="left", fontsize=9)
        one.xaxis.set_major_locator(FixedLocator(range(len(places))))
        one.set_xticklabels(places, rotation=30, ha="right", fontsize=8)
        one.set_ylabel(r"$\alpha$" if measure == "alpha" else r"$\delta_{FT}$, first visit")
        one.grid(color=tint(INK, 0.1), linewidth=0.6)
        one.spines[["top", "right"]].set_visible(False)
        if measure == "delta_ft":
            one.set_yscale("symlog", linthresh=0.1)  # greedy is far above all others
    legend(figure)
    figure.savefig(path, format="png", dpi=80)


def _line(axes: Axes, measured: Measured, policy: str, places: tuple[str, ...], measure: str) -> None:
    points = [
        (index, estimate)
        for index, place in enumerate(places)
        if (estimate := measured.level(measure, policy, place)) is not None
    ]
    if not points:
        return
    values = [estimate.value for _, estimate in points]
    errors = [[max(0.0, e.value - e.low) for _, e in points], [max(0.0, e.high - e.value) for _, e in points]]
    size = re.search(r"-[FB]-(\d+)$", policy)
    colour = _NAMED.get(policy) or (_SIZES.get(size[1], INK) if size else "tab:green")
    axes.errorbar(
        [index for index, _ in points], values, yerr=errors, color=colour, linewidth=1.3, elinewidth=0.7, capsize=2.0,
        linestyle="--" if "-B-" in policy else ":" if policy in _BASELINES else "-", marker="o", markersize=3.5,
        label=policy,
    )  # fmt: skip
