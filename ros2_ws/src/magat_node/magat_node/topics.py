# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every topic of a team, in one table: name, type, quality of service, publisher and subscribers.

To add a topic, add an entry and call its `Topic.publisher` and `Topic.subscription` where it is used. A test holds the
tables of docs/protocol.md to `TEAM_TOPICS` and `TOOL_TOPICS`.
"""

# mypy: disable-error-code="import-untyped"

import importlib
import importlib.util
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from magat_node.intake import Intake, PolledSubscription
from magat_node.qos import latched, newest, reliable

#: Stands for the robot's name in the name of a topic.
ROBOT = "ROBOT"
#: Queue depths of tools, for topics of all robots and of one: half a second of 20 robots at 150 ticks/s.
SHARED_DEPTH, OWN_DEPTH = 2000, 100


class Route(NamedTuple):
    """Which nodes use a topic, with one of the radios or with both."""

    publisher: str
    subscriber: str
    radio: str = "both"


@dataclass(frozen=True)
class Topic:
    """One entry of the table."""

    #: Relative to the team's namespace, or absolute. `ROBOT` stands for the name of a robot.
    pattern: str
    #: Type of the messages, e.g. ``std_msgs/msg/Empty``.
    type_name: str
    #: Quality of service for a queue depth.
    quality: Callable[[int], QoSProfile]
    #: Queue depth, and what each robot of the team adds to it.
    depth: int
    routes: tuple[Route, ...]
    depth_per_robot: int = 0

    @property
    def available(self) -> bool:
        """Whether the package of the messages is installed."""
        return importlib.util.find_spec(self.type_name.partition("/")[0]) is not None

    @property
    def message(self) -> Any:
        """The class of the messages. It is imported here, so that no node imports messages that it does not use."""
        package, _, name = self.type_name.split("/")
        return getattr(importlib.import_module(f"{package}.msg"), name)

    def name(self, robot: str = "", team: str | None = None) -> str:
        """The topic's name.

        Args:
            robot: the robot's name, for a topic of one robot.
            team: the team's namespace without a slash at its end, so that the root is empty. If None, the name is
                relative to the namespace of the node that uses it.
        """
        name = self.pattern.replace(ROBOT, robot)
        return name if team is None or name.startswith("/") else f"{team}/{name}"

    def qos(self, robots: int = 0, depth: int | None = None) -> QoSProfile:
        """Quality of service in a team of ``robots``; ``depth`` replaces the queue depth of the table."""
        return self.quality(self.depth + self.depth_per_robot * robots if depth is None else depth)

    def publisher(self, node: Node, robot: str = "", team: str | None = None, robots: int = 0) -> Publisher:
        """Create a publisher; see `name` and `qos`."""
        return node.create_publisher(self.message, self.name(robot, team), self.qos(robots))

    def subscription(
        self,
        node: Node,
        callback: Callable[[Any], object],
        robot: str = "",
        team: str | None = None,
        robots: int = 0,
        depth: int | None = None,
        raw: bool = False,
        on_drop: Callable[[str], object] | None = None,
    ) -> Subscription:
        """Create a subscription whose messages come through an `Intake`; see `name` and `qos`.

        Args:
            node: that subscribes.
            callback: gets the messages. It refuses one that it cannot use by an `UnusableMessageError`.
            robot: see `name`.
            team: see `name`.
            robots: see `qos`.
            depth: see `qos`.
            raw: the callback gets serialised messages, and refuses those that are malformed.
            on_drop: called with the reason for each message that is dropped.
        """
        name = self.name(robot, team)
        intake = Intake(node, self.message, name, on_drop)
        take = intake.hand_over if raw else intake.deliver
        return node.create_subscription(
            self.message, name, lambda data: take(data, callback), self.qos(robots, depth), raw=True
        )

    def polled(self, node: Node, robot: str = "", depth: int | None = None) -> PolledSubscription:
        """Create a subscription for a ``node`` that no executor spins; see `name` and `qos`."""
        name = self.name(robot)
        subscription = node.create_subscription(self.message, name, lambda _: None, self.qos(depth=depth), raw=True)
        return PolledSubscription(subscription, Intake(node, self.message, name))


def _magat(name: str) -> str:
    return f"magat_interfaces/msg/{name}"


OBSERVATION = Topic("ROBOT/observation", _magat("Observation"), newest, 4, (Route("simulator", "that robot"),))
FEATURE = Topic(
    "feature",
    _magat("Feature"),
    newest,
    64,
    (Route("robots", "robots", "direct"), Route("robots", "simulator", "relayed")),
    depth_per_robot=4,
)
HEARD = Topic("ROBOT/heard", _magat("FeatureBundle"), newest, 8, (Route("simulator", "that robot", "relayed"),))
PREFERENCE = Topic("preference", _magat("Preference"), newest, 64, (Route("robots", "simulator"),), depth_per_robot=4)
ROBOT_STATUS = Topic(
    "robot_status", _magat("RobotStatus"), reliable, 64, (Route("robots", "simulator, tools"),), depth_per_robot=4
)
WORLD = Topic("world", _magat("World"), reliable, 100, (Route("simulator", "tools"),))
DEPLOYMENT = Topic("deployment", _magat("Deployment"), latched, 1, (Route("simulator", "robots"),))

#: The topics of robots and simulator.
TEAM_TOPICS = (OBSERVATION, FEATURE, HEARD, PREFERENCE, ROBOT_STATUS, WORLD, DEPLOYMENT)

#: One message: the recorder misses nothing from now on.
RECORDER_READY = Topic("recorder/ready", "std_msgs/msg/Empty", latched, 1, (Route("recorder", "tools"),))
MAP = Topic("map", "nav_msgs/msg/OccupancyGrid", latched, 1, (Route("RViz bridge", "tools"),))
MARKERS = Topic("markers", "visualization_msgs/msg/MarkerArray", latched, 1, (Route("RViz bridge", "tools"),))
TF = Topic("/tf", "tf2_msgs/msg/TFMessage", reliable, 100, (Route("RViz bridge", "tools"),))
DIAGNOSTICS = Topic(
    "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", reliable, 10, (Route("RViz bridge", "tools"),)
)

#: The topics of tools.
TOOL_TOPICS = (RECORDER_READY, MAP, MARKERS, TF, DIAGNOSTICS)
#: ROS's own topic of log lines.
_LOG = Topic("/rosout", "rcl_interfaces/msg/Log", latched, 1000, (Route("all nodes", "tools"),))


@dataclass(frozen=True)
class TeamTopic:
    """A topic of one team, with everything that a tool needs to subscribe to it or to publish on it."""

    #: Relative to the team's namespace, or absolute.
    name: str
    kind: type
    profile: QoSProfile


def rviz_topics() -> list[TeamTopic]:
    """What the RViz bridge publishes."""
    return list(_of_tools((DIAGNOSTICS, OWN_DEPTH), (MAP, 1), (MARKERS, 1), (TF, OWN_DEPTH)))


def shown_topics() -> list[TeamTopic]:
    """What people and tools watch."""
    return [
        *_of_tools((_LOG, SHARED_DEPTH)),
        *rviz_topics(),
        *_of_tools((WORLD, SHARED_DEPTH), (ROBOT_STATUS, SHARED_DEPTH)),
    ]


def team_topics(robots: list[str], relayed: bool) -> list[TeamTopic]:
    """All topics of the team of ``robots`` that a recorder stores.

    Subscribe in this order: a tool that hears a node on one topic then knows that it has all subscriptions before. It
    hears robots on robot_status, and the simulator on the observations.
    """
    return [
        *_of_tools((HEARD, OWN_DEPTH), robots=robots if relayed else []),
        *_of_tools((PREFERENCE, SHARED_DEPTH), (FEATURE, SHARED_DEPTH)),
        *shown_topics(),
        *_of_tools((DEPLOYMENT, 1)),
        *_of_tools((OBSERVATION, OWN_DEPTH), robots=robots),
    ]


def _of_tools(*topics: tuple[Topic, int], robots: list[str] | None = None) -> Iterator[TeamTopic]:
    """Topics as a tool uses them, each with a queue depth; those of one robot for each of ``robots``."""
    for topic, depth in topics:
        if topic.available:
            for robot in robots if robots is not None else [""]:
                yield TeamTopic(topic.name(robot), topic.message, topic.qos(depth=depth))
