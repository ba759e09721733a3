# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A team: its robots, simulator and expert and, if wanted, a recorder, the page, the RViz bridge and RViz.

`--show-args` lists the arguments. What each process is told comes from `magat_bringup.team`, as for `magat run`.

`ros2 launch` runs in the system's Python. So this file, and what it imports, need only what launch itself needs.
"""

# ruff: noqa: I001  (to ruff, `launch` is the folder that this file is in)

import time
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import Action, LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, Shutdown, TimerAction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from magat_bringup.launch_checks import check_launch, number
from magat_bringup.team import ENVIRONMENT, Command, TeamFile, TeamPlan
from magat_node.errors import TeamError
from magat_node.names import team_namespace
from magat_node.restarts import TRIES, RestartLimit
from magat_robot.policy.config import BACKENDS, ENCODINGS
from magat_robot.policy.models import find_policy
from magat_sim.constants import SHIELD_NAMES

CONFIG = Path(get_package_share_directory("magat_bringup")) / "config"
SWITCH = ["true", "false"]


def generate_launch_description() -> LaunchDescription:
    """The arguments, and what is started once they are known."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "team",
                default_value=str(CONFIG / "team.yaml"),
                description="YAML file that names the robots, and says how many share a process (crew)",
            ),
            DeclareLaunchArgument(
                "policy", default_value="MAGAT-F-128", description="name of a policy in models/, or its folder"
            ),
            DeclareLaunchArgument(
                "radio",
                default_value="direct",
                choices=["direct", "relayed"],
                description="robots hear each other, or what the simulator hands on",
            ),
            DeclareLaunchArgument(
                "link_loss", default_value="0.0", description="share of the radio links that are lost in each tick"
            ),
            DeclareLaunchArgument(
                "shield",
                default_value="idle",
                choices=list(SHIELD_NAMES),
                description="what keeps robots from colliding",
            ),
            DeclareLaunchArgument(
                "encoding",
                default_value="",
                choices=["", *ENCODINGS],
                description="of messages; that of the policy's configuration if empty",
            ),
            DeclareLaunchArgument(
                "backend", default_value="onnx", choices=list(BACKENDS), description="what computes the policy"
            ),
            DeclareLaunchArgument("params", default_value="", description="ROS parameter file for every node"),
            DeclareLaunchArgument(
                "rviz", default_value="true", choices=SWITCH, description="map, markers, tf and diagnostics for RViz"
            ),
            DeclareLaunchArgument(
                "view", default_value="", description="TCP port of the page that shows the team; no page if empty"
            ),
            DeclareLaunchArgument(
                "respawn", default_value="true", choices=SWITCH, description="start again what a signal has killed"
            ),
            DeclareLaunchArgument(
                "robots", default_value="true", choices=SWITCH, description="the robots; others start them if false"
            ),
            DeclareLaunchArgument(
                "server",
                default_value="false",
                choices=SWITCH,
                description="a discovery server, at the address in ROS_DISCOVERY_SERVER",
            ),
            DeclareLaunchArgument(
                "record", default_value="", description="folder of the bag that a recorder writes; none if empty"
            ),
            DeclareLaunchArgument(
                "rviz_window", default_value="false", choices=SWITCH, description="RViz itself, with its layout"
            ),
            DeclareLaunchArgument(
                "namespace", default_value="", description="of the whole team, so that teams can share a ROS domain"
            ),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[Node]:
    """The processes.

    Raises:
        MagatError: an argument, the team file, the parameter file, the policy or a variable of the shell cannot be
            used. Launch prints it in a line, and ends with status 1; nothing was started.
    """

    def given(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    plan = TeamPlan(
        TeamFile.read(Path(given("team"))),
        find_policy(given("policy")),
        radio=given("radio"),
        link_loss=number("link_loss", given("link_loss"), float),
        shield=given("shield"),
        encoding=given("encoding"),
        backend=given("backend"),
        params=Path(given("params")) if given("params") else None,
        rviz=given("rviz") == "true",
        view=int(number("view", given("view"), int)) if given("view") else None,
        respawn=given("respawn") == "true",
        robots=given("robots") == "true",
        server=given("server") == "true",
        record=Path(given("record")) if given("record") else None,
    )
    window = given("rviz_window") == "true"
    check_launch(plan, window)
    # Processes are started again outside of the group that pushed a namespace, so theirs are absolute.
    namespace = given("namespace")
    pushed = "" if namespace.startswith("/") else context.launch_configurations.get("ros_namespace", "")
    team = team_namespace(f"{pushed}/{team_namespace(namespace)}".replace("//", "/"))
    nodes = [node(command, team, Endings(command, team, plan.respawn)) for command in plan.commands()]
    return [*nodes, rviz(team)] if window else nodes


def rviz(team: str) -> Node:
    """RViz with the layout of a team in the root, whose topics and frame it moves to the namespace ``team``."""
    arguments, moved = ["-d", str(CONFIG / "team.rviz")], []
    if team:
        arguments += ["-f", f"{team.strip('/')}/map"]
        moved = ["-r", f"/map:={team}/map", "-r", f"/markers:={team}/markers"]
    return Node(
        package="rviz2", executable="rviz2", arguments=arguments, ros_arguments=moved, output="log", **placed(team)
    )


class Endings:
    """What is done when a process ends: the same as by `magat run`, see `magat_bringup.processes`."""

    def __init__(self, command: Command, team: str, respawn: bool) -> None:
        """Restart the process of ``command``, in the namespace ``team``, where it makes sense, if ``respawn``."""
        self._command, self._team = command, team
        self._respawn = respawn and command.again
        self._kills, self._exits = RestartLimit(), RestartLimit(TRIES)

    def __call__(self, event: Any, context: LaunchContext) -> list[Action]:
        """Start it again, go on without it, or end the launch; ``event`` is a ProcessExited.

        Raises:
            TeamError: it is needed and cannot be started again. Launch ends all others, and with status 1.
        """
        command, status, killed = self._command, event.returncode, event.returncode < 0
        if context.is_shutdown:
            return []
        restarts = self._respawn and (killed or command.observer)
        if restarts and (self._kills if killed else self._exits).allows(time.monotonic()):
            return [TimerAction(period=1.0, actions=[node(command, self._team, self)])]
        if command.observer:
            return [LogInfo(msg=f"{command.name} is not started again: the team goes on without it")]
        how = f"was killed by signal {-status}" if killed else f"ended with status {status}"
        if status == 0:
            return [Shutdown(reason=f"{command.name} {how}")]
        raise TeamError(f"{command.name} {how}, and is not started again: the team ends")


def node(command: Command, team: str, on_exit: Endings) -> Node:
    """The launch action that starts a process of the team in the namespace ``team``."""
    return Node(
        package=command.package,
        executable=command.executable,
        exec_name=command.name,
        arguments=list(command.arguments),
        ros_arguments=list(command.ros_arguments),
        additional_env=ENVIRONMENT,
        output="screen",
        on_exit=on_exit,
        **placed(team),
    )


def placed(team: str) -> dict[str, str]:
    """The argument of a node in the namespace ``team``."""
    return {"namespace": team} if team else {}
