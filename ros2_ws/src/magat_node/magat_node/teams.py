"""Finding a team that runs."""

from typing import NamedTuple

from rclpy.node import Node

from magat_interfaces.msg import FeatureBundle, Observation, World
from magat_node.errors import TeamError
from magat_node.visitor import Visitor

#: How long to look for a team, seconds.
PATIENCE = 30.0


class RunningTeam(NamedTuple):
    """A team that runs."""

    namespace: str
    robots: list[str]
    radio: str


def find_team(namespace: str | None) -> RunningTeam:
    """The team whose simulator runs in ``namespace``, or anywhere.

    Raises:
        TeamError: there is none, or more than one and no ``namespace``.
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
            f"no simulator after {PATIENCE:g} s: start a team first, and name its ROS domain by --domain, or as in the "
            "team's own shell"
        )
    return found[0]


def _teams(node: Node) -> list[RunningTeam]:
    """The teams whose simulators can be seen with all that they speak on."""
    found = []
    for name, namespace in node.get_node_names_and_namespaces():
        if name != "simulator":
            continue
        spoken: dict[str, list[str]] = {}
        for topic, (kind, *_) in node.get_publisher_names_and_types_by_node(name, namespace):
            spoken.setdefault(kind, []).append(topic)
        # The simulator speaks of the world on the topic that it makes last.
        if _kind(World) in spoken:
            start, end = len(namespace.rstrip("/")) + 1, -len("/observation")
            robots = sorted(topic[start:end] for topic in spoken[_kind(Observation)])
            found.append(RunningTeam(namespace, robots, "relayed" if _kind(FeatureBundle) in spoken else "direct"))
    return found


def _kind(message: type) -> str:
    return f"magat_interfaces/msg/{message.__name__}"
