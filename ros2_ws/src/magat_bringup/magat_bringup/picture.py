"""One recorded episode to look at: `save_picture` draws all of it at once, `save_animation` plays it.

Cells are ``(x, y)``, x to the right, y up, in both. Every colour is a tint of one of a few inks on white
paper; that is also how the animation can do with one palette.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib import patches
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.path import Path as Outline
from matplotlib.ticker import MaxNLocator
from PIL import Image, ImageColor, ImageDraw, ImageFont

from magat_sim.grid import BoolArray, IntArray, inside
from magat_sim.radio import COMMUNICATION_RADIUS, neighbours

FloatArray = npt.NDArray[np.float64]

_INK = "#2b3440"
_ALARM = "#e03131"
_ROBOTS = (
    "#2f6fde", "#ee7b10", "#1f9d57", "#cf2f74", "#7d4fd8", "#0d98ae",
    "#96602f", "#818f0e", "#e265b4", "#22408c", "#12664a", "#b5452b",
)  # fmt: skip


@lru_cache(4096)
def _tint(ink: str, strength: float) -> str:
    """``ink`` thinned on white paper, from 0 (white) to 1 (the ink itself)."""
    red, green, blue = (round(255 + (value - 255) * strength) for value in ImageColor.getrgb(ink)[:3])
    return f"#{red:02x}{green:02x}{blue:02x}"


def _glaze(ink: str, strength: float) -> str:
    """``ink`` that lets through what it is painted on, from 0 (nothing but that) to 1 (the ink itself)."""
    return f"{ink}{round(255 * strength):02x}"


def _colour(robot: int) -> str:
    return _ROBOTS[robot % len(_ROBOTS)]


@dataclass(frozen=True)
class EpisodeRecord:
    """What happened in one episode of N robots and T steps, T possibly 0.

    Raises:
        ValueError: shapes that do not belong together, or a cell outside the map.
    """

    #: ``[H, W]`` bool, indexed ``[y, x]``; True is an obstacle.
    obstacles: BoolArray
    #: ``[N, 2]`` int64 cells ``(x, y)``.
    goals: IntArray
    #: ``[T + 1, N, 2]`` int64 cells ``(x, y)``, at the start and after each step.
    positions: IntArray
    #: ``[T, N]`` bool, moves that the shield turned into idle.
    blocked: BoolArray
    #: A line over the drawing.
    title: str

    def __post_init__(self) -> None:
        """Check that the arrays are of one episode."""
        grid, goals, positions, blocked = (a.shape for a in (self.obstacles, self.goals, self.positions, self.blocked))
        if len(grid) != 2 or 0 in grid:
            raise ValueError(f"obstacles have shape {grid}: give a non-empty [height, width] array")
        if len(goals) != 2 or goals[1] != 2 or goals[0] == 0:
            raise ValueError(f"goals have shape {goals}: give [N, 2] cells (x, y), N at least 1")
        if len(positions) != 3 or positions[0] == 0 or positions[1:] != goals:
            raise ValueError(f"positions have shape {positions}: give [T + 1, N, 2], with N = {goals[0]} as in goals")
        if blocked != (positions[0] - 1, positions[1]):
            raise ValueError(f"blocked has shape {blocked}: give [T, N], one instant less than positions {positions}")
        for what, cells in (("goals", self.goals), ("positions", self.positions)):
            if not inside(grid, cells).all():
                raise ValueError(f"{what} leave the map, which is {grid[1]} wide and {grid[0]} high")

    @property
    def robots(self) -> int:
        """Number of robots, N."""
        return len(self.goals)

    @property
    def steps(self) -> int:
        """Number of steps, T."""
        return len(self.positions) - 1

    @cached_property
    def on_goal(self) -> BoolArray:
        """``[T + 1, N]`` who is on its goal at each instant."""
        return (self.positions == self.goals).all(axis=2)

    @cached_property
    def links(self) -> list[IntArray]:
        """``[T + 1]`` arrays ``[L, 2]``: the pairs of robots that hear each other, the lower number first."""
        together = np.zeros(self.robots, dtype=np.int64)
        found = []
        for position in self.positions:
            heard = neighbours(together, position, COMMUNICATION_RADIUS)
            robot, column = np.nonzero(heard > np.arange(self.robots)[:, None])
            found.append(np.stack([robot, heard[robot, column]], axis=1))
        return found

    @property
    def outcome(self) -> str:
        """The episode in half a sentence."""
        arrived = f"{self.on_goal[-1].sum()} of {self.robots} robots at goal"
        return f"{arrived} after {self.steps} steps, {self.blocked.sum()} moves blocked"


# --- The picture: inches on the sheet, cells on the map, points (1/72 inch) for lines and letters ---

#: Of more robots than this, marks are not enlarged to make room for numbers.
_FEW = 40


def save_picture(record: EpisodeRecord, path: Path, links_at: int | None = None) -> None:
    """Draw the whole episode: paths from start to goal, the links of one instant, and how it went over time.

    Args:
        record: the episode.
        path: PNG file to write.
        links_at: instant, 0 to T, whose communication links are drawn; the one with most links if None.

    Raises:
        ValueError: the episode has no instant ``links_at``.
    """
    instant = int(np.argmax([len(pairs) for pairs in record.links])) if links_at is None else links_at
    if not 0 <= instant <= record.steps:
        raise ValueError(f"links_at is {links_at}: the episode has the instants 0 to {record.steps}")
    height, width = record.obstacles.shape
    cell = min(0.55, (8.0 if max(width, height) <= 40 else 10.0) / max(width, height))
    inner = max(width * cell, 6.5)
    left, right, bottom, strip, gap, header = 0.55, 0.3, 0.45, 0.5, 0.33, 0.8
    base = bottom + 2 * strip + gap + 0.85
    sheet = (left + inner + right, base + height * cell + header)
    figure = Figure(figsize=sheet, facecolor="white")

    def place(x: float, y: float, across: float, up: float) -> Axes:
        return figure.add_axes((x / sheet[0], y / sheet[1], across / sheet[0], up / sheet[1]))

    board = place(left + (inner - width * cell) / 2, base, width * cell, height * cell)
    _draw_map(board, record, cell)
    _draw_links(board, record, cell, instant)
    _draw_paths(board, record, cell, instant)
    _draw_marks(board, record, cell)
    arrived = place(left, bottom + strip + gap, inner, strip)
    blocked = place(left, bottom, inner, strip)
    _draw_strips(arrived, blocked, record, instant)
    figure.legend(
        handles=_legend(record, instant), loc="center left", ncols=5, fontsize=8,
        bbox_to_anchor=((left - 0.08) / sheet[0], (base - 0.42) / sheet[1]), labelcolor=_tint(_INK, 0.85),
        frameon=False, columnspacing=1.4, handletextpad=0.5, borderpad=0,
    )  # fmt: skip
    x, top = left / sheet[0], base + height * cell
    title = figure.text(x, (top + 0.42) / sheet[1], record.title, fontsize=13, weight="bold", color=_INK)
    title.set_parse_math(False)
    figure.text(x, (top + 0.18) / sheet[1], record.outcome, fontsize=9, color=_tint(_INK, 0.75))
    figure.savefig(path, format="png", dpi=200)


def _draw_map(board: Axes, record: EpisodeRecord, cell: float) -> None:
    height, width = record.obstacles.shape
    board.set(xlim=(-0.5, width - 0.5), ylim=(-0.5, height - 0.5))
    board.set_xticks(np.arange(0, width, _every(width)))
    board.set_yticks(np.arange(0, height, _every(height)))
    board.tick_params(length=0, labelsize=7, labelcolor=_tint(_INK, 0.55), pad=3)
    for spine in board.spines.values():
        spine.set(color=_tint(_INK, 0.35), linewidth=0.8)
    rows = [[(-0.5, y), (width - 0.5, y)] for y in np.arange(height - 1) + 0.5]
    columns = [[(x, -0.5), (x, height - 0.5)] for x in np.arange(width - 1) + 0.5]
    grid = LineCollection(rows + columns, colors=_tint(_INK, 0.09), linewidths=min(0.6, 2 * cell), zorder=0)
    board.add_collection(grid)
    y, x = np.nonzero(record.obstacles)
    if len(x):
        block = _square((0.0, 0.0), 0.44, 0.16).get_path()
        blocks = [Outline(block.vertices + corner, block.codes) for corner in np.stack([x, y], axis=1)]
        board.add_patch(patches.PathPatch(Outline.make_compound_path(*blocks), fc=_INK, lw=0, zorder=1))


def _every(cells: int) -> int:
    return 1 if cells <= 6 else 5 if cells <= 40 else 10


def _square(centre: tuple[float, float], half: float, rounding: float) -> patches.FancyBboxPatch:
    x, y = centre
    style = f"round,pad=0,rounding_size={rounding}"
    return patches.FancyBboxPatch((x - half, y - half), 2 * half, 2 * half, style)


def _draw_links(board: Axes, record: EpisodeRecord, cell: float, instant: int) -> None:
    ends = (record.positions[instant] + _lanes(record))[record.links[instant]]
    board.add_collection(LineCollection(ends, colors=_INK, alpha=0.28, linewidths=min(0.9, 4 * cell), zorder=2))


def _draw_paths(board: Axes, record: EpisodeRecord, cell: float, instant: int) -> None:
    width, lanes = min(2.4, 8.5 * cell), _lanes(record)
    here = record.positions[instant] + lanes
    for robot in range(record.robots):
        line, order = _smooth(record.positions[:, robot], lanes[robot]), 3 + robot / record.robots
        look: dict[str, Any] = {"fc": "none", "capstyle": "round", "joinstyle": "round", "zorder": order}
        board.add_patch(patches.PathPatch(line, ec="white", lw=1.7 * width, **look))
        board.add_patch(patches.PathPatch(line, ec=_colour(robot), lw=width, **look))
        dot: dict[str, Any] = {"markersize": 3.2 * width, "markeredgewidth": 0.4 * width, "zorder": 5.0}
        board.plot(*here[robot], "o", color=_colour(robot), markeredgecolor="white", **dot)


def _lanes(record: EpisodeRecord) -> FloatArray:
    """``[N, 2]`` how far beside the middle of the cells each path runs, so that none hides another."""
    beside = 0.5 * ((np.arange(record.robots) + 0.5) / record.robots - 0.5)
    return np.stack([beside, beside], axis=1)


def _smooth(cells: IntArray, lane: FloatArray) -> Outline:
    """The path ``cells`` (``[T + 1, 2]``), moved by ``lane`` but for its ends, with its corners rounded."""
    moved = np.ones(len(cells), dtype=bool)
    moved[1:] = (cells[1:] != cells[:-1]).any(axis=1)
    corners = np.concatenate([cells[:1], cells[moved] + lane, cells[-1:]])
    vertices, codes = [corners[0]], [Outline.MOVETO]
    for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
        if np.allclose(before, after):  # it turns back: there is no corner to round
            vertices.append(corner)
            codes.append(Outline.LINETO)
        else:
            vertices += [corner + 0.35 * (before - corner), corner, corner + 0.35 * (after - corner)]
            codes += [Outline.LINETO, Outline.CURVE3, Outline.CURVE3]
    return Outline([*vertices, corners[-1]], [*codes, Outline.LINETO])


def _draw_marks(board: Axes, record: EpisodeRecord, cell: float) -> None:
    """Starts, goals, and where those that missed them ended; several in one cell are small, side by side."""
    marks: dict[tuple[int, ...], list[tuple[str, int]]] = defaultdict(list)
    for robot, reached in enumerate(record.on_goal[-1]):
        start, goal, last = record.positions[0, robot], record.goals[robot], record.positions[-1, robot]
        marks[tuple(start.tolist())].append(("start", robot))
        marks[tuple(goal.tolist())].append(("reached" if reached else "missed", robot))
        if not reached:
            marks[tuple(last.tolist())].append(("last", robot))
    enlarged = max(1.0, 0.2 / cell) if record.robots <= _FEW else 1.0
    for (x, y), group in marks.items():
        size = enlarged * (1.0, 0.66, 0.58)[len(group) - 1]
        aside = enlarged * (0.0, 0.2, 0.22)[len(group) - 1]
        for (dx, dy), (kind, robot) in zip(((-1, 1), (1, -1), (-1, -1)), group, strict=False):
            _draw_mark(board, (x + aside * dx, y + aside * dy), size, cell, kind, robot)


def _draw_mark(board: Axes, centre: tuple[float, float], size: float, cell: float, kind: str, robot: int) -> None:
    solid = kind in ("reached", "last")
    fill, edge = (_colour(robot), "white") if solid else ("white", _colour(robot))
    round_one = kind in ("start", "last")
    shape = patches.Circle(centre, 0.36 * size) if round_one else _square(centre, 0.36 * size, 0.1 * size)
    shape.set(fc=fill, ec=edge, lw=min(1.6, 6 * cell) * (0.6 if solid else 1.0), zorder=6)
    board.add_patch(shape)
    if cell * size >= 0.11:
        number = str(robot)
        letters = 26 * cell * size * min(1.0, 2 / len(number))
        look: dict[str, Any] = {"ha": "center", "va": "center_baseline", "weight": "bold", "zorder": 7}
        board.text(*centre, number, size=letters, color=edge, **look)


def _draw_strips(arrived: Axes, blocked: Axes, record: EpisodeRecord, instant: int) -> None:
    count, stopped = record.on_goal.sum(axis=1), record.blocked.sum(axis=1)
    arrived.stairs(count, np.arange(record.steps + 2) - 0.5, fill=True, color=_tint(_ROBOTS[2], 0.3))
    arrived.stairs(count, np.arange(record.steps + 2) - 0.5, color=_ROBOTS[2], linewidth=1.2, baseline=None)
    blocked.stairs(stopped, np.arange(record.steps + 1), fill=True, color=_tint(_ALARM, 0.75))
    most = max(1, int(stopped.max(initial=0)))
    for axes, title, top in ((arrived, "Robots at goal", record.robots), (blocked, "Blocked moves", most)):
        axes.set_title(title, loc="left", fontsize=8, color=_tint(_INK, 0.85), pad=4)
        axes.set(xlim=(-0.5, record.steps + 0.5), ylim=(0, 1.08 * top), yticks=[0, top])
        axes.axvline(instant, color=_tint(_INK, 0.6), linewidth=0.8, linestyle=(0, (3, 2)))
        axes.tick_params(length=2, labelsize=7, color=_tint(_INK, 0.35), labelcolor=_tint(_INK, 0.7), pad=2)
        axes.spines[["top", "right"]].set_visible(False)
        axes.spines[["left", "bottom"]].set(color=_tint(_INK, 0.35), linewidth=0.8)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=12, min_n_ticks=1))
    arrived.tick_params(labelbottom=False)
    blocked.set_xlabel("step", fontsize=8, color=_tint(_INK, 0.7), labelpad=1)


def _legend(record: EpisodeRecord, instant: int) -> list[Line2D]:
    ink = _tint(_INK, 0.75)

    def mark(shape: str, fill: str, label: str) -> Line2D:
        return Line2D([], [], ls="none", marker=shape, ms=7, mec=ink, mfc=fill, mew=1.3, label=label)

    entries = [mark("o", "white", "start")]
    if record.on_goal[-1].any():
        entries.append(mark("s", ink, "goal, reached"))
    if not record.on_goal[-1].all():
        entries += [mark("s", "white", "goal, missed"), mark("o", ink, "last position")]
    if links := len(record.links[instant]):
        label = f"in range ({COMMUNICATION_RADIUS:g} cells) at step {instant}: {links} links"
        entries.append(Line2D([], [], color=_INK, alpha=0.4, lw=1, marker="o", ms=4, mew=0, label=label))
    return entries


# --- The animation: pixels of a drawing that is made at twice its size and then shrunk ---

_FINER = 2
_FRAMES_PER_STEP = 4
_MOST_FRAMES = 280
_FRAME_MS, _FIRST_MS, _LAST_MS = 40, 400, 2000
#: Steps that a trail reaches back, and that the ring of a blocked move lasts.
_TRAIL, _RING = 6, 2
#: The last entry of the palette is no colour: it stands for "as in the frame before".
_UNCHANGED = 255


def save_animation(record: EpisodeRecord, path: Path, on_frame: Callable[[int, int], None] | None = None) -> None:
    """Play the episode: four frames a step, fewer where that would make more than about 300 frames.

    Args:
        record: the episode.
        path: GIF file to write; it loops.
        on_frame: called with the number of frames drawn so far and of all frames.
    """
    count = min(_FRAMES_PER_STEP * record.steps, _MOST_FRAMES) + 1
    stage = _Stage(record)

    def frames() -> Iterator[Image.Image]:
        for number, time in enumerate(np.linspace(0, record.steps, count).tolist(), start=1):
            yield stage.frame(time)
            if on_frame is not None:
                on_frame(number, count)

    sequence = frames()
    durations = [_FIRST_MS, *[_FRAME_MS] * (count - 2), _LAST_MS][-count:]
    next(sequence).save(
        path, format="GIF", save_all=True, append_images=sequence, duration=durations, loop=0,
        optimize=True, transparency=_UNCHANGED,
    )  # fmt: skip


class _Stage:
    """What all frames of an animation share, and `frame`, which draws one."""

    def __init__(self, record: EpisodeRecord) -> None:
        self.record = record
        height, width = record.obstacles.shape
        self.cell = _FINER * max(2, min(48, round(585 / max(width, height))))
        margin, header, footer = _FINER * 16, _FINER * 44, _FINER * 44
        across = max(width * self.cell + 2 * margin, _FINER * 380)
        self.size = (across, header + height * self.cell + footer)
        self.left, self.top = (across - width * self.cell) // 2, header
        self.edges = (margin, across - margin)
        self.bar = (self.size[1] - _FINER * 5, self.size[1] - _FINER * 2)
        self.numbered = self.cell >= _FINER * 16
        self.palette = _palette()
        self.links = [set(map(tuple, pairs.tolist())) for pairs in record.links]
        self.goals = [self._sprite(robot, "goal") for robot in range(record.robots)]
        self.moving = [self._sprite(robot, "moving") for robot in range(record.robots)]
        self.settled = [self._sprite(robot, "settled") for robot in range(record.robots)]
        self.empty = self._empty()
        self._backdrop = (-1, self.empty)

    def frame(self, time: float) -> Image.Image:
        """The drawing at ``time``, in steps, 0 to T; between two instants robots are between two cells."""
        record = self.record
        before, after = int(time), min(int(time) + 1, record.steps)
        place = self._pixels(self._positions(time))
        image = self._background(before).copy()
        draw = ImageDraw.Draw(image, "RGBA")  # links and rings are translucent
        left, right = self.edges
        done = left + (right - left) * (time / record.steps if record.steps else 1.0)
        draw.rectangle((left, self.bar[0], done, self.bar[1]), fill=_tint(_INK, 0.6))
        self._draw_trails(draw, time)
        settled = record.on_goal[before] & record.on_goal[after]
        for robot in np.flatnonzero(~settled).tolist():
            _paste(image, self.goals[robot], self._pixels(record.goals[robot]))
        self._draw_links(draw, place, before, after, time - before)
        for robot in np.argsort(~settled, kind="stable").tolist():  # those under way over those that arrived
            _paste(image, (self.settled if settled[robot] else self.moving)[robot], place[robot])
        self._draw_rings(draw, place, time)
        return image.reduce(_FINER).quantize(palette=self.palette, dither=Image.Dither.NONE)

    def _positions(self, time: float) -> FloatArray:
        before, after = int(time), min(int(time) + 1, self.record.steps)
        start, end = self.record.positions[before], self.record.positions[after]
        return start + (time - before) * (end - start)

    def _pixels(self, cells: npt.ArrayLike) -> FloatArray:
        """The pixels ``[..., 2]``, y down, in the middle of ``cells`` ``[..., 2]``, y up."""
        origin = (self.left + 0.5 * self.cell, self.top + (len(self.record.obstacles) - 0.5) * self.cell)
        return origin + np.asarray(cells) * (self.cell, -self.cell)

    def _background(self, step: int) -> Image.Image:
        """What stays for the whole of ``step``: the map and the texts."""
        if self._backdrop[0] != step:
            record, (left, right), low = self.record, self.edges, self.size[1] - _FINER * 20
            image = self.empty.copy()
            draw = ImageDraw.Draw(image)
            for x, y, anchor, text in (
                (right, self.top / 2, "rm", f"step {step} / {record.steps}"),
                (left, low, "lm", f"at goal {record.on_goal[step].sum()} / {record.robots}"),
                (right, low, "rm", f"blocked moves {record.blocked[:step].sum()}"),
            ):
                draw.text((x, y), text, fill=_tint(_INK, 0.75), font=_font(_FINER * 12), anchor=anchor)
            self._backdrop = (step, image)
        return self._backdrop[1]

    def _empty(self) -> Image.Image:
        """The map, the title and the track of the progress bar."""
        image = Image.new("RGB", self.size, "white")
        draw = ImageDraw.Draw(image)
        height, width = self.record.obstacles.shape
        right, bottom = self.left + width * self.cell, self.top + height * self.cell
        for x in range(self.left, right + 1, self.cell):
            draw.line([(x, self.top), (x, bottom)], fill=_tint(_INK, 0.1), width=_FINER)
        for y in range(self.top, bottom + 1, self.cell):
            draw.line([(self.left, y), (right, y)], fill=_tint(_INK, 0.1), width=_FINER)
        frame = (self.left - 1, self.top - 1, right + 1, bottom + 1)
        draw.rectangle(frame, outline=_tint(_INK, 0.35), width=_FINER)
        for centre in self._pixels(np.argwhere(self.record.obstacles)[:, ::-1]):
            draw.rounded_rectangle(_box(centre, 0.45 * self.cell), 0.16 * self.cell, fill=_INK)
        draw.rectangle((self.edges[0], self.bar[0], self.edges[1], self.bar[1]), fill=_tint(_INK, 0.1))
        title = self._fit(self.record.title, self.edges[1] - self.edges[0] - _FINER * 105)
        draw.text((self.edges[0], self.top / 2), title, fill=_INK, font=_font(_FINER * 14), anchor="lm")
        return image

    def _fit(self, text: str, width: float) -> str:
        font = _font(_FINER * 14)
        if font.getlength(text) <= width:
            return text
        while text and font.getlength(f"{text}…") > width:
            text = text[:-1].rstrip(" ,")
        return f"{text}…"

    def _sprite(self, robot: int, kind: str) -> Image.Image:
        """A mark on nothing: a hollow square ("goal"), a disc ("moving"), a checked square ("settled")."""
        cell = 4 * self.cell  # shrunk to a quarter below, for smooth edges wherever it is pasted
        side = 4 * round(1.2 * self.cell)
        image = Image.new("RGBA", (side, side))
        draw = ImageDraw.Draw(image)
        centre, colour, number = np.array([side / 2, side / 2]), _colour(robot), str(robot)
        if kind == "moving":
            draw.ellipse(_box(centre, 0.44 * cell), fill="white")
            draw.ellipse(_box(centre, 0.39 * cell), fill=colour)
        elif kind == "settled":
            draw.rounded_rectangle(_box(centre, 0.43 * cell), 0.16 * cell, fill=colour)
        else:
            look = {
                "fill": _tint(colour, 0.12),
                "outline": colour,
                "width": max(round(0.07 * cell), 4 * _FINER),
            }
            draw.rounded_rectangle(_box(centre, 0.38 * cell), 0.14 * cell, **look)
        if self.numbered:
            font = _font(0.42 * cell * min(1.0, 2 / len(number)))
            draw.text(tuple(centre), number, fill=colour if kind == "goal" else "white", font=font, anchor="mm")
        if self.numbered and kind == "settled":
            badge = centre + np.array([0.36, -0.36]) * cell
            draw.ellipse(_box(badge, 0.22 * cell), fill="white")
            check = badge + 0.11 * cell * np.array([(-1, 0), (-0.3, 0.75), (1, -0.8)])
            draw.line(check.ravel().tolist(), fill=colour, width=round(0.09 * cell), joint="curve")
        return image.reduce(4)

    def _draw_trails(self, draw: ImageDraw.ImageDraw, time: float) -> None:
        """Where each robot came from: thinner and paler the longer ago."""
        instants = [*range(max(0, int(time) - _TRAIL), int(np.ceil(time))), time]
        corners = self._pixels([self._positions(instant) for instant in instants])
        fresh = [1 - (time - instant) / (_TRAIL + 1) for instant in instants]
        for piece in range(len(instants) - 1):
            start, end = corners[piece : piece + 2]
            wide, wider = 0.2 * self.cell * fresh[piece], 0.2 * self.cell * fresh[piece + 1]
            for robot in np.flatnonzero((start != end).any(axis=1)).tolist():
                a, b, fill = start[robot], end[robot], _tint(_colour(robot), 0.5 * fresh[piece + 1])
                side = (b - a)[::-1] * (-1, 1) / np.abs(b - a).max()
                draw.polygon([*a + wide * side, *b + wider * side, *b - wider * side, *a - wide * side], fill=fill)
                draw.ellipse(_box(b, wider), fill=fill)

    def _draw_links(
        self, draw: ImageDraw.ImageDraw, place: FloatArray, before: int, after: int, fraction: float
    ) -> None:
        """The links of both instants, so that a link that appears or breaks fades."""
        width = max(2, round(0.04 * self.cell))
        for pair in self.links[before] | self.links[after]:
            strength = (pair in self.links[before]) * (1 - fraction) + (pair in self.links[after]) * fraction
            draw.line([tuple(place[robot]) for robot in pair], fill=_glaze(_INK, 0.3 * strength), width=width)

    def _draw_rings(self, draw: ImageDraw.ImageDraw, place: FloatArray, time: float) -> None:
        for step in range(max(0, int(time) - _RING + 1), min(int(time) + 1, self.record.steps)):
            age = (time - step) / _RING
            for robot in np.flatnonzero(self.record.blocked[step]):
                box = _box(place[robot], (0.44 + 0.16 * age) * self.cell)
                draw.ellipse(box, outline=_glaze(_ALARM, 1 - age), width=max(_FINER, round(0.09 * self.cell)))


def _box(centre: FloatArray, half: float) -> tuple[float, float, float, float]:
    x, y = centre.tolist()
    return (x - half, y - half, x + half, y + half)


def _paste(image: Image.Image, sprite: Image.Image, centre: FloatArray) -> None:
    x, y = (centre - (sprite.width / 2, sprite.height / 2)).round().astype(int).tolist()
    image.paste(sprite, (x, y), sprite)


@lru_cache
def _font(size: float) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(str(Path(matplotlib.get_data_path(), "fonts/ttf/DejaVuSans-Bold.ttf")), size)


def _palette() -> Image.Image:
    """An image whose palette is tints of each ink, and white; none of its colours needs the last entry."""
    levels = {_INK: 24} | dict.fromkeys((_ALARM, *_ROBOTS), 17)
    tints = [_tint(ink, level / count) for ink, count in levels.items() for level in range(1, count + 1)]
    colours = [ImageColor.getrgb(tint) for tint in tints]
    white = [(255, 255, 255)] * (256 - len(colours))
    palette = Image.new("P", (1, 1))
    palette.putpalette([value for colour in (*colours, *white) for value in colour])
    return palette
