# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages that strangers could publish on a team's topics: malformed ones, and well-formed ones that make no sense."""

from rclpy.serialization import serialize_message

from magat_interfaces.msg import RobotStatus, World

ONE_ROBOT = {"x": [0], "y": [0], "goal_x": [0], "goal_y": [0], "action": [0], "moved": [0], "silent": [False]}
ONE_ROBOT |= {"visited": [False], "missing": [0], "width": 1, "height": 1, "t_max": 3}
LONG = "x" * 100_000

MALFORMED = [b"\0\1\0\0" + b"\xff" * 40, b"\0\1\0\0", b"\xff" * 600, serialize_message(World(robots=["a"]))[:-9]]
WORLDS = [
    World(),
    *(World(episode=9, robots=[name], **ONE_ROBOT) for name in ("no name", "", "/../x", "a//b", "1", "a\nb", LONG)),
    World(episode=9, robots=["a"], **ONE_ROBOT | {"width": 65535, "height": 65535}),
    World(episode=9, robots=["a"], **ONE_ROBOT | {"x": [-1]}),
]
STATUSES = [
    RobotStatus(),
    RobotStatus(robots=["no name"]),
    RobotStatus(robots=[LONG]),
    RobotStatus(robots=["alice"], policy=LONG),
    RobotStatus(robots=["alice"], last_drop=LONG),
    RobotStatus(robots=["alice"], refusal="\n[ERROR] [1.0] [simulator]: " + LONG),
]
#: By topic.
HOSTILE = {
    "world": [*MALFORMED, *map(serialize_message, WORLDS)],
    "robot_status": [*MALFORMED, *map(serialize_message, STATUSES)],
}
