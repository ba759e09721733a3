"""What a team says: its topics, as tools that listen or repeat need them, and the definitions of their messages."""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid
from rcl_interfaces.msg import Log
from rclpy.qos import QoSProfile
from visualization_msgs.msg import MarkerArray

from magat_bringup.bag import Topic
from magat_interfaces.msg import Deployment, Feature, FeatureBundle, Observation, Preference, RobotStatus, World
from magat_node import qos
from magat_sim.view import TFMessage

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


def described(topic: TeamTopic, name: str) -> Topic:
    """``topic``, whose full name is ``name``, as a bag describes it."""
    package, short = _package(topic.kind), topic.kind.__name__
    definition = "\n".join(_definitions(topic.kind))
    hashes = json.loads((_folder(package) / f"{short}.json").read_text())["type_hashes"]
    kind = f"{package}/msg/{short}"
    type_hash = next(entry["hash_string"] for entry in hashes if entry["type_name"] == kind)
    return Topic(name, kind, definition, type_hash, _offered(topic.profile))


def _definitions(kind: type) -> list[str]:
    """The message's own definition, then those of all that it holds, each under a line that names it."""
    found: dict[str, type] = {}
    waiting = [kind]
    while waiting:
        holder: Any = waiting.pop()
        for field in holder.get_fields_and_field_types().values():
            nested = re.search(r"(\w+)/(\w+)", field)
            if nested and nested.group() not in found:
                package, name = nested.groups()
                found[nested.group()] = getattr(__import__(f"{package}.msg", fromlist=[name]), name)
                waiting.append(found[nested.group()])
    rule = "=" * 80
    texts = [_text(kind)]
    return texts + [f"{rule}\nMSG: {name}\n{_text(nested)}" for name, nested in found.items()]


def _text(kind: type) -> str:
    return (_folder(_package(kind)) / f"{kind.__name__}.msg").read_text()


def _package(kind: type) -> str:
    return kind.__module__.partition(".")[0]


def _folder(package: str) -> Path:
    return Path(get_package_share_directory(package)) / "msg"


def _offered(profile: QoSProfile) -> str:
    """The profile as rosbag2 writes it; times are without end."""
    endless = "{sec: 9223372036, nsec: 854775807}"
    return (
        f"- history: keep_last\n  depth: {profile.depth}\n  reliability: {profile.reliability.name.lower()}\n"
        f"  durability: {profile.durability.name.lower()}\n  deadline: {endless}\n  lifespan: {endless}\n"
        f"  liveliness: automatic\n  liveliness_lease_duration: {endless}\n  avoid_ros_namespace_conventions: false\n"
    )
