# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The colour table of the project: pictures, animations, charts, the browser page and RViz.

Pictures use tints of a few inks on white paper, so that one palette of 256 colours is enough for an animation. The
page's own surfaces and texts are in `magat_viewer/page/style.css`, because only the page has two themes.
"""

from functools import lru_cache

INK = "#2b3440"
ALARM = "#e03131"
#: Of lines between robots where no other colour is needed, on light and dark backgrounds.
NEUTRAL = "#808080"
#: Robots on light backgrounds: robot i has the ink i modulo the number of inks. All differ in lightness, too, and have
#: a contrast of at least 3:1 to white.
ROBOT_INKS = (
    "#2f6fde", "#d96704", "#178a4a", "#cf2f74", "#7d4fd8", "#0b7f92",
    "#8a5a2c", "#6f7b0c", "#c94a9b", "#22408c", "#12664a", "#a8412a",
)  # fmt: skip
#: The same hues for dark backgrounds.
ROBOT_INKS_ON_DARK = (
    "#6fa3ff", "#ffa04d", "#4fd08a", "#ff7fb0", "#b79bff", "#4fd0e0",
    "#d3a373", "#c8d34f", "#f2a0d4", "#8ba6e8", "#66c2a0", "#f08c74",
)  # fmt: skip
#: Robots without numbers, in RViz and Foxglove. Only the colour tells which goal belongs to which robot there, so these
#: few colours differ to people with red-green colour blindness, too (Okabe and Ito, 2008).
OKABE_ITO = ("#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7")
#: Of attention.
ATTENTION = ROBOT_INKS[0]


def rgb(ink: str) -> tuple[int, int, int]:
    """Red, green and blue of an ink ``#rrggbb``, 0 to 255."""
    return int(ink[1:3], 16), int(ink[3:5], 16), int(ink[5:7], 16)


@lru_cache(4096)
def tint(ink: str, strength: float) -> str:
    """``ink`` mixed with white, from 0 (white) to 1 (the ink itself)."""
    red, green, blue = (round(255 + (value - 255) * strength) for value in rgb(ink))
    return f"#{red:02x}{green:02x}{blue:02x}"


def translucent(ink: str, opacity: float) -> str:
    """``ink`` with an opacity from 0 to 1, as ``#rrggbbaa``."""
    return f"{ink}{round(255 * opacity):02x}"


def robot_colour(robot: int) -> str:
    """The ink of a robot on a light background, by its number from 0."""
    return ROBOT_INKS[robot % len(ROBOT_INKS)]
