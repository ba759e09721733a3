"""The recorder node: writes all that a team says to a bag, undecoded.

It is a tool: nobody waits for its answer, and no robot reads what it writes.
"""

import sys
import time
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_msgs.msg import Empty

from magat_interfaces.msg import Observation, RobotStatus
from magat_node import qos
from magat_node.parameters import declare_choice, declare_value
from magat_node.run import give_way, run_node
from magat_node.topics import READY, team_topics
from magat_recording.bag import BagWriter, continuation
from magat_recording.definitions import described

#: Seconds between two looks at what has come, and between two times that it is handed to the operating system.
PERIOD, FLUSH = 0.02, 0.25
#: How long messages that are still coming are waited for at the end, seconds.
TRAILING = 1.0


class RecorderNode(Node):
    """Listens to a team from before its first episode, or from any moment, to the end."""

    def __init__(self, **options: object) -> None:
        """Begin to record.

        Raises:
            ValueError: no bag or no robots are named.
            BagError: the bag is there already, or cannot be made.
        """
        super().__init__("recorder", **options)
        folder = declare_value(
            self, "bag", "", "folder to record to; it must not be there yet, unless its recorder was killed"
        )
        robots = declare_value(self, "robots", [""], "names of the robots, which are their namespaces")
        radio = declare_choice(self, "radio", "direct", ["direct", "relayed"], "as the simulator's")
        if not folder or list(robots) == [""]:
            raise ValueError("name a folder and the robots: -p bag:=FOLDER -p robots:=[alice, bob]")
        self.bag = BagWriter(continuation(Path(folder)))
        self.ready = False
        self._unheard = set(robots)
        # The messages are taken in batches: that needs half the CPU time of a callback a message, and the middleware
        # tells when each was received. An executor would call back, so none gets to know the node that listens.
        self._ears = rclpy.create_node(
            "recorder_ears",
            context=self.context,
            namespace=self.get_namespace(),
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._subscriptions_of = {}
        for topic in team_topics(list(robots), radio == "relayed"):
            subscription = self._ears.create_subscription(
                topic.kind, topic.name, lambda _: None, topic.profile, raw=True
            )
            self.bag.add_topic(described(topic, subscription.topic_name))
            self._subscriptions_of[subscription.topic_name] = (topic.kind, subscription.handle)
        self._quiet = {name for name, (kind, _) in self._subscriptions_of.items() if kind is Observation}
        self._status = self._ears.resolve_topic_name("robot_status")
        self._send_ready = self.create_publisher(Empty, READY, qos.latched(1))
        self.create_timer(PERIOD, self.take)
        self.create_timer(FLUSH, self.bag.flush)

    def take(self) -> int:
        """Write what has come; returns how many messages that were."""
        before = self.bag.messages
        for name, (kind, handle) in self._subscriptions_of.items():
            with handle:
                while (taken := handle.take_message(kind, True)) is not None:
                    data, told = taken
                    self.bag.write(name, data, told["received_timestamp"], told["source_timestamp"])
                    if not self.ready:
                        self._notice(name, data)
        return self.bag.messages - before

    def _notice(self, name: str, data: bytes) -> None:
        """Ready is the recorder when it has heard the simulator speak to each robot, and each robot of itself."""
        self._quiet.discard(name)
        if name == self._status:
            self._unheard -= set(deserialize_message(data, RobotStatus).robots)
        if not self._quiet and not self._unheard:
            self.ready = True
            self._send_ready.publish(Empty())
            self.get_logger().info("hears all robots and the simulator, and misses nothing from now on")

    def destroy_node(self) -> None:
        """Write what is still coming, and close the bag."""
        deadline = time.monotonic() + TRAILING
        while self.take() and time.monotonic() < deadline:
            time.sleep(PERIOD)
        self.bag.close()
        self.get_logger().info(f"{self.bag.messages} messages are in {self.bag.folder}")
        self._ears.destroy_node()
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Record until told to end. Returns the exit status."""
    give_way()
    return run_node("recorder", RecorderNode, args)


if __name__ == "__main__":
    sys.exit(main())
