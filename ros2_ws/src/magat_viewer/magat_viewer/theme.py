# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The colours of robots on the page, as a style sheet made from the project's colour table. Free of ROS."""

from magat_pictures.colours import ROBOT_INKS, ROBOT_INKS_ON_DARK


def robot_colours() -> str:
    """A style sheet with the variables ``--robot-0`` and so on for both themes, and ``--robots``, their number."""
    return _rule(":root", ROBOT_INKS) + _rule(':root[data-theme="dark"]', ROBOT_INKS_ON_DARK)


def _rule(selector: str, inks: tuple[str, ...]) -> str:
    variables = "".join(f"  --robot-{number}: {ink};\n" for number, ink in enumerate(inks))
    return f"{selector} {{\n  --robots: {len(inks)};\n{variables}}}\n"
