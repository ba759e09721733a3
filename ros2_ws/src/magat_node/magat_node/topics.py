"""What a team says: its topics, as tools that listen or repeat need them."""

# mypy: disable-error-code="import-untyped,import-not-found"

from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid
from rcl_interfaces.msg import Log
from rclpy.qos import QoSProfile
from visualization_msgs.msg import MarkerArray

from magat_interfaces.msg import Deployment, Feature, FeatureBundle, Observation, Preference, RobotStatus, World
from magat_node import qos

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # it is no part of the common interfaces, and there is no wheel of it
    TFMessage = None

#: The recorder says here, once, that from now on it misses nothing.
READY = "recorder/ready"
#: Messages that a tool keeps until it takes them, of all robots and of one: half a second of 20 robots at 150 ticks/s.
SHARED_DEPTH, OWN_DEPTH = 2000, 100


@dataclass(frozen=True)
class TeamTopic:
    """A topic, with all that it takes to listen to it, or to speak on it in place of the team."""

    #: Relative to the team's namespace, or absolute.
    name: str
    kind: type
    profile: QoSProfile


def shown_topics() -> list[TeamTopic]:
    """What people and tools watch."""
    return [
        TeamTopic("/rosout", Log, qos.latched(SHARED_DEPTH)),
        *view_topics(),
        TeamTopic("world", World, qos.reliable(SHARED_DEPTH)),
        TeamTopic("robot_status", RobotStatus, qos.reliable(SHARED_DEPTH)),
    ]


def view_topics() -> list[TeamTopic]:
    """What the view makes of it."""
    topics = [
        TeamTopic("/diagnostics", DiagnosticArray, qos.reliable(OWN_DEPTH)),
        TeamTopic("map", OccupancyGrid, qos.latched(1)),
        TeamTopic("markers", MarkerArray, qos.latched(1)),
    ]
    return topics if TFMessage is None else [*topics, TeamTopic("/tf", TFMessage, qos.reliable(OWN_DEPTH))]


def team_topics(robots: list[str], relayed: bool) -> list[TeamTopic]:
    """All topics of the team of ``robots``.

    The order is the one to subscribe in: whoever is heard on a topic knows of all subscriptions before. Robots are
    heard on robot_status, the simulator on the observations.
    """
    heard = [TeamTopic(f"{robot}/heard", FeatureBundle, qos.newest(OWN_DEPTH)) for robot in robots if relayed]
    return [
        *heard,
        TeamTopic("preference", Preference, qos.newest(SHARED_DEPTH)),
        TeamTopic("feature", Feature, qos.newest(SHARED_DEPTH)),
        *shown_topics(),
        TeamTopic("deployment", Deployment, qos.latched(1)),
        *(TeamTopic(f"{robot}/observation", Observation, qos.newest(OWN_DEPTH)) for robot in robots),
    ]
