# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recorder node: writes all messages of a team to a bag, undecoded.

It is a tool: the team does not depend on it, and robots do not read its output.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

from magat_node.imports import quiet_imports

with quiet_imports():
    import rclpy
    from rclpy.node import Node
    from std_msgs.msg import Empty

    from magat_interfaces.msg import Observation, RobotStatus
    from magat_node.intake import Intake, take_serialized
    from magat_node.parameters import declare_choice, declare_value
    from magat_node.run import fail, give_way, run_node
    from magat_node.topics import RECORDER_READY, ROBOT_STATUS, team_topics
    from magat_recording.bag import BagError, BagWriter
    from magat_recording.definitions import described
    from magat_recording.recovery import continuation

#: Seconds between two reads of the subscriptions, and between two flushes of the file.
PERIOD, FLUSH = 0.02, 0.25
#: How long the recorder waits for late messages at the end, seconds.
TRAILING = 1.0


class RecorderNode(Node):
    """Records a team from its start, or from any later moment, until the node is destroyed."""

    def __init__(self, **options: object) -> None:
        """Start to record.

        Raises:
            ValueError: the parameters ``bag`` or ``robots`` are missing.
            BagError: the bag exists already, or cannot be created.
        """
        super().__init__("recorder", **options)
        folder = declare_value(
            self, "bag", "", "folder to record to; it must not exist yet, unless its recorder was killed"
        )
        robots = declare_value(self, "robots", [""], "names of the robots, which are their namespaces")
        radio = declare_choice(
            self, "radio", "direct", ["direct", "relayed"], "radio of the team, as the simulator's parameter"
        )
        if not folder or list(robots) == [""]:
            raise ValueError("the parameters bag and robots are needed: -p bag:=FOLDER -p robots:=[alice, bob]")
        self.bag = BagWriter(continuation(Path(folder)))
        self.ready = False
        self._missing_statuses = set(robots)
        # Messages are taken in batches, which needs half the CPU time of one callback for each message, and the
        # middleware gives the time at which it received each. No executor may spin this second node, because it would
        # call back.
        self._listener = rclpy.create_node(
            "recorder_listener",
            context=self.context,
            namespace=self.get_namespace(),
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._subscriptions_of = {}
        for topic in team_topics(list(robots), radio == "relayed"):
            subscription = self._listener.create_subscription(
                topic.kind, topic.name, lambda _: None, topic.profile, raw=True
            )
            self.bag.add_topic(described(topic, subscription.topic_name))
            self._subscriptions_of[subscription.topic_name] = subscription
        self._missing_observations = {
            name for name, subscription in self._subscriptions_of.items() if subscription.msg_type is Observation
        }
        self._status_topic = self._listener.resolve_topic_name(ROBOT_STATUS.name())
        self._statuses = Intake(self, RobotStatus, ROBOT_STATUS.name())
        self._send_ready = RECORDER_READY.publisher(self)
        self.create_timer(PERIOD, lambda: self._unless_it_fails(self.take))
        self.create_timer(FLUSH, lambda: self._unless_it_fails(self.bag.flush))

    def _unless_it_fails(self, write: Callable[[], object]) -> None:
        """Write, and end the process if that is not possible, e.g. because the disk is full."""
        if self.bag.failed:
            return
        try:
            write()
        except BagError as error:
            fail(error)

    def take(self) -> int:
        """Write the messages that have arrived; returns their number.

        Raises:
            BagError: they cannot be written, e.g. because the disk is full.
        """
        before = self.bag.messages
        for name, subscription in self._subscriptions_of.items():
            for data, info in take_serialized(subscription):
                self.bag.write(name, data, info["received_timestamp"], info["source_timestamp"])
                if not self.ready:
                    self._check_ready(name, data)
        return self.bag.messages - before

    def _check_ready(self, name: str, data: bytes) -> None:
        """Report ready once there was an observation for each robot and a status of each robot."""
        self._missing_observations.discard(name)
        if name == self._status_topic:
            status = self._statuses.read(data)
            self._missing_statuses -= set(status.robots if status is not None else ())
        if not self._missing_observations and not self._missing_statuses:
            self.ready = True
            self._send_ready.publish(Empty())
            self.get_logger().info("ready: every robot and the simulator are recorded")

    def destroy_node(self) -> None:
        """Write the last messages, and close the bag.

        Raises:
            BagError: it cannot be finished, e.g. because the disk is full.
        """
        try:
            if not self.bag.failed:
                deadline = time.monotonic() + TRAILING
                while self.take() and time.monotonic() < deadline:
                    time.sleep(PERIOD)
                self.bag.close()
                self.get_logger().info(f"{self.bag.messages} messages are in {self.bag.folder}")
        finally:
            self.bag.close()
            self._listener.destroy_node()
            super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Record until interrupted. Returns the exit status."""
    give_way()
    return run_node("recorder", RecorderNode, args)


if __name__ == "__main__":
    sys.exit(main())
