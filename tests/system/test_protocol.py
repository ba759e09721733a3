"""The running team speaks as docs/protocol.md says."""

import re
from pathlib import Path

import pytest
from rclpy.action import get_action_names_and_types
from rclpy.qos import QoSDurabilityPolicy, QoSReliabilityPolicy

pytestmark = pytest.mark.system

PAGE = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text()
RELIABILITY = {"best effort": QoSReliabilityPolicy.BEST_EFFORT, "reliable": QoSReliabilityPolicy.RELIABLE}


def rows(heading: str) -> list[list[str]]:
    """The table under ``heading``, without its head, cells stripped of blanks and backticks."""
    section = PAGE.split(f"## {heading}\n")[1].split("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")][2:]
    return [[cell.strip().strip("`") for cell in line.strip("|").split("|")] for line in lines]


def full_name(name: str) -> str:
    return "/" + name.replace("ROBOT", "robot_3")


@pytest.mark.parametrize("row", rows("Topics"), ids=lambda row: row[0])
def test_topics_have_the_types_and_reliability_of_the_page(team, row):
    name, kind, sender, receiver, reliability, _ = row
    node = team.client.node

    def ends():
        topic = full_name(name)
        return node.get_publishers_info_by_topic(topic), node.get_subscriptions_info_by_topic(topic)

    senders = 1 if sender == "simulator" else team.robots

    def discovered():
        return len(ends()[0]) == senders and all("UNKNOWN" not in end.node_name for side in ends() for end in side)

    assert team.client.spin(discovered, 20.0)
    publishers, subscriptions = ends()
    assert {end.topic_type for end in publishers} == {kind}
    for end in publishers:
        assert end.qos_profile.reliability == RELIABILITY[reliability]
        assert end.qos_profile.durability == QoSDurabilityPolicy.VOLATILE
        assert end.node_name == ("simulator" if sender == "simulator" else "robot")
    receivers = {end.node_name for end in subscriptions} - {"episode_client"}
    assert receivers == {"simulator"} & set(re.findall(r"\w+", receiver)) | (
        {"robot"} if "robot" in receiver else set()
    )


def test_services_and_actions_are_those_of_the_page(team):
    node = team.client.node
    wanted = {full_name(name): kind for name, kind, *_ in rows("Services and actions")}

    def found():
        return dict(node.get_service_names_and_types()) | dict(get_action_names_and_types(node))

    assert team.client.spin(lambda: wanted.keys() <= found().keys(), 20.0)
    assert {name: found()[name][0] for name in wanted} == wanted


def test_no_other_topic_carries_the_teams_messages(team):
    known = {full_name(row[0]).replace("robot_3", "ROBOT") for row in rows("Topics")}
    topics = dict(team.client.node.get_topic_names_and_types())
    ours = {name for name, kinds in topics.items() if any(kind.startswith("magat_interfaces/msg") for kind in kinds)}
    assert {re.sub(r"robot_\d", "ROBOT", name) for name in ours} == known
