# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A running team follows docs/protocol.md, with both radios."""

import re
from pathlib import Path

import pytest
from rclpy.action import get_action_names_and_types
from rclpy.qos import QoSDurabilityPolicy, QoSReliabilityPolicy

from magat_interfaces.msg import Feature, Observation
from magat_node import cdr, qos
from magat_robot.policy.config import ENCODINGS
from magat_robot.policy.payload import encoded_bytes

pytestmark = pytest.mark.system

PAGE = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text()
RELIABILITY = {"best effort": QoSReliabilityPolicy.BEST_EFFORT, "reliable": QoSReliabilityPolicy.RELIABLE}
DURABILITY = {"": QoSDurabilityPolicy.VOLATILE, "latched": QoSDurabilityPolicy.TRANSIENT_LOCAL}


def rows(heading: str, head: str = "") -> list[list[str]]:
    """The rows of the table under ``heading`` whose first column is ``head``, without backticks."""
    section = PAGE.split(f"## {heading}\n")[1].split("\n## ")[0]
    tables = [table.splitlines() for table in re.findall(r"(?:^\|.*\n)+", section, re.MULTILINE)]
    table = next(lines for lines in tables if lines[0].startswith(f"| {head}"))
    return [[cell.strip().strip("`") for cell in line.strip("|").split("|")] for line in table[2:]]


def full_name(name: str) -> str:
    return "/" + name.replace("ROBOT", "robot_3")


RADIOS = [(radio, row) for row in rows("Topics") for radio in ("direct", "relayed") if row[4] in (radio, "both")]


@pytest.fixture(scope="module")
def team_of(request):
    """The team that has a radio."""
    return lambda radio: request.getfixturevalue("team" if radio == "direct" else "relayed_team")


@pytest.mark.parametrize(("radio", "row"), RADIOS, ids=[f"{radio}-{row[0]}" for radio, row in RADIOS])
def test_topics_have_the_types_and_reliability_of_the_page(team_of, radio, row):
    name, kind, sender, receiver, _, reliability, _ = row
    team, topic = team_of(radio), full_name(name)
    node = team.client.node
    speak = ["simulator"] if sender == "simulator" else ["robot"] * team.robots
    listen = set(re.findall("simulator|robot", receiver))

    def found():
        publishers, subscriptions = (
            node.get_publishers_info_by_topic(topic),
            node.get_subscriptions_info_by_topic(topic),
        )
        return [end.node_name for end in publishers], {end.node_name for end in subscriptions} - {"episode_client"}

    team.client.spin(lambda: found() == (speak, listen), 20.0)
    assert found() == (speak, listen)
    for end in node.get_publishers_info_by_topic(topic):
        assert end.topic_type == kind
        reliable, _, latched = reliability.partition(", ")
        assert end.qos_profile.reliability == RELIABILITY[reliable]
        assert end.qos_profile.durability == DURABILITY[latched]


def test_services_and_actions_are_those_of_the_page(team):
    node = team.client.node
    actions = {full_name(name): kind for name, kind, *_ in rows("Services and actions")}

    def found():
        return dict(node.get_service_names_and_types()) | dict(get_action_names_and_types(node))

    assert team.client.spin(lambda: actions.keys() <= found().keys(), 20.0)
    assert {name: found()[name][0] for name in actions} == actions


@pytest.mark.parametrize("radio", ["direct", "relayed"])
def test_no_other_topic_carries_the_teams_messages(team_of, radio):
    known = {full_name(row[0]).replace("robot_3", "ROBOT") for other, row in RADIOS if other == radio}
    topics = dict(team_of(radio).client.node.get_topic_names_and_types())
    ours = {name for name, kinds in topics.items() if any(kind.startswith("magat_interfaces/msg") for kind in kinds)}
    assert {re.sub(r"robot_\d", "ROBOT", name) for name in ours} == known


def test_encodings_are_those_of_the_page_the_messages_and_the_robots():
    """That a running robot's Feature has these sizes is measured in test_equivalence.py."""
    for name, number, _, size, _ in rows("A tick", "encoding"):
        assert ENCODINGS[name] == int(number) == getattr(Feature, name.upper())
        packed = cdr.pack_feature(0, 0, 0, 0, int(number), bytes(encoded_bytes(128, name)))
        assert f"{len(packed)} bytes" == size
    assert len(rows("A tick", "encoding")) == len(ENCODINGS)


@pytest.mark.parametrize("radio", ["direct", "relayed"])
def test_a_waiting_process_sends_hellos_and_its_status(team_of, radio):
    team, hellos = team_of(radio), {}

    def note(data):
        feature = cdr.unpack_feature(data)
        if feature.tick == Observation.HELLO:
            hellos[feature.tag] = feature

    node = team.client.node
    subscription = node.create_subscription(Feature, "/feature", note, qos.newest(4096), raw=True)
    if radio == "direct":
        assert team.client.spin(lambda: len(hellos) == 10, 20.0)
    else:
        team.client.spin(lambda: bool(hellos), 2.0)
        assert hellos == {}
    node.destroy_subscription(subscription)
    for hello in hellos.values():
        assert (hello.episode, hello.round, hello.encoding) == (0, 0, Feature.FLOAT32)
        assert int.from_bytes(hello.payload, "little") == 1
        assert len(hello.payload) == 4
    statuses = team.statuses()
    assert sorted(statuses) == [f"robot_{i}" for i in range(10)]
    for name, status in statuses.items():
        assert status.robots == [name]
        assert (status.policy, status.encoding, status.radio) == ("MAGAT-F-128", "float32", radio)
        assert len(status.digest) == 64
    heard = 9 if radio == "direct" else 0
    assert team.client.spin(lambda: {s.peers_heard for s in team.statuses().values()} == {heard}, 20.0)
