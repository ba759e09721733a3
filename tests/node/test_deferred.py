# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Actions that are ended by later events."""

import time

import rclpy
from action_msgs.msg import GoalStatusArray
from rclpy.action import ActionClient
from rclpy.experimental import EventsExecutor
from rclpy.task import Future

from magat_bringup.environment import loopback, own_domain
from magat_interfaces.action import RunEpisode
from magat_node import deferred
from magat_node.deferred import DeferredActionServer


def test_goals_that_are_over_are_forgotten(monkeypatch):
    """Otherwise every status would list all goals since the start."""
    monkeypatch.setattr(deferred, "RESULT_TIMEOUT", 1)
    with own_domain() as domain:
        for name, value in loopback(domain).items():
            monkeypatch.setenv(name, value)
        context = rclpy.Context()
        rclpy.init(args=[], context=context, domain_id=domain)
        node, executor = rclpy.create_node("server", context=context), EventsExecutor(context=context)
        told: list[int] = []

        def until(done: Future) -> object:
            deadline = time.monotonic() + 20.0
            while not done.done():
                assert time.monotonic() < deadline
                executor.spin_once(timeout_sec=0.05)
            return done.result()

        server = DeferredActionServer(
            node, RunEpisode, "run", lambda goal: server.finish(goal, goal.succeed, RunEpisode.Result(ticks=7))
        )
        statuses = "run/_action/status"
        node.create_subscription(GoalStatusArray, statuses, lambda said: told.append(len(said.status_list)), 10)
        client = ActionClient(node, RunEpisode, "run")
        executor.add_node(node)
        try:
            begun, goals = time.monotonic(), 0
            while time.monotonic() < begun + 2.5:
                handle = until(client.send_goal_async(RunEpisode.Goal()))
                assert until(handle.get_result_async()).result.ticks == 7
                goals += 1
                executor.spin_once(timeout_sec=0.1)
        finally:
            client.destroy()
            server.destroy()
            executor.remove_node(node)
            executor.shutdown()
            node.destroy_node()
            context.try_shutdown()
    assert goals > 5
    assert 0 < told[-1] < 0.7 * goals
