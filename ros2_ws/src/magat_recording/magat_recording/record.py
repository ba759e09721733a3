# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat record``: records a running team until it is interrupted."""

from pathlib import Path

from rclpy.node import Node
from rclpy.parameter import Parameter
from rich.console import Console

from magat_node.run import give_way, run_node
from magat_node.teams import find_team
from magat_recording.recorder import RecorderNode


def record(folder: Path, namespace: str | None, console: Console) -> int:
    """Record the team of this environment's ROS domain to ``folder`` until Ctrl-C; returns the exit status.

    Args:
        folder: of the bag; it must not exist yet.
        namespace: of the team; None if there is only one team.
        console: shows the progress.

    Raises:
        TeamError: there is no team, or there are several and ``namespace`` is None.
    """
    give_way()
    with console.status("looking for a team"):
        team = find_team(namespace)
    with console.status("") as status:

        def create() -> Node:
            parameters = {"bag": str(folder), "robots": team.robots, "radio": team.radio}
            overrides = [Parameter(name, value=value) for name, value in parameters.items()]
            node = RecorderNode(namespace=team.namespace, parameter_overrides=overrides)

            def show() -> None:
                size = f"{node.bag.messages} messages, {node.bag.size / 2**20:.1f} MiB"
                status.update(f"recording {len(team.robots)} robots to {folder}: {size}; Ctrl-C ends it")

            node.create_timer(0.5, show)
            return node

        return run_node("recorder", create, [])
