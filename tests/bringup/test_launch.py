# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The launch file: what it refuses, where its nodes are, and what it does when a process ends.

Where `launch` and `launch_ros` are not installed, a stand-in takes their place; the last tests need them.
"""

import importlib.util
import socket
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import pytest
from launched import SHARE, launched, launched_nodes, really_launched, some_launch

from magat_node.errors import MagatError, TeamError
from magat_node.restarts import RESTARTS, TRIES

needs_launch = pytest.mark.skipif(importlib.util.find_spec("launch_ros") is None, reason="launch_ros is not installed")
needs_the_stand_in = pytest.mark.skipif(
    importlib.util.find_spec("launch_ros") is not None, reason="real actions do not tell what they were made of"
)


@pytest.fixture(autouse=True)
def launch() -> Iterator[None]:
    with some_launch():
        yield


@pytest.fixture
def bad(tmp_path: Path) -> Path:
    """A folder of files that cannot be used."""
    (tmp_path / "bag").mkdir()
    (tmp_path / "broken.yaml").write_text("simulator:\n  ros__parameters: {tick_deadline: [1\n")
    (tmp_path / "flat.yaml").write_text("tick_deadline: 1\n")
    (tmp_path / "slashes.yaml").write_text("robots: [red/r0, red/r1]\n")
    (tmp_path / "model").mkdir()
    return tmp_path


#: Arguments that are refused, and a part of the message.
REFUSED = [
    ({"rviz_window": "true"}, "rviz_window:=true needs rviz2, which is not installed: install"),
    ({"record": "{bad}/bag"}, "bag exists: remove it, or record to another folder"),
    ({"link_loss": "1.5"}, "the link loss is 1.5: give a share of the links, 0 to 1"),
    ({"link_loss": "much"}, "link_loss:=much is not a number: give one"),
    ({"link_loss": "nan"}, "the link loss is nan"),
    ({"view": "99999"}, "the port of the page is 99999: give a TCP port, 1 to 65535"),
    ({"view": "0"}, "the port of the page is 0"),
    ({"view": "page"}, "view:=page is not a whole number: give one"),
    ({"params": "{bad}/broken.yaml"}, "broken.yaml cannot be read: line 3: expected ',' or ']'"),
    ({"params": "{bad}/flat.yaml"}, "under tick_deadline there is 1, not the names of nodes with ros__parameters"),
    ({"params": "{bad}/none.yaml"}, "none.yaml cannot be read: No such file or directory"),
    ({"team": "{bad}/slashes.yaml"}, "the robot name 'red/r0' is invalid: give a name without slashes"),
    ({"team": "{bad}/broken.yaml"}, "the team file {bad}/broken.yaml cannot be read: line 3"),
    ({"policy": "{bad}/model"}, "no policy"),
    ({"namespace": "red team"}, "the namespace 'red team' is invalid"),
    ({"server": "true"}, "server:=true, but the shell names no address"),
]


@pytest.mark.parametrize(("arguments", "said"), REFUSED, ids=[said[:20] for _, said in REFUSED])
def test_what_cannot_work_is_refused_in_a_line_before_anything_starts(bad, monkeypatch, arguments, said):
    monkeypatch.delenv("ROS_DISCOVERY_SERVER", raising=False)
    with pytest.raises(MagatError) as refused:
        launched(**{name: value.format(bad=bad) for name, value in arguments.items()})
    assert said.format(bad=bad) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_port_that_is_taken_and_a_shell_that_ros_cannot_use_are_refused(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(MagatError, match="the port is in use"):
        launched(view=str(taken.getsockname()[1]))
    monkeypatch.setenv("ROS_DOMAIN_ID", "abc")
    with pytest.raises(MagatError, match="ROS_DOMAIN_ID is 'abc'"):
        launched()


@needs_the_stand_in
@pytest.mark.parametrize(
    ("pushed", "namespace", "team"),
    [
        ("", "", None),
        ("", "red", "/red"),
        ("/hall", "red", "/hall/red"),
        ("/hall", "", "/hall"),
        ("/hall", "/red", "/red"),
    ],
)
def test_all_nodes_of_a_team_are_in_its_namespace(pushed, namespace, team):
    from launch import LaunchContext

    context = LaunchContext()
    context.launch_configurations |= {"ros_namespace": pushed} if pushed else {}
    with mock.patch("magat_bringup.launch_checks.get_package_prefix"):
        *nodes, rviz = launched_nodes(context, namespace=namespace, view="8377", rviz_window="true")
    assert len(nodes) == 5
    assert {node.namespace for node in (*nodes, rviz)} == {team}
    assert rviz.cmd[1:3] == ["-d", str(SHARE / "config" / "team.rviz")]
    shown = ["-f", f"{team[1:]}/map", f"/map:={team}/map", f"/markers:={team}/markers"] if team else []
    assert [part for part in shown if part not in rviz.cmd] == []


# --- Ends ---


def endings(**arguments: str) -> dict[str, list]:
    """What the handlers of each process are."""
    from launch import LaunchContext

    nodes = launched_nodes(LaunchContext(), view="8377", **arguments)
    return dict(zip(("robots", "simulator", "expert", "rviz_bridge", "viewer"), nodes, strict=True))


def ends(node: object, status: int, is_shutdown: bool = False) -> object:
    (action,) = node.on_exit(SimpleNamespace(returncode=status), SimpleNamespace(is_shutdown=is_shutdown)) or [None]
    return action


@needs_the_stand_in
def test_what_a_signal_has_killed_is_started_again_in_its_place_until_the_tries_are_spent():
    node = endings(namespace="red")["simulator"]
    for _ in range(RESTARTS):
        (again,) = ends(node, -9).actions
        assert (again.cmd, again.namespace) == (node.cmd, "/red")
        node = again
    with pytest.raises(TeamError, match="simulator was killed by signal 9, and is not started again: the team ends"):
        ends(node, -9)


@needs_the_stand_in
def test_what_has_failed_by_itself_ends_the_team_and_what_only_watches_does_not():
    nodes = endings()
    for name in ("robots", "simulator", "expert"):
        with pytest.raises(TeamError, match=f"{name} ended with status 1"):
            ends(nodes[name], 1)
        assert ends(nodes[name], 0).reason == f"{name} ended with status 0"
        assert ends(nodes[name], -2, is_shutdown=True) is None
    for name in ("rviz_bridge", "viewer"):
        assert [bool(ends(nodes[name], 1).actions) for _ in range(TRIES)] == [True] * TRIES
        assert "the team goes on without it" in ends(nodes[name], 1).msg
    alone = endings(respawn="false")
    with pytest.raises(TeamError, match="simulator was killed by signal 9"):
        ends(alone["simulator"], -9)
    assert "--respawn" not in alone["robots"].cmd


# --- The real launch ---


@needs_launch
@pytest.mark.parametrize(("arguments", "said"), REFUSED, ids=[said[:20] for _, said in REFUSED])
def test_really_launched_what_cannot_work_ends_with_status_1_and_a_line(bad, monkeypatch, arguments, said):
    monkeypatch.delenv("ROS_DISCOVERY_SERVER", raising=False)
    process = really_launched(*(f"{name}:={value.format(bad=bad)}" for name, value in arguments.items()))
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 1
    (line,) = [line for line in output.splitlines() if "ERROR" in line]
    assert said.format(bad=bad) in line
    assert "process started" not in output
