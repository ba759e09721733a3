# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recorder alone: when it reports that it receives everything, and what it refuses."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from hostile import HOSTILE
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Empty

from magat_bringup.environment import own_domain
from magat_interfaces.msg import Observation, RobotStatus, World
from magat_node import qos
from magat_node.topics import RECORDER_READY
from magat_recording.bag import read_bag
from magat_recording.recorder import RecorderNode

pytestmark = pytest.mark.system

HELLO = Observation.HELLO


@pytest.fixture
def context() -> Iterator[rclpy.Context]:
    context = rclpy.Context()
    with own_domain() as domain:
        rclpy.init(args=[], context=context, domain_id=domain)
        yield context
        context.try_shutdown()


def recorder(context: rclpy.Context, bag: Path, *robots: str) -> RecorderNode:
    given = {"bag": str(bag), "robots": list(robots)}
    return RecorderNode(context=context, parameter_overrides=[Parameter(n, value=v) for n, v in given.items()])


@pytest.mark.parametrize("last", ["a robot", "the simulator"])
def test_it_is_ready_after_a_status_and_an_observation_of_each_robot(context, tmp_path, last):
    node = recorder(context, tmp_path / "bag", "alice", "bob", "carol")
    team: Node = rclpy.create_node("team", context=context)
    executor = SingleThreadedExecutor(context=context)
    for one in (node, team):
        executor.add_node(one)
    ready: list[Empty] = []
    RECORDER_READY.subscription(team, ready.append)
    simulator = [
        team.create_publisher(Observation, f"{name}/observation", qos.newest(4)) for name in ("alice", "bob", "carol")
    ]
    robots = team.create_publisher(RobotStatus, "robot_status", qos.reliable(64))

    def spin(until=lambda: False, seconds: float = 0.5) -> bool:
        deadline = team.get_clock().now().nanoseconds + seconds * 1e9
        while not until() and team.get_clock().now().nanoseconds < deadline:
            executor.spin_once(timeout_sec=0.05)
        return until()

    def report(*names: str) -> None:
        robots.publish(RobotStatus(robots=names))

    ends = (*simulator, robots)
    assert spin(lambda: all(end.get_subscription_count() for end in ends), 20.0)

    def observe(publishers) -> None:
        for publisher in publishers:
            publisher.publish(Observation(tick=HELLO, own_tag=1))

    report("alice", "bob")
    if last == "a robot":
        observe(simulator)
    else:
        report("carol")
        observe(simulator[:2])
    spin()
    assert not node.ready
    if last == "a robot":
        report("carol")
    else:
        observe(simulator[2:])
    assert spin(lambda: bool(ready), 20.0)
    assert node.ready
    executor.remove_node(node)
    node.destroy_node()
    team.destroy_node()
    assert sum(m.type.endswith("/RobotStatus") for m in read_bag(tmp_path / "bag")) == 2


def test_no_message_of_a_stranger_ends_it_and_all_are_recorded(context, tmp_path):
    node = recorder(context, tmp_path / "bag", "alice")
    team: Node = rclpy.create_node("team", context=context)
    executor = SingleThreadedExecutor(context=context)
    for one in (node, team):
        executor.add_node(one)
    kinds = {"world": World, "robot_status": RobotStatus}
    ends = {name: team.create_publisher(kind, name, qos.reliable(64)) for name, kind in kinds.items()}

    def spin(until) -> None:
        deadline = time.monotonic() + 20.0
        while not until():
            assert time.monotonic() < deadline
            executor.spin_once(timeout_sec=0.02)

    spin(lambda: all(end.get_subscription_count() for end in ends.values()))
    for name, end in ends.items():
        for data in HOSTILE[name]:
            end.publish(data)
    ends["robot_status"].publish(RobotStatus(robots=["alice"]))
    spin(lambda: not node._missing_statuses)
    executor.remove_node(node)
    node.destroy_node()
    team.destroy_node()
    assert node.bag.messages >= len(HOSTILE["world"]) + len(HOSTILE["robot_status"]) + 1
    kept = [message for message in read_bag(tmp_path / "bag") if message.topic == "/robot_status"]
    assert kept[-1].message.robots == ["alice"], "what cannot be decoded is left out"


@pytest.mark.parametrize("given", [{}, {"bag": "somewhere"}, {"robots": ["alice"]}], ids=str)
def test_it_names_missing_parameters(context, given, tmp_path):
    values = {name: str(tmp_path / value) if name == "bag" else value for name, value in given.items()}
    with pytest.raises(ValueError, match="the parameters bag and robots are needed"):
        RecorderNode(context=context, parameter_overrides=[Parameter(n, value=v) for n, v in values.items()])
