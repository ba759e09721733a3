# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Teams from files: what is refused, and that `magat run` and the launch file start the same processes alike."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
import rclpy
import yaml
from launched import SHARE, executable_of, launched, some_launch
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from magat_bringup.environment import loopback, own_domain
from magat_bringup.processes import TeamProcesses
from magat_bringup.team import ENVIRONMENT, Command, TeamFile, TeamFileError, TeamPlan
from magat_cli.main import main
from magat_robot.policy.models import find_policy

POLICY = "MAGAT-F-128"


@pytest.fixture(scope="module", autouse=True)
def launch() -> Iterator[None]:
    with some_launch():
        yield


@pytest.fixture
def team_file(tmp_path) -> Callable:
    def write(text: str) -> Path:
        path = tmp_path / "team.yaml"
        path.write_text(text)
        return path

    return write


# --- The file ---


def test_a_team_is_read_from_a_file(team_file):
    assert TeamFile.read(team_file("robots: [alice, bob]\ncrew: 2")) == TeamFile(("alice", "bob"), 2)
    assert TeamFile.read(team_file("robots: [alice]")).crew == 1


def test_the_team_that_is_installed_is_the_one_of_ten():
    assert TeamFile.read(SHARE / "config" / "team.yaml") == TeamFile.numbered(10)


def test_numbered_robots_sort_by_name():
    names = TeamFile.numbered(12).robots
    assert list(names) == sorted(names)
    assert TeamFile.numbered(10).robots[9] == "robot_9"
    assert [TeamFile.numbered(count, 5).processes for count in (5, 6, 10)] == [1, 2, 2]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("robots: [alice", "cannot be read"),
        ("- alice", "no list of names under the key robots"),
        ("robots: alice", "no list of names under the key robots"),
        ("robots: []", "no robots"),
        ("robots: [alice, 7]", "the robot 7 is not text but int: put it in quotes"),
        ("robots: [yes]", "the robot True is not text"),
        ("robots: ['yes']", "the robot name 'yes' is invalid"),
        ("robots: [3po]", "the robot name '3po' is invalid"),
        ("robots: [a-b]", "the robot name 'a-b' is invalid"),
        ("robots: [/alice]", "the robot name '/alice' is invalid"),
        ("robots: [red/r0, red/r1]", "give a name without slashes, and put the whole team into a namespace"),
        ("robots: [a__b]", "the robot name 'a__b' is invalid"),
        ("robots: [alice, bob, alice]", "alice: named more than once"),
        ("robots: [alice]\ncrew: 0", "the crew is 0"),
        ("robots: [alice]\ncrew: many", "the crew is 'many'"),
        ("robots: [alice]\ncrew: true", "the crew is True"),
        ("robots: [alice]\nradios: relayed", "unknown keys radios"),
    ],
)
def test_a_bad_team_is_named_with_its_file(team_file, text, said):
    path = team_file(text)
    with pytest.raises(TeamFileError) as error:
        TeamFile.read(path)
    assert said in str(error.value)
    assert str(path) in str(error.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(TeamFileError, match=r"no-team\.yaml cannot be read"):
        TeamFile.read(tmp_path / "no-team.yaml")
    with pytest.raises(TeamFileError, match=r"no parameter file .*no-params\.yaml"):
        TeamPlan(TeamFile.numbered(2), tmp_path, params=tmp_path / "no-params.yaml").commands()


def test_the_module_needs_neither_ros_nor_launch():
    program = "import sys, magat_bringup.team; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert "magat_bringup" in loaded
    assert not loaded & {"rclpy", "launch", "magat_interfaces", "torch"}


# --- Launch ---


def as_launched(command: Command) -> list[str]:
    return [
        executable_of(command.package, command.executable),
        *command.arguments,
        "--ros-args",
        *command.ros_arguments,
        "--ros-args",
    ]


@pytest.fixture
def params(tmp_path) -> Path:
    """An ordinary parameter file: for nodes by name in any namespace, for one node, for all."""
    path = tmp_path / "params.yaml"
    said = {
        "/**": {"relay_deadline": 0.04},
        "/**/robot": {"feature_deadline": 0.125},
        "/bob/robot": {"feature_deadline": 0.5},
        "/**/simulator": {"tick_deadline": 0.75},
        "/**/expert": {"searches": 2},
        "/**/rviz_bridge": {"cell_size": 0.25},
    }
    path.write_text(yaml.safe_dump({node: {"ros__parameters": values} for node, values in said.items()}))
    return path


class NotStartedError(Exception):
    """Instead of processes."""


def started(plan: TeamPlan, logs: Path) -> list[tuple[list[str], dict[str, str]]]:
    """What `TeamProcesses` starts: command lines and environments."""
    with mock.patch("magat_bringup.processes.subprocess.Popen") as popen:
        TeamProcesses(plan, logs, {})
    return [(call.args[0], call.kwargs["env"]) for call in popen.call_args_list]


@pytest.mark.parametrize("crew", [1, 2])
def test_magat_run_and_the_launch_file_start_the_same(team_file, params, tmp_path, crew):
    path = team_file(f"robots: [alice, bob, carol]\ncrew: {crew}")
    chosen = {"radio": "relayed", "link_loss": "0.25", "shield": "pibt", "encoding": "float16", "backend": "onnx"}
    chosen["record"] = str(tmp_path / "bag")
    by_launch = launched(team=str(path), policy=POLICY, params=str(params), rviz="true", view="8300", **chosen)

    # What `magat run` plans, and what comes of it.
    options = [part for name, value in chosen.items() for part in (f"--{name.replace('_', '-')}", value)]
    with (
        mock.patch.dict(os.environ),
        mock.patch("magat_cli.verb.export.exported_policy", return_value=find_policy(POLICY)),
        mock.patch("magat_viewer.address.free_port", return_value=8300),
        mock.patch("magat_bringup.run.TeamProcesses", side_effect=NotStartedError) as processes,
        pytest.raises(NotStartedError),
    ):
        main(["run", "--team", str(path), "--policy", POLICY, "--params", str(params), "--rviz", "--view", *options])
    plan = processes.call_args.args[0]
    by_run = started(plan, tmp_path)

    team = plan.commands()
    assert [command.name for command in team] == ["recorder", "robots", "simulator", "expert", "rviz_bridge", "viewer"]
    assert by_launch == [as_launched(command) for command in team]
    assert [line for line, _ in by_run] == [[sys.executable, "-m", *command.python] for command in team]
    assert all(env.items() >= ENVIRONMENT.items() for _, env in by_run)
    assert all(str(params) in line for line, _ in by_run)
    assert f"bag:={tmp_path / 'bag'}" in by_run[0][0]
    robots = by_run[1][0]
    crews = ["--crew", str(crew), "--respawn", "alice", "bob", "carol"]
    assert robots[robots.index("--crew") :][: len(crews)] == crews
    assert robots[robots.index("--policy") + 1] == str(find_policy(POLICY))
    assert robots[robots.index("--shield") + 1] == plan.shield, "policies have a temperature for each shield"


@pytest.mark.parametrize(("robots", "server"), [(3, False), (60, True)])
def test_magat_run_starts_a_discovery_server_for_a_large_team(tmp_path, robots, server):
    with (
        mock.patch.dict(os.environ),
        mock.patch("magat_bringup.run.TeamProcesses", side_effect=NotStartedError) as processes,
        pytest.raises(NotStartedError),
    ):
        main(["run", "--robots", str(robots), "--no-robots", "--output", str(tmp_path)])
    plan, _, environment, _ = processes.call_args.args
    expected = TeamPlan(TeamFile.numbered(robots), find_policy(POLICY), robots=False, server=server)
    assert plan == expected
    assert [command.name for command in plan.commands()] == ["discovery"] * server + ["simulator", "expert"]
    assert bool(environment["ROS_DISCOVERY_SERVER"]) == server
    # Nobody waits for sixty processes as short a time as for three.
    assert (plan.patience > 60.0) == server


def test_both_start_the_same_where_nothing_is_said(tmp_path):
    by_run = TeamPlan(TeamFile.numbered(10), find_policy(POLICY), rviz=True).commands()
    assert launched() == [as_launched(command) for command in by_run]
    assert len(launched(rviz="false")) == 3
    alone = TeamPlan(TeamFile.numbered(10), find_policy(POLICY), rviz=True, robots=False, server=True).commands()
    address = {"ROS_DISCOVERY_SERVER": "127.0.0.1:7902", "MAGAT_ADDRESS": "127.0.0.1"}
    with mock.patch.dict(os.environ, address):
        started_alone = launched(robots="false", server="true")
    assert started_alone == [as_launched(command) for command in alone]


def test_a_module_and_an_executable_are_the_same_program(tmp_path):
    programs = {script.name: script.value for script in entry_points(group="console_scripts")}
    plan = TeamPlan(TeamFile.numbered(2), tmp_path, rviz=True, view=8300, server=True, record=tmp_path / "bag")
    for command in plan.commands():
        if command.package == "magat_expert":  # built by CMake: a script of its own
            said = Path(executable_of(command.package, command.executable)).read_text()
            assert f"from {command.module} import main" in said
        else:
            assert programs[command.executable] == f"{command.module}:main"


# --- Real processes ---


@pytest.mark.system
def test_every_node_takes_an_ordinary_parameter_file(params, tmp_path):
    wanted = {
        "/alice/robot": {"feature_deadline": 0.125},
        "/bob/robot": {"feature_deadline": 0.5},
        "/simulator": {
            "tick_deadline": 0.75,
            "relay_deadline": 0.04,
            "robots": ["alice", "bob"],
            "link_loss": 0.25,
            "shield": "pibt",
        },
        "/expert": {"searches": 2},
        "/rviz_bridge": {"cell_size": 0.25, "team_size": 2},
    }
    with own_domain() as domain, mock.patch.dict(os.environ, loopback(domain)):
        policy = find_policy(POLICY)
        plan = TeamPlan(
            TeamFile(("alice", "bob")), policy, link_loss=0.25, shield="pibt", backend="echo", params=params, rviz=True
        )
        context = Context()
        rclpy.init(context=context, domain_id=domain)
        node = rclpy.create_node("asking", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        try:
            with TeamProcesses(plan, tmp_path, loopback(domain)) as team:
                found = {}
                for name, values in wanted.items():
                    client = node.create_client(GetParameters, f"{name}/get_parameters")
                    deadline = time.monotonic() + 40.0
                    while not client.wait_for_service(0.2):
                        team.check()
                        assert time.monotonic() < deadline, f"no {name} after 40 s"
                    answer = client.call_async(GetParameters.Request(names=list(values)))
                    executor.spin_until_future_complete(answer, 20.0)
                    found[name] = dict(zip(values, map(value_of, answer.result().values), strict=True))
        finally:
            executor.remove_node(node)
            node.destroy_node()
            rclpy.shutdown(context=context)
    assert found == wanted


def value_of(message: Any) -> object:
    kinds = {2: "integer_value", 3: "double_value", 4: "string_value", 9: "string_array_value"}
    value = getattr(message, kinds[message.type])
    return list(value) if message.type == 9 else value
