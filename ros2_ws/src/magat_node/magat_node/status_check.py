# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Validation of RobotStatus messages, and of the names of a team's robots. Free of ROS."""

from functools import lru_cache
from typing import Any

from magat_node.names import InvalidNameError, check_robot_name
from magat_node.text import shortened

#: Longest text in a status, characters. Robots shorten what they quote.
LONGEST_TEXT = 1000
_TEXTS = ("policy", "digest", "encoding", "radio", "refusal", "last_drop")


def status_fault(status: Any) -> str | None:
    """Why a RobotStatus message cannot be used, as the end of a sentence; None if it can."""
    if not status.robots:
        return "there are no robots"
    for name in _TEXTS:
        if len(getattr(status, name)) > LONGEST_TEXT:
            return f"the field {name} has {len(getattr(status, name))} characters"
    return names_fault(tuple(status.robots))


@lru_cache(maxsize=4)
def names_fault(names: tuple[str, ...]) -> str | None:
    """Why these cannot be the names of a team's robots, as the end of a sentence; None if they can."""
    if len(set(names)) < len(names):
        return "robots have one name"
    for name in names:
        try:
            check_robot_name(name)
        except InvalidNameError:
            return f"a robot has the name {shortened(name)!r}"
    return None
