# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages that cannot be used are dropped, counted and logged with the node's name, and end nothing."""

from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import pytest
import rclpy
from hostile import MALFORMED
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.serialization import serialize_message

from magat_bringup.environment import loopback, own_domain
from magat_interfaces.msg import World
from magat_node import cdr, qos, topics
from magat_node.errors import UnusableMessageError
from magat_node.intake import Intake
from magat_node.text import THROTTLE


@pytest.fixture
def intake():
    node, dropped = mock.Mock(), []
    clock = SimpleNamespace(now=0.0)
    made = Intake(node, World, "world", dropped.append, lambda: clock.now)
    return SimpleNamespace(intake=made, log=node.get_logger().warning, dropped=dropped, clock=clock)


@pytest.mark.parametrize("data", MALFORMED)
def test_a_malformed_message_is_dropped_without_noise(intake, data, capfd):
    intake.intake.deliver(data, pytest.fail)
    assert intake.intake.dropped == len(intake.dropped) == 1
    assert capfd.readouterr() == ("", "")


def test_what_only_the_middleware_refuses_is_dropped_too(intake, monkeypatch):
    error = RuntimeError("Fast CDR exception")
    monkeypatch.setattr("magat_node.intake.deserialize_message", mock.Mock(side_effect=error))
    intake.intake.deliver(serialize_message(World()), pytest.fail)
    assert intake.dropped == ["it is malformed (Fast CDR exception)"]


def test_what_the_callback_refuses_is_dropped_alike(intake):
    def refuse(message):
        raise UnusableMessageError(f"{message.robots} is " + 100_000 * "x")

    intake.intake.deliver(serialize_message(World(robots=["bob"])), refuse)
    assert intake.dropped[0].startswith("['bob'] is xxx")
    assert len(intake.dropped[0]) < 300
    with pytest.raises(ZeroDivisionError):  # a bug is not hidden
        intake.intake.deliver(serialize_message(World()), lambda _: 1 / 0)


def test_the_log_is_throttled_and_counts(intake):
    for _ in range(100):
        intake.intake.deliver(MALFORMED[0], pytest.fail)
    assert intake.log.call_count == 1
    intake.clock.now += THROTTLE
    intake.intake.deliver(MALFORMED[0], pytest.fail)
    assert "dropped 101 messages on world so far; the last one: " in intake.log.call_args.args[0]


@pytest.mark.parametrize("executor", [EventsExecutor, SingleThreadedExecutor])
def test_a_subscription_gets_only_what_can_be_read(monkeypatch, capfd, executor):
    with own_domain() as domain:
        for name, value in loopback(domain).items():
            monkeypatch.setenv(name, value)
        context = rclpy.Context()
        rclpy.init(args=[], context=context, domain_id=domain)
        node = rclpy.create_node("listener", context=context)
        spinning = executor(context=context)
        spinning.add_node(node)
        heard, raw, dropped = [], [], []
        topics.WORLD.subscription(node, heard.append, on_drop=dropped.append)
        topics.WORLD.subscription(node, raw.append, raw=True)
        publisher = node.create_publisher(World, "world", qos.reliable(100))
        try:
            while publisher.get_subscription_count() < 2:
                spinning.spin_once(timeout_sec=0.01)
            for data in (*MALFORMED, serialize_message(World(tick=7))):
                publisher.publish(data)
            while not heard or len(raw) < len(MALFORMED) + 1:
                spinning.spin_once(timeout_sec=0.01)
        finally:
            spinning.remove_node(node)
            spinning.shutdown()
            node.destroy_node()
            context.try_shutdown()
    assert [world.tick for world in heard] == [7]
    assert len(dropped) == len(MALFORMED)
    said = capfd.readouterr().err
    assert said.count("[listener]: dropped") == 1
    assert "remaining buffer" not in said


def test_a_feature_of_another_byte_order_that_is_damaged_makes_no_noise(capfd):
    assert cdr.unpack_feature(b"\0\0\0\0" + b"\xff" * 40) is None
    assert cdr.unpack_bundle(b"\0\0\0\0" + b"\xff" * 40) is None
    assert capfd.readouterr() == ("", "")


def test_every_subscription_goes_through_the_intake():
    """Only the table of topics, and the recorder, which stores messages unread, call rclpy."""
    sources = Path(__file__).parents[2] / "ros2_ws" / "src"
    callers = {path.name for path in sources.rglob("*.py") if "create_subscription" in path.read_text()}
    assert callers == {"topics.py", "recorder.py"}
