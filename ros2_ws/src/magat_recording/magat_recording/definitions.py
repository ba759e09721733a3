# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Topics with their message definitions and quality of service, as a bag stores them."""

import json
import re
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from rclpy.qos import QoSProfile

from magat_node.topics import TeamTopic
from magat_recording.bag import Topic


def described(topic: TeamTopic, name: str) -> Topic:
    """``topic``, with the full name ``name``, as a bag stores it."""
    package, short = _package(topic.kind), topic.kind.__name__
    definition = "\n".join(_definitions(topic.kind))
    hashes = json.loads((_folder(package) / f"{short}.json").read_text())["type_hashes"]
    kind = f"{package}/msg/{short}"
    type_hash = next(entry["hash_string"] for entry in hashes if entry["type_name"] == kind)
    return Topic(name, kind, definition, type_hash, _offered(topic.profile))


def _definitions(kind: type) -> list[str]:
    """The definition of a message, then those of the messages in it, each under a line with its name."""
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
    """The profile as rosbag2 writes it, with infinite durations."""
    infinite = "{sec: 9223372036, nsec: 854775807}"
    return (
        f"- history: keep_last\n  depth: {profile.depth}\n  reliability: {profile.reliability.name.lower()}\n"
        f"  durability: {profile.durability.name.lower()}\n  deadline: {infinite}\n  lifespan: {infinite}\n"
        f"  liveliness: automatic\n  liveliness_lease_duration: {infinite}\n  avoid_ros_namespace_conventions: false\n"
    )
