# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the launch file checks before it starts a process; free of everything that launch does not need itself."""

import os
import socket

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from magat_bringup.team import TeamFileError, TeamPlan
from magat_node.errors import MagatError
from magat_node.shell import check_shell

#: Where the page's server listens.
_HOST = "127.0.0.1"


class LaunchArgumentError(MagatError, ValueError):
    """An argument of the launch file cannot be used; the message says why."""


def number(name: str, text: str, kind: type[int] | type[float]) -> float:
    """The value of the numeric argument ``name``.

    Raises:
        LaunchArgumentError: it is not a number.
    """
    try:
        return kind(text)
    except ValueError:
        wanted = "a whole number" if kind is int else "a number"
        raise LaunchArgumentError(f"{name}:={text} is not {wanted}: give one") from None


def check_launch(plan: TeamPlan, window: bool) -> None:
    """Check everything that can be checked before the first process starts.

    Args:
        plan: what is to be started.
        window: whether RViz is, too.

    Raises:
        TeamFileError: see `TeamPlan.check`.
        LaunchArgumentError: RViz is not installed, the page's port is taken, or there is no address for the discovery
            server.
        ShellError: see `magat_node.shell.check_shell`.
    """
    check_shell()
    plan.check()
    if plan.record is not None and plan.record.exists():
        raise TeamFileError(f"record:={plan.record} exists: remove it, or record to another folder")
    if window:
        try:
            get_package_prefix("rviz2")
        except PackageNotFoundError:
            raise LaunchArgumentError(
                "rviz_window:=true needs rviz2, which is not installed: install ros-jazzy-rviz2, or leave it out"
            ) from None
    if plan.view is not None and not _free(plan.view):
        raise LaunchArgumentError(f"view:={plan.view}: the port is in use: give another one")
    if plan.server and not (os.environ.get("ROS_DISCOVERY_SERVER") and os.environ.get("MAGAT_ADDRESS")):
        raise LaunchArgumentError(
            'server:=true, but the shell names no address: run eval "$(magat env --server ADDRESS)" first'
        )


def _free(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((_HOST, port))
        except OSError:
            return False
    return True
