# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Finding running teams."""

from typing import NamedTuple

from rclpy.node import Node

from magat_interfaces.msg import FeatureBundle, Observation, World
from magat_node.errors import TeamError
from magat_node.visitor import Visitor

#: How long to search for a team, seconds.
PATIENCE = 30.0


class RunningTeam(NamedTuple):
    """A running team."""

    namespace: str
    robots: list[str]
    radio: str


def find_team(namespace: str | None) -> RunningTeam:
    """Find the team in ``namespace``, or the only one in any namespace.

    Raises:
        TeamError: there is no such team, or there are several and ``namespace`` is None.
    """
    found: list[RunningTeam] = []

    def look() -> bool:
        found[:] = [team for team in _teams(visitor.node) if namespace in (None, team.namespace)]
        return bool(found)

    with Visitor("looking") as visitor:
        visitor.spin(look, PATIENCE)
    if len(found) > 1:
        raise TeamError(f"there are teams in {', '.join(t.namespace for t in found)}: choose one by --namespace")
    if not found:
        raise TeamError(
            f"no simulator after {PATIENCE:g} s: start a team first, and give its ROS domain by --domain or in the "
            "environment"
        )
    return found[0]


def _teams(node: Node) -> list[RunningTeam]:
    """The teams whose simulators have been discovered with all their publishers."""
    found = []
    for name, namespace in node.get_node_names_and_namespaces():
        if name != "simulator":
            continue
        published: dict[str, list[str]] = {}
        for topic, (kind, *_) in node.get_publisher_names_and_types_by_node(name, namespace):
            published.setdefault(kind, []).append(topic)
        # The simulator creates the publisher of World after those of observations and bundles.
        # A stranger may call itself simulator, and publish only one of them.
        if _kind(World) in published and _kind(Observation) in published:
            start, end = len(namespace.rstrip("/")) + 1, -len("/observation")
            robots = sorted(topic[start:end] for topic in published[_kind(Observation)])
            found.append(RunningTeam(namespace, robots, "relayed" if _kind(FeatureBundle) in published else "direct"))
    return found


def _kind(message: type) -> str:
    return f"magat_interfaces/msg/{message.__name__}"
