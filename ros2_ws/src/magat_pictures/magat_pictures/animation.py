# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""An episode as an animated GIF.

Frames are drawn at twice their size and then reduced, which smooths the edges. Cells are ``(x, y)``, x to the right, y
up.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from magat_pictures.colours import ALARM, ATTENTION, INK, ROBOT_INKS, rgb, robot_colour, tint, translucent
from magat_pictures.drawn_episode import DrawnEpisode, FloatArray

_FINER = 2
_FRAMES_PER_STEP = 4
_MOST_FRAMES = 280
_FRAME_MS, _FIRST_MS, _LAST_MS = 40, 400, 2000
#: Length of a trail, and duration of the ring around a blocked robot, steps.
_TRAIL, _RING = 6, 2
#: The last entry of the palette is transparent: the pixel is as in the frame before.
_UNCHANGED = 255


def save_animation(
    episode: DrawnEpisode,
    path: Path,
    on_frame: Callable[[int, int], None] | None = None,
    attention: Sequence[Mapping[tuple[int, int], float]] | None = None,
) -> None:
    """Write an animation with four frames per step, or fewer if these were more than about 300 frames.

    Args:
        episode: to draw.
        path: GIF file to write; it loops.
        on_frame: called with the number of frames drawn so far and the number of all frames.
        attention: for each of the T + 1 instants the attention by receiver and sender; the half of a link at the
            receiver is as wide as its attention. All links are alike if None.
    """
    count = min(_FRAMES_PER_STEP * episode.steps, _MOST_FRAMES) + 1
    stage = _Stage(episode, attention)

    def frames() -> Iterator[Image.Image]:
        for number, time in enumerate(np.linspace(0, episode.steps, count).tolist(), start=1):
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
    """Draws the frames of one animation, with the parts that they share."""

    def __init__(self, episode: DrawnEpisode, attention: Sequence[Mapping[tuple[int, int], float]] | None) -> None:
        self.episode, self.attention = episode, attention
        height, width = episode.obstacles.shape
        self.cell = _FINER * max(2, min(48, round(585 / max(width, height))))
        margin, header, footer = _FINER * 16, _FINER * 44, _FINER * 44
        across = max(width * self.cell + 2 * margin, _FINER * 380)
        self.size = (across, header + height * self.cell + footer)
        self.left, self.top = (across - width * self.cell) // 2, header
        self.edges = (margin, across - margin)
        self.bar = (self.size[1] - _FINER * 5, self.size[1] - _FINER * 2)
        self.numbered = self.cell >= _FINER * 16
        self.palette = _palette()
        self.links = [set(map(tuple, pairs.tolist())) for pairs in episode.links]
        self.goals = [self._sprite(robot, "goal") for robot in range(episode.robots)]
        self.moving = [self._sprite(robot, "moving") for robot in range(episode.robots)]
        self.settled = [self._sprite(robot, "settled") for robot in range(episode.robots)]
        self.empty = self._empty()
        self._backdrop = (-1, self.empty)

    def frame(self, time: float) -> Image.Image:
        """The frame at ``time``, in steps, 0 to T. Between two instants robots are between two cells."""
        episode = self.episode
        before, after = int(time), min(int(time) + 1, episode.steps)
        place = self._pixels(self._positions(time))
        image = self._background(before).copy()
        draw = ImageDraw.Draw(image, "RGBA")  # links and rings are translucent
        left, right = self.edges
        done = left + (right - left) * (time / episode.steps if episode.steps else 1.0)
        draw.rectangle((left, self.bar[0], done, self.bar[1]), fill=tint(INK, 0.6))
        self._draw_trails(draw, time)
        settled = episode.on_goal[before] & episode.on_goal[after]
        for robot in np.flatnonzero(~settled).tolist():
            _paste(image, self.goals[robot], self._pixels(episode.goals[robot]))
        self._draw_links(draw, place, before, after, time - before)
        for robot in np.argsort(~settled, kind="stable").tolist():  # moving robots over those at their goals
            _paste(image, (self.settled if settled[robot] else self.moving)[robot], place[robot])
        self._draw_rings(draw, place, time)
        return image.reduce(_FINER).quantize(palette=self.palette, dither=Image.Dither.NONE)

    def _positions(self, time: float) -> FloatArray:
        before, after = int(time), min(int(time) + 1, self.episode.steps)
        start, end = self.episode.positions[before], self.episode.positions[after]
        return start + (time - before) * (end - start)

    def _pixels(self, cells: npt.ArrayLike) -> FloatArray:
        """The pixels ``[..., 2]``, y down, of the centres of ``cells`` ``[..., 2]``, y up."""
        origin = (self.left + 0.5 * self.cell, self.top + (len(self.episode.obstacles) - 0.5) * self.cell)
        return origin + np.asarray(cells) * (self.cell, -self.cell)

    def _background(self, step: int) -> Image.Image:
        """What does not change during ``step``: the map and the texts."""
        if self._backdrop[0] != step:
            episode, (left, right), low = self.episode, self.edges, self.size[1] - _FINER * 20
            image = self.empty.copy()
            draw = ImageDraw.Draw(image)
            for x, y, anchor, text in (
                (right, self.top / 2, "rm", f"step {step} / {episode.steps}"),
                (left, low, "lm", f"at goal {episode.on_goal[step].sum()} / {episode.robots}"),
                (right, low, "rm", f"blocked moves {episode.blocked[:step].sum()}"),
            ):
                draw.text((x, y), text, fill=tint(INK, 0.75), font=_font(_FINER * 12), anchor=anchor)
            self._backdrop = (step, image)
        return self._backdrop[1]

    def _empty(self) -> Image.Image:
        """The map, the title and the track of the progress bar."""
        image = Image.new("RGB", self.size, "white")
        draw = ImageDraw.Draw(image)
        height, width = self.episode.obstacles.shape
        right, bottom = self.left + width * self.cell, self.top + height * self.cell
        for x in range(self.left, right + 1, self.cell):
            draw.line([(x, self.top), (x, bottom)], fill=tint(INK, 0.1), width=_FINER)
        for y in range(self.top, bottom + 1, self.cell):
            draw.line([(self.left, y), (right, y)], fill=tint(INK, 0.1), width=_FINER)
        frame = (self.left - 1, self.top - 1, right + 1, bottom + 1)
        draw.rectangle(frame, outline=tint(INK, 0.35), width=_FINER)
        for centre in self._pixels(np.argwhere(self.episode.obstacles)[:, ::-1]):
            draw.rounded_rectangle(_box(centre, 0.45 * self.cell), 0.16 * self.cell, fill=INK)
        draw.rectangle((self.edges[0], self.bar[0], self.edges[1], self.bar[1]), fill=tint(INK, 0.1))
        title = self._fit(self.episode.title, self.edges[1] - self.edges[0] - _FINER * 105)
        draw.text((self.edges[0], self.top / 2), title, fill=INK, font=_font(_FINER * 14), anchor="lm")
        return image

    def _fit(self, text: str, width: float) -> str:
        font = _font(_FINER * 14)
        if font.getlength(text) <= width:
            return text
        while text and font.getlength(f"{text}…") > width:
            text = text[:-1].rstrip(" ,")
        return f"{text}…"

    def _sprite(self, robot: int, kind: str) -> Image.Image:
        """A mark on a transparent image: a hollow square ("goal"), a disc ("moving"), a checked square ("settled")."""
        cell = 4 * self.cell  # reduced to a quarter below, for smooth edges
        side = 4 * round(1.2 * self.cell)
        image = Image.new("RGBA", (side, side))
        draw = ImageDraw.Draw(image)
        centre, colour, number = np.array([side / 2, side / 2]), robot_colour(robot), str(robot)
        if kind == "moving":
            draw.ellipse(_box(centre, 0.44 * cell), fill="white")
            draw.ellipse(_box(centre, 0.39 * cell), fill=colour)
        elif kind == "settled":
            draw.rounded_rectangle(_box(centre, 0.43 * cell), 0.16 * cell, fill=colour)
        else:
            look = {
                "fill": tint(colour, 0.12),
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
        """The last steps of each robot, thinner and paler with their age."""
        instants = [*range(max(0, int(time) - _TRAIL), int(np.ceil(time))), time]
        corners = self._pixels([self._positions(instant) for instant in instants])
        fresh = [1 - (time - instant) / (_TRAIL + 1) for instant in instants]
        for piece in range(len(instants) - 1):
            start, end = corners[piece : piece + 2]
            wide, wider = 0.2 * self.cell * fresh[piece], 0.2 * self.cell * fresh[piece + 1]
            for robot in np.flatnonzero((start != end).any(axis=1)).tolist():
                a, b, fill = start[robot], end[robot], tint(robot_colour(robot), 0.5 * fresh[piece + 1])
                side = (b - a)[::-1] * (-1, 1) / np.abs(b - a).max()
                draw.polygon([*a + wide * side, *b + wider * side, *b - wider * side, *a - wide * side], fill=fill)
                draw.ellipse(_box(b, wider), fill=fill)

    def _draw_links(
        self, draw: ImageDraw.ImageDraw, place: FloatArray, before: int, after: int, fraction: float
    ) -> None:
        """The links of both instants; a link that appears or breaks is faded."""
        if self.attention is not None:
            self._draw_attention(draw, place, before, after, fraction)
            return
        width = max(2, round(0.04 * self.cell))
        for pair in self.links[before] | self.links[after]:
            strength = (pair in self.links[before]) * (1 - fraction) + (pair in self.links[after]) * fraction
            draw.line([tuple(place[robot]) for robot in pair], fill=translucent(INK, 0.3 * strength), width=width)

    def _draw_attention(
        self, draw: ImageDraw.ImageDraw, place: FloatArray, before: int, after: int, fraction: float
    ) -> None:
        """The half of each link at its receiver, as wide as the attention, interpolated between both instants."""
        assert self.attention is not None
        now, then = self.attention[before], self.attention[after]
        for receiver, sender in now.keys() | then.keys():
            ends = place[receiver], (place[receiver] + place[sender]) / 2
            share = (1 - fraction) * now.get((receiver, sender), 0.0) + fraction * then.get((receiver, sender), 0.0)
            width = max(1, round((0.03 + 0.35 * share) * self.cell))
            draw.line(
                [tuple(end) for end in ends], fill=translucent(ATTENTION, 0.75 * min(1.0, 5 * share)), width=width
            )

    def _draw_rings(self, draw: ImageDraw.ImageDraw, place: FloatArray, time: float) -> None:
        for step in range(max(0, int(time) - _RING + 1), min(int(time) + 1, self.episode.steps)):
            age = (time - step) / _RING
            for robot in np.flatnonzero(self.episode.blocked[step]):
                box = _box(place[robot], (0.44 + 0.16 * age) * self.cell)
                draw.ellipse(box, outline=translucent(ALARM, 1 - age), width=max(_FINER, round(0.09 * self.cell)))


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
    """An image whose palette has tints of each ink, and white. The last entry stays free."""
    levels = {INK: 24} | dict.fromkeys((ALARM, *ROBOT_INKS), 17)
    tints = [tint(ink, level / count) for ink, count in levels.items() for level in range(1, count + 1)]
    colours = [rgb(tint) for tint in tints]
    white = [(255, 255, 255)] * (256 - len(colours))
    palette = Image.new("P", (1, 1))
    palette.putpalette([value for colour in (*colours, *white) for value in colour])
    return palette
