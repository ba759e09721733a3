# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A whole episode in one picture.

Cells are ``(x, y)``, x to the right, y up. Sizes are in inches on the sheet, in cells on the map, and in points for
lines and letters.
"""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import patches, patheffects, rc_context
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.path import Path as Outline
from matplotlib.ticker import MaxNLocator

from magat_pictures.colours import ALARM, ATTENTION, INK, ROBOT_INKS, robot_colour, tint
from magat_pictures.drawn_episode import DrawnEpisode, FloatArray
from magat_sim.grid import IntArray
from magat_sim.radio import COMMUNICATION_RADIUS

_FEW = 40


@dataclass(frozen=True)
class Attention:
    """The attention of robots at one instant."""

    #: Weights e_ij by receiver i and sender j, for the messages that were received.
    weights: Mapping[tuple[int, int], float]
    #: The only robot whose attention is drawn; all robots if None.
    robot: int | None = None


def save_picture(
    episode: DrawnEpisode, path: Path, links_at: int | None = None, attention: Attention | None = None
) -> None:
    """Draw all paths from start to goal, the links of one instant, and robots at goal and blocked moves over time.

    Args:
        episode: to draw.
        path: file to write: SVG or PDF if its name ends so, otherwise PNG.
        links_at: instant, 0 to T, whose communication links are drawn; the one with most links if None.
        attention: at that instant; the links are as wide as the attention.

    Raises:
        ValueError: the episode has no instant ``links_at``.
    """
    instant = int(np.argmax([len(pairs) for pairs in episode.links])) if links_at is None else links_at
    if not 0 <= instant <= episode.steps:
        raise ValueError(f"links_at is {links_at}: the episode has the instants 0 to {episode.steps}")
    height, width = episode.obstacles.shape
    cell = min(0.55, (8.0 if max(width, height) <= 40 else 10.0) / max(width, height))
    inner = max(width * cell, 6.5)
    left, right, bottom, strip, gap, header = 0.55, 0.3, 0.45, 0.5, 0.33, 0.8
    base = bottom + 2 * strip + gap + 0.85
    sheet = (left + inner + right, base + height * cell + header)
    figure = Figure(figsize=sheet, facecolor="white")

    def place(x: float, y: float, across: float, up: float) -> Axes:
        return figure.add_axes((x / sheet[0], y / sheet[1], across / sheet[0], up / sheet[1]))

    board = place(left + (inner - width * cell) / 2, base, width * cell, height * cell)
    _draw_map(board, episode, cell)
    if attention is None:
        _draw_links(board, episode, cell, instant)
        _draw_paths(board, episode, cell, instant)
        _draw_marks(board, episode, cell)
    else:
        # The positions at that instant matter: the paths are faint.
        _draw_paths(board, episode, cell, instant, strength=0.3)
        _draw_attention(board, episode, cell, instant, attention)
    arrived = place(left, bottom + strip + gap, inner, strip)
    blocked = place(left, bottom, inner, strip)
    _draw_strips(arrived, blocked, episode, instant)
    figure.legend(
        handles=_legend(episode, instant, attention), loc="center left", ncols=5, fontsize=8,
        bbox_to_anchor=((left - 0.08) / sheet[0], (base - 0.42) / sheet[1]), labelcolor=tint(INK, 0.85),
        frameon=False, columnspacing=1.4, handletextpad=0.5, borderpad=0,
    )  # fmt: skip
    x, top = left / sheet[0], base + height * cell
    title = figure.text(x, (top + 0.42) / sheet[1], episode.title, fontsize=13, weight="bold", color=INK)
    title.set_parse_math(False)
    figure.text(x, (top + 0.18) / sheet[1], episode.outcome, fontsize=9, color=tint(INK, 0.75))
    with rc_context({"svg.hashsalt": "magat"}):  # the same picture gives the same file
        figure.savefig(
            path, format=path.suffix[1:] or "png", dpi=200, metadata={"Date": None} if path.suffix == ".svg" else None
        )


def _draw_map(board: Axes, episode: DrawnEpisode, cell: float) -> None:
    height, width = episode.obstacles.shape
    board.set(xlim=(-0.5, width - 0.5), ylim=(-0.5, height - 0.5))
    board.set_xticks(np.arange(0, width, _every(width)))
    board.set_yticks(np.arange(0, height, _every(height)))
    board.tick_params(length=0, labelsize=7, labelcolor=tint(INK, 0.55), pad=3)
    for spine in board.spines.values():
        spine.set(color=tint(INK, 0.35), linewidth=0.8)
    rows = [[(-0.5, y), (width - 0.5, y)] for y in np.arange(height - 1) + 0.5]
    columns = [[(x, -0.5), (x, height - 0.5)] for x in np.arange(width - 1) + 0.5]
    grid = LineCollection(rows + columns, colors=tint(INK, 0.09), linewidths=min(0.6, 2 * cell), zorder=0)
    board.add_collection(grid)
    y, x = np.nonzero(episode.obstacles)
    if len(x):
        block = _square((0.0, 0.0), 0.44, 0.16).get_path()
        blocks = [Outline(block.vertices + corner, block.codes) for corner in np.stack([x, y], axis=1)]
        board.add_patch(patches.PathPatch(Outline.make_compound_path(*blocks), fc=INK, lw=0, zorder=1))


def _every(cells: int) -> int:
    return 1 if cells <= 6 else 5 if cells <= 40 else 10


def _square(centre: tuple[float, float], half: float, rounding: float) -> patches.FancyBboxPatch:
    x, y = centre
    style = f"round,pad=0,rounding_size={rounding}"
    return patches.FancyBboxPatch((x - half, y - half), 2 * half, 2 * half, style)


def _draw_links(board: Axes, episode: DrawnEpisode, cell: float, instant: int) -> None:
    ends = (episode.positions[instant] + _lanes(episode))[episode.links[instant]]
    board.add_collection(LineCollection(ends, colors=INK, alpha=0.28, linewidths=min(0.9, 4 * cell), zorder=2))


def _draw_attention(board: Axes, episode: DrawnEpisode, cell: float, instant: int, attention: Attention) -> None:
    """The half of each link at its receiver, as wide as the attention; whole links if only one robot is drawn."""
    here = episode.positions[instant]
    shown = {link: e for link, e in attention.weights.items() if e > 0 and attention.robot in (None, link[0])}
    receiver, sender = np.array([*shown], dtype=np.int64).reshape(-1, 2).T
    share = np.array([*shown.values()])
    if attention.robot is not None:
        reach = patches.Circle(here[attention.robot], COMMUNICATION_RADIUS, fc="none", ec=tint(INK, 0.5), zorder=2)
        reach.set(linestyle=(0, (4, 3)), linewidth=0.9)
        board.add_patch(reach)
    ends = here[sender] if attention.robot is not None else (here[receiver] + here[sender]) / 2
    lines = np.stack([here[receiver], ends], axis=1)
    widths = (0.4 + 8 * share) * min(1.0, 4 * cell)
    links = LineCollection(list(lines), colors=ATTENTION, alpha=0.75, linewidths=widths, capstyle="butt", zorder=5)
    board.add_collection(links)
    for robot, arrived in enumerate(episode.on_goal[instant]):
        if not arrived:
            _draw_mark(board, tuple(episode.goals[robot]), 0.7, cell, "missed", robot)
        _draw_mark(board, tuple(here[robot]), 1.0, cell, "reached" if arrived else "last", robot)
    if attention.robot is not None and cell >= 0.15:
        for (x, y), value in zip(here[sender], share, strict=True):
            text = board.text(x + 0.45, y + 0.45, f"{100 * value:.0f} %", size=26 * cell, color=INK, zorder=8)
            text.set_path_effects([patheffects.withStroke(linewidth=2, foreground="white")])


def _draw_paths(board: Axes, episode: DrawnEpisode, cell: float, instant: int, strength: float = 1.0) -> None:
    width, lanes = min(2.4, 8.5 * cell), _lanes(episode)
    here = episode.positions[instant] + lanes
    for robot in range(episode.robots):
        line, order = _smooth(episode.positions[:, robot], lanes[robot]), 3 + robot / episode.robots
        look: dict[str, Any] = {"fc": "none", "capstyle": "round", "joinstyle": "round", "zorder": order}
        board.add_patch(patches.PathPatch(line, ec="white", lw=1.7 * width, **look))
        board.add_patch(patches.PathPatch(line, ec=tint(robot_colour(robot), strength), lw=width, **look))
        dot: dict[str, Any] = {"markersize": 3.2 * width, "markeredgewidth": 0.4 * width, "zorder": 5.0}
        board.plot(*here[robot], "o", color=robot_colour(robot), markeredgecolor="white", **dot)


def _lanes(episode: DrawnEpisode) -> FloatArray:
    """``[N, 2]`` the offset of each path from the cells' centres, so that paths do not hide each other."""
    beside = 0.5 * ((np.arange(episode.robots) + 0.5) / episode.robots - 0.5)
    return np.stack([beside, beside], axis=1)


def _smooth(cells: IntArray, lane: FloatArray) -> Outline:
    """The path ``cells`` (``[T + 1, 2]``), moved by ``lane`` except for its ends, with rounded corners."""
    moved = np.ones(len(cells), dtype=bool)
    moved[1:] = (cells[1:] != cells[:-1]).any(axis=1)
    corners = np.concatenate([cells[:1], cells[moved] + lane, cells[-1:]])
    vertices, codes = [corners[0]], [Outline.MOVETO]
    for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
        if np.allclose(before, after):  # the robot turns back: there is no corner to round
            vertices.append(corner)
            codes.append(Outline.LINETO)
        else:
            vertices += [corner + 0.35 * (before - corner), corner, corner + 0.35 * (after - corner)]
            codes += [Outline.LINETO, Outline.CURVE3, Outline.CURVE3]
    return Outline([*vertices, corners[-1]], [*codes, Outline.LINETO])


def _draw_marks(board: Axes, episode: DrawnEpisode, cell: float) -> None:
    """Starts, goals and, if a goal is missed, last positions; several marks in one cell are small, side by side."""
    marks: dict[tuple[int, ...], list[tuple[str, int]]] = defaultdict(list)
    for robot, reached in enumerate(episode.on_goal[-1]):
        start, goal, last = episode.positions[0, robot], episode.goals[robot], episode.positions[-1, robot]
        marks[tuple(start.tolist())].append(("start", robot))
        marks[tuple(goal.tolist())].append(("reached" if reached else "missed", robot))
        if not reached:
            marks[tuple(last.tolist())].append(("last", robot))
    enlarged = max(1.0, 0.2 / cell) if episode.robots <= _FEW else 1.0
    for (x, y), group in marks.items():
        size = enlarged * (1.0, 0.66, 0.58)[len(group) - 1]
        aside = enlarged * (0.0, 0.2, 0.22)[len(group) - 1]
        for (dx, dy), (kind, robot) in zip(((-1, 1), (1, -1), (-1, -1)), group, strict=False):
            _draw_mark(board, (x + aside * dx, y + aside * dy), size, cell, kind, robot)


def _draw_mark(board: Axes, centre: tuple[float, float], size: float, cell: float, kind: str, robot: int) -> None:
    solid = kind in ("reached", "last")
    fill, edge = (robot_colour(robot), "white") if solid else ("white", robot_colour(robot))
    round_one = kind in ("start", "last")
    shape = patches.Circle(centre, 0.36 * size) if round_one else _square(centre, 0.36 * size, 0.1 * size)
    shape.set(fc=fill, ec=edge, lw=min(1.6, 6 * cell) * (0.6 if solid else 1.0), zorder=6)
    board.add_patch(shape)
    if cell * size >= 0.11:
        number = str(robot)
        letters = 26 * cell * size * min(1.0, 2 / len(number))
        look: dict[str, Any] = {"ha": "center", "va": "center_baseline", "weight": "bold", "zorder": 7}
        board.text(*centre, number, size=letters, color=edge, **look)


def _draw_strips(arrived: Axes, blocked: Axes, episode: DrawnEpisode, instant: int) -> None:
    count, stopped = episode.on_goal.sum(axis=1), episode.blocked.sum(axis=1)
    arrived.stairs(count, np.arange(episode.steps + 2) - 0.5, fill=True, color=tint(ROBOT_INKS[2], 0.3))
    arrived.stairs(count, np.arange(episode.steps + 2) - 0.5, color=ROBOT_INKS[2], linewidth=1.2, baseline=None)
    blocked.stairs(stopped, np.arange(episode.steps + 1), fill=True, color=tint(ALARM, 0.75))
    most = max(1, int(stopped.max(initial=0)))
    for axes, title, top in ((arrived, "Robots at goal", episode.robots), (blocked, "Blocked moves", most)):
        axes.set_title(title, loc="left", fontsize=8, color=tint(INK, 0.85), pad=4)
        axes.set(xlim=(-0.5, episode.steps + 0.5), ylim=(0, 1.08 * top), yticks=[0, top])
        axes.axvline(instant, color=tint(INK, 0.6), linewidth=0.8, linestyle=(0, (3, 2)))
        axes.tick_params(length=2, labelsize=7, color=tint(INK, 0.35), labelcolor=tint(INK, 0.7), pad=2)
        axes.spines[["top", "right"]].set_visible(False)
        axes.spines[["left", "bottom"]].set(color=tint(INK, 0.35), linewidth=0.8)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=12, min_n_ticks=1))
    arrived.tick_params(labelbottom=False)
    blocked.set_xlabel("step", fontsize=8, color=tint(INK, 0.7), labelpad=1)


def _legend(episode: DrawnEpisode, instant: int, attention: Attention | None) -> list[Line2D]:
    ink = tint(INK, 0.75)

    def mark(shape: str, fill: str, label: str) -> Line2D:
        return Line2D([], [], ls="none", marker=shape, ms=7, mec=ink, mfc=fill, mew=1.3, label=label)

    if attention is not None:
        subject = "attention" if attention.robot is None else f"attention of robot {attention.robot}"
        label = f"{subject} at step {instant} (width)"
        return [
            mark("o", ink, "robot"),
            mark("s", "white", "its goal"),
            mark("s", ink, "robot at goal"),
            Line2D([], [], color=ATTENTION, alpha=0.75, lw=4, label=label),
        ]
    entries = [mark("o", "white", "start")]
    if episode.on_goal[-1].any():
        entries.append(mark("s", ink, "goal, reached"))
    if not episode.on_goal[-1].all():
        entries += [mark("s", "white", "goal, missed"), mark("o", ink, "last position")]
    if links := len(episode.links[instant]):
        label = f"in range ({COMMUNICATION_RADIUS:g} cells) at step {instant}: {links} links"
        entries.append(Line2D([], [], color=INK, alpha=0.4, lw=1, marker="o", ms=4, mew=0, label=label))
    return entries
