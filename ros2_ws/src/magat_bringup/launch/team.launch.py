"""A team: its robots, simulator and expert and, if wanted, a recorder, the page, the RViz bridge and RViz.

`--show-args` lists the arguments. What each process is told comes from `magat_bringup.team`, as for `magat run`.

`ros2 launch` runs in the system's Python. So this file, and what it imports, need only what launch itself needs.
"""

# ruff: noqa: I001  (to ruff, `launch` is the folder that this file is in)

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from magat_bringup.team import ENVIRONMENT, Command, TeamFile, TeamPlan
from magat_node.restarts import RESTARTS
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
                "shield", default_value="idle", choices=list(SHIELD_NAMES), description="what keeps robots from colliding"
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
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[Node]:
    """The processes.

    Raises:
        TeamFileError: the team file or the parameter file cannot be used.
        ModelError: there is no such policy.
    """

    def given(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    plan = TeamPlan(
        TeamFile.read(Path(given("team"))),
        find_policy(given("policy")),
        radio=given("radio"),
        link_loss=float(given("link_loss")),
        shield=given("shield"),
        encoding=given("encoding"),
        backend=given("backend"),
        params=Path(given("params")) if given("params") else None,
        rviz=given("rviz") == "true",
        view=int(given("view")) if given("view") else None,
        respawn=given("respawn") == "true",
        robots=given("robots") == "true",
        server=given("server") == "true",
        record=Path(given("record")) if given("record") else None,
    )
    nodes = [node(command, plan.respawn) for command in plan.commands()]
    if given("rviz_window") == "true":
        layout = ["-d", str(CONFIG / "team.rviz")]
        nodes.append(Node(package="rviz2", executable="rviz2", arguments=layout, output="log"))
    return nodes


def node(command: Command, respawn: bool) -> Node:
    """The launch action that starts a process; without it there is no team, except for what only shows it."""
    if respawn and command.again and command.name != "robots":  # which starts its processes again by itself
        ending = {"respawn": True, "respawn_delay": 1.0, "respawn_max_retries": RESTARTS}
    else:
        ending = (
            {} if command.name in ("rviz_bridge", "viewer") else {"on_exit": Shutdown(reason=f"{command.name} ended")}
        )
    return Node(
        package=command.package,
        executable=command.executable,
        exec_name=command.name,
        arguments=list(command.arguments),
        ros_arguments=list(command.ros_arguments),
        additional_env=ENVIRONMENT,
        output="screen",
        **ending,
    )
