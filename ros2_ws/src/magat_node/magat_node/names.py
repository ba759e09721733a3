# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The names of robots and the namespaces of teams, checked by ROS's rules before a process starts. Free of ROS."""

import re
from typing import Any

from magat_node.errors import MagatError

#: Letters, digits and single underscores, no digit first. ROS itself refuses a double underscore.
_NAME = re.compile(r"(?!.*__)[A-Za-z_][A-Za-z0-9_]*")
#: Words that ROS parameters parse as a Boolean or a number.
_NO_NAMES = {"y", "n", "yes", "no", "on", "off", "true", "false", "nan", "inf", "infinity"}
#: Longest name of a robot, and longest namespace of a team. Names of topics and services, which contain both, have at
#: most 247 characters.
LONGEST_NAME, LONGEST_NAMESPACE = 64, 100


class InvalidNameError(MagatError, ValueError):
    """A name cannot be one in ROS; the message says why."""


def check_robot_name(name: Any) -> None:
    """Check the name of a robot, which is its namespace in the team's.

    Raises:
        InvalidNameError: it is not text, not a ROS name, or has parts.
    """
    if not isinstance(name, str):
        raise InvalidNameError(f"the robot {name!r} is not text but {type(name).__name__}: put it in quotes")
    if "/" in name:
        raise InvalidNameError(
            f"the robot name {name!r} is invalid: give a name without slashes, and put the whole team into a namespace"
        )
    if not _NAME.fullmatch(name) or name.lower() in _NO_NAMES:
        raise InvalidNameError(
            f"the robot name {name!r} is invalid: use letters, digits and single _, no digit first, "
            f"and none of {', '.join(sorted(_NO_NAMES))}"
        )
    if len(name) > LONGEST_NAME:
        raise InvalidNameError(f"the robot name {name!r} is too long: use at most {LONGEST_NAME} characters")


def team_namespace(text: str) -> str:
    """The namespace of a team as ROS writes it, with a slash first and none last; the root is empty.

    Raises:
        InvalidNameError: ``text`` is not a namespace.
    """
    parts = text.strip("/").split("/") if text.strip("/") else []
    if not all(_NAME.fullmatch(part) for part in parts):
        raise InvalidNameError(
            f"the namespace {text!r} is invalid: use letters, digits and single _, no digit first, in parts that are "
            "separated by single slashes"
        )
    namespace = "".join(f"/{part}" for part in parts)
    if len(namespace) > LONGEST_NAMESPACE:
        raise InvalidNameError(f"the namespace {text!r} is too long: use at most {LONGEST_NAMESPACE} characters")
    return namespace
