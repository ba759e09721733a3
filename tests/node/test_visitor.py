# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nodes that join a team for a command leave nothing behind."""

from unittest import mock

import psutil
import pytest
from rclpy.action import ActionClient
from std_msgs.msg import Empty

from magat_bringup.environment import loopback, own_domain
from magat_interfaces.action import RunEpisode
from magat_node.teams import _teams
from magat_node.visitor import Visitor


class Listener(Visitor):
    def __init__(self, domain: int) -> None:
        super().__init__("listener", domain=domain)
        self.asked = ActionClient(self.node, RunEpisode, "run_episode")
        self.node.create_subscription(Empty, "topic", self.hear, 1)

    def hear(self, _: Empty) -> None:
        pass


def test_a_visitor_that_has_left_holds_no_threads_and_no_sockets(monkeypatch: pytest.MonkeyPatch) -> None:
    here = psutil.Process()
    with own_domain() as domain:
        for name, value in loopback(domain).items():
            monkeypatch.setenv(name, value)
        left = []
        for _ in range(3):
            with Listener(domain) as visitor:
                visitor.spin(lambda: False, 0.1)
            left.append((here.num_threads(), here.num_fds()))
    assert left[1] == left[2]


def test_a_stranger_that_calls_itself_simulator_is_no_team() -> None:
    node = mock.Mock()
    node.get_node_names_and_namespaces.return_value = [("simulator", "/"), ("simulator", "/red")]
    world, observation = "magat_interfaces/msg/World", "magat_interfaces/msg/Observation"
    published = {"/": [("/world", [world])], "/red": [("/red/world", [world]), ("/red/bob/observation", [observation])]}
    node.get_publisher_names_and_types_by_node.side_effect = lambda _, namespace: published[namespace]
    assert [(team.namespace, team.robots) for team in _teams(node)] == [("/red", ["bob"])]
