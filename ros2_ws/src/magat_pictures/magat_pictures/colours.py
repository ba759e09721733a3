"""The inks that all pictures are drawn with.

Every colour is a tint of one of a few inks on white paper; that is also how the animation can do with one palette.
"""

from functools import lru_cache

from PIL import ImageColor

INK = "#2b3440"
ALARM = "#e03131"
ROBOT_INKS = (
    "#2f6fde", "#ee7b10", "#1f9d57", "#cf2f74", "#7d4fd8", "#0d98ae",
    "#96602f", "#818f0e", "#e265b4", "#22408c", "#12664a", "#b5452b",
)  # fmt: skip
#: Of attention.
LISTENING = ROBOT_INKS[0]


@lru_cache(4096)
def tint(ink: str, strength: float) -> str:
    """``ink`` thinned on white paper, from 0 (white) to 1 (the ink itself)."""
    red, green, blue = (round(255 + (value - 255) * strength) for value in ImageColor.getrgb(ink)[:3])
    return f"#{red:02x}{green:02x}{blue:02x}"


def glaze(ink: str, strength: float) -> str:
    """``ink`` that lets through what it is painted on, from 0 (nothing but that) to 1 (the ink itself)."""
    return f"{ink}{round(255 * strength):02x}"


def robot_colour(robot: int) -> str:
    """The ink of a robot, by its number from 0."""
    return ROBOT_INKS[robot % len(ROBOT_INKS)]
