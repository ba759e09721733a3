# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The colour table: robots are readable on their backgrounds, and the page uses the same table as the pictures."""

import re

import pytest

from magat_pictures.colours import OKABE_ITO, ROBOT_INKS, ROBOT_INKS_ON_DARK, rgb, robot_colour, tint, translucent
from magat_viewer.theme import robot_colours


def luminance(ink: str) -> float:
    """Relative luminance (WCAG 2.1)."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (value / 255 for value in rgb(ink))]
    return sum(weight * value for weight, value in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize(("inks", "background"), [(ROBOT_INKS, "#ffffff"), (ROBOT_INKS_ON_DARK, "#1a2028")])
def test_robots_are_readable_on_their_background(inks, background):
    assert min(contrast(ink, background) for ink in inks) >= 3
    assert len(set(inks)) == len(ROBOT_INKS)


def test_the_page_has_the_inks_of_the_pictures():
    light, dark = (re.findall(r"--robot-\d+: (#\w+);", rule) for rule in robot_colours().split("}")[:2])
    assert (tuple(light), tuple(dark)) == (ROBOT_INKS, ROBOT_INKS_ON_DARK)
    assert robot_colour(len(ROBOT_INKS) + 1) == light[1]


def test_tints_end_at_white_and_at_the_ink():
    assert (tint(ROBOT_INKS[0], 0), tint(ROBOT_INKS[0], 1)) == ("#ffffff", ROBOT_INKS[0])
    assert translucent(OKABE_ITO[0], 0.5) == "#e69f0080"
