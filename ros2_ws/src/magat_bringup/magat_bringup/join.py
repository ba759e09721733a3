"""Finding a team that runs; ``magat record``, which records it until it is told to end."""

from pathlib import Path
from typing import NamedTuple

from rclpy.node import Node
from rclpy.parameter import Parameter
from rich.console import Console

from magat_bringup.processes import TeamError
from magat_bringup.recorder import RecorderNode
from magat_bringup.visitor import Visitor
from magat_interfaces.msg import FeatureBundle, Observation, World
from magat_node.run import give_way, run_node

#: How long to look for a team, seconds.
PATIENCE = 30.0


class Found(NamedTuple):
    """A team that runs."""

    namespace: str
    robots: list[str]
    radio: str


def record(folder: Path, namespace: str | None, console: Console) -> int:
    """Record the team of this environment's ROS domain to ``folder`` until Ctrl-C; returns the exit status.

    Args:
        folder: for the bag; it must not be there.
        namespace: of the team; None if there is only one.
        console: shows what goes on.

    Raises:
        TeamError: there is no team, or more than one and no ``namespace``.
    """
    give_way()
    with console.status("looking for a team"):
        team = find_team(namespace)
    with console.status("") as status:

        def create() -> Node:
            given = {"bag": str(folder), "robots": team.robots, "radio": team.radio}
            overrides = [Parameter(name, value=value) for name, value in given.items()]
            node = RecorderNode(namespace=team.namespace, parameter_overrides=overrides)

            def show() -> None:
                size = f"{node.bag.messages} messages, {node.bag.size / 2**20:.1f} MiB"
                status.update(f"recording {len(team.robots)} robots to {folder}: {size}; Ctrl-C ends it")

            node.create_timer(0.5, show)
            return node

        return run_node("recorder", create, [])


def find_team(namespace: str | None) -> Found:
    """The team whose simulator runs in ``namespace``, or anywhere.

    Raises:
        TeamError: there is none, or more than one and no ``namespace``.
    """
    found: list[Found] = []

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


def _teams(node: Node) -> list[Found]:
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
            found.append(Found(namespace, robots, "relayed" if _kind(FeatureBundle) in spoken else "direct"))
    return found


def _kind(message: type) -> str:
    return f"magat_interfaces/msg/{message.__name__}"
