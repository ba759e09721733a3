# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The launch file without `ros2 launch`: by the real `launch` and `launch_ros`, or by a stand-in."""

import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest import mock

from ament_index_python.packages import get_package_prefix, get_package_share_directory

SHARE = Path(get_package_share_directory("magat_bringup"))


@dataclass
class LaunchStandIn:
    """As much of `launch` and `launch_ros` as the launch file uses, where ROS's own are not installed (no wheels)."""

    modules: dict[str, ModuleType] = field(default_factory=dict)

    def __post_init__(self) -> None:
        class Context:
            def __init__(self) -> None:
                self.launch_configurations: dict[str, str] = {}
                self.is_shutdown = False

        class Description:
            def __init__(self, entities: list) -> None:
                self.entities = entities

        class Argument:
            def __init__(
                self, name: str, *, default_value: str, description: str, choices: list[str] | None = None
            ) -> None:
                assert choices is None or default_value in choices
                self.name, self.default_value, self.choices = name, default_value, choices

            def execute(self, context: Context) -> None:
                value = context.launch_configurations.setdefault(self.name, self.default_value)
                assert self.choices is None or value in self.choices

        class Function:
            def __init__(self, *, function: Callable) -> None:
                self.execute = function

        class Shutdown:
            def __init__(self, *, reason: str) -> None:
                self.reason = reason

        class LogInfo:
            def __init__(self, *, msg: str) -> None:
                self.msg = msg

        class TimerAction:
            def __init__(self, *, period: float, actions: list) -> None:
                self.period, self.actions = period, actions

        class Configuration:
            def __init__(self, name: str) -> None:
                self.name = name

            def perform(self, context: Context) -> str:
                return context.launch_configurations[self.name]

        class Node:
            def __init__(
                self,
                *,
                package: str,
                executable: str,
                exec_name: str | None = None,
                arguments: list[str] | None = None,
                ros_arguments: list[str] | None = None,
                additional_env: dict[str, str] | None = None,
                output: str = "log",
                namespace: str | None = None,
                on_exit: Callable | None = None,
            ) -> None:
                self.namespace, self.on_exit = namespace, on_exit
                ros = ["--ros-args", *ros_arguments] if ros_arguments is not None else []
                program = executable_of(package, executable) if package != "rviz2" else "rviz2"
                self.cmd = [program, *(arguments or []), *ros, "--ros-args"]
                self.additional_env = additional_env

        def perform_substitutions(_: Context, part: str) -> str:
            return part

        contents = {
            "launch": {"Action": object, "LaunchContext": Context, "LaunchDescription": Description},
            "launch.actions": {
                "DeclareLaunchArgument": Argument,
                "LogInfo": LogInfo,
                "OpaqueFunction": Function,
                "Shutdown": Shutdown,
                "TimerAction": TimerAction,
            },
            "launch.substitutions": {"LaunchConfiguration": Configuration},
            "launch.utilities": {"perform_substitutions": perform_substitutions},
            "launch_ros": {},
            "launch_ros.actions": {"Node": Node},
        }
        for name, members in contents.items():
            self.modules[name] = ModuleType(name)
            vars(self.modules[name]).update(members)


def executable_of(package: str, executable: str) -> str:
    path = Path(get_package_prefix(package)) / "lib" / package / executable
    assert os.access(path, os.X_OK), f"ros2 run {package} {executable} does not exist: run `make setup`"
    return str(path)


@contextmanager
def some_launch() -> Iterator[None]:
    """The real `launch` where it is installed, else the stand-in."""
    missing = importlib.util.find_spec("launch_ros") is None
    with mock.patch.dict(sys.modules, LaunchStandIn().modules if missing else {}):
        yield


def launched(skip: int = 0, **arguments: str) -> list[list[str]]:
    """The command lines, without their first ``skip`` words, that the installed launch file starts."""
    from launch import LaunchContext  # noqa: I001  (to ruff, `launch` is our folder of that name)
    from launch.utilities import perform_substitutions

    context = LaunchContext()
    nodes = launched_nodes(context, **arguments)
    return [[perform_substitutions(context, part) for part in node.cmd[skip:]] for node in nodes]


def launched_nodes(context: Any, **arguments: str) -> list:
    """The actions of the installed launch file."""
    spec = importlib.util.spec_from_file_location("team_launch", SHARE / "launch" / "team.launch.py")
    file: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(file)
    context.launch_configurations.update(arguments)
    *declared, start = file.generate_launch_description().entities
    assert arguments.keys() <= {argument.name for argument in declared}
    for argument in declared:
        argument.execute(context)
    return start.execute(context)


#: Launches a file with arguments, as `ros2 launch` does, in a namespace that is pushed before.
PROGRAM = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import PushRosNamespace

file, namespace, *arguments = sys.argv[1:]
source = PythonLaunchDescriptionSource(file)
include = IncludeLaunchDescription(source, launch_arguments=[argument.split(":=", 1) for argument in arguments])
service = LaunchService()
pushed = [PushRosNamespace(namespace)] if namespace else []
service.include_launch_description(LaunchDescription([GroupAction([*pushed, include])]))
sys.exit(service.run())
"""


def really_launched(*arguments: str, pushed: str = "") -> subprocess.Popen:
    """A process that launches the file by the real launch; its output is text."""
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(SHARE / "launch" / "team.launch.py"), pushed, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
