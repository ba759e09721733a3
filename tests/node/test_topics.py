# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The table of topics: what it creates, and that docs/protocol.md is the same table."""

import re
from pathlib import Path
from unittest import mock

import pytest
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy

from magat_interfaces.msg import Feature, Observation
from magat_node import topics
from magat_node.topics import TEAM_TOPICS, TOOL_TOPICS, Topic, team_topics

PAGE = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text()


def rows(heading: str) -> list[list[str]]:
    """The first table under a heading of the page, without backticks."""
    section = PAGE.split(f"## {heading}\n")[1].split("\n## ")[0]
    table = re.search(r"(?:^\|.*\n)+", section, re.MULTILINE)
    assert table is not None
    return [[cell.strip().strip("`") for cell in line.strip("|").split("|")] for line in table[0].splitlines()[2:]]


def quality(profile: QoSProfile) -> str:
    reliable = profile.reliability == QoSReliabilityPolicy.RELIABLE
    latched = profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
    return ("reliable" if reliable else "best effort") + (", latched" if latched else "")


def depth(topic: Topic) -> str:
    return f"{topic.depth_per_robot} N + {topic.depth}" if topic.depth_per_robot else str(topic.depth)


@pytest.mark.parametrize(("heading", "table"), [("Topics", TEAM_TOPICS), ("Topics of tools", TOOL_TOPICS)])
def test_the_page_has_the_topics_of_the_table(heading, table):
    expected = [
        [
            topic.pattern,
            topic.type_name,
            route.publisher,
            route.subscriber,
            *([route.radio] if table is TEAM_TOPICS else []),
            quality(topic.qos()),
            depth(topic),
        ]
        for topic in table
        for route in topic.routes
    ]
    assert rows(heading) == expected


def test_names_have_the_robot_and_the_team_in_them():
    assert topics.OBSERVATION.name(robot="alice") == "alice/observation"
    assert topics.OBSERVATION.name(robot="alice", team="/warehouse") == "/warehouse/alice/observation"
    assert topics.WORLD.name(team="/warehouse") == "/warehouse/world"
    assert topics.WORLD.name(team="") == "/world", "of a team at the root"
    assert topics.WORLD.name() == "world"
    assert topics.TF.name(team="/warehouse") == "/tf"


def test_the_depth_grows_with_the_team():
    assert topics.FEATURE.qos(robots=10).depth == 104
    assert topics.OBSERVATION.qos(robots=10).depth == 4
    assert topics.FEATURE.qos(robots=10, depth=7).depth == 7


def test_publishers_and_subscriptions_are_those_of_the_table():
    node, callback = mock.Mock(), mock.Mock()
    topics.OBSERVATION.publisher(node, robot="bob", team="/w", robots=3)
    node.create_publisher.assert_called_once_with(Observation, "/w/bob/observation", topics.OBSERVATION.qos())
    topics.FEATURE.subscription(node, callback, robots=3, raw=True)
    node.create_subscription.assert_called_once_with(Feature, "feature", mock.ANY, topics.FEATURE.qos(3), raw=True)
    node.create_subscription.call_args.args[2](b"data")
    callback.assert_called_once_with(b"data")


@pytest.mark.parametrize("relayed", [False, True])
def test_a_recorder_hears_robots_and_simulator_last(relayed):
    names = [topic.name for topic in team_topics(["a", "b"], relayed)]
    assert names[-2:] == ["a/observation", "b/observation"]
    assert ("a/heard" in names) == relayed
    expected = {topic.name(robot) for topic in TEAM_TOPICS for robot in ("a", "b")}
    assert expected - set(names) == (set() if relayed else {"a/heard", "b/heard"})


def test_a_topic_without_its_package_is_left_out():
    assert not Topic("x", "no_such_package/msg/None", topics.newest, 1, ()).available
    assert topics.WORLD.available
