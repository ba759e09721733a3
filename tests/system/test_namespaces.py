# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two teams in one ROS domain, each in its namespace: by `magat run`, and by launch where that is installed."""

import importlib.util
import json
import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest
from launched import really_launched

from magat_bringup.client import EpisodeClient
from magat_bringup.environment import NoDomainError, loopback, own_domain
from magat_bringup.other_teams import refuse_other_team
from magat_cli.main import main
from magat_interfaces.action import RunEpisode

pytestmark = pytest.mark.system
NAMESPACES = ("red", "blue")


@pytest.fixture
def domain(monkeypatch) -> int:
    with own_domain() as number:
        pass
    for name, value in loopback(number).items():
        monkeypatch.setenv(name, value)
    return number


@pytest.mark.faults
def test_two_teams_run_in_one_domain_by_magat_run(domain, tmp_path):
    def start(namespace: str) -> subprocess.Popen:
        size = ["--robots", "2", "--width", "6", "--height", "6", "--episodes", "1", "--first", "3"]
        place = ["--domain", str(domain), "--namespace", namespace, "--output", str(tmp_path / namespace)]
        return subprocess.Popen(
            [sys.executable, "-m", "magat_cli", "run", *size, *place],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    teams = [start(namespace) for namespace in NAMESPACES]
    for team in teams:
        output, _ = team.communicate(timeout=100)
        assert team.returncode == 0, output
    red, blue = (json.loads((tmp_path / name / "results.json").read_text()) for name in NAMESPACES)
    assert len(red) == len(blue) == 1
    assert red != blue  # two simulators


def test_a_run_leaves_a_team_alone_that_was_started_by_hand(domain, tmp_path, capfd):
    refuse_other_team(domain, "")  # nobody is there
    command = [sys.executable, "-m", "magat_sim.node", "--ros-args", "-r", "__ns:=/red"]
    with subprocess.Popen(command) as simulator:
        try:
            with EpisodeClient(SimpleNamespace(check=lambda: None), domain, "/red") as client:
                client.wait_for_simulator()
            with pytest.raises(NoDomainError, match=f"a team runs in the ROS domain {domain} under the namespace /red"):
                refuse_other_team(domain, "/red")
            refuse_other_team(domain, "/blue")
            options = ["--domain", str(domain), "--namespace", "/red", "--output", str(tmp_path)]
            assert main(["run", *options]) == 1
            assert "a team runs in the ROS domain" in capfd.readouterr().err
            with own_domain() as other:
                assert other != domain
        finally:
            simulator.send_signal(signal.SIGINT)


def in_namespace(client: EpisodeClient, namespace: str) -> bool:
    """Whether the client sees the nodes of a team there."""
    placed = {("simulator", namespace), ("expert", namespace), ("robot", f"{namespace}/alice")}
    return client.spin(lambda: placed <= set(client.node.get_node_names_and_namespaces()), 10.0)


@pytest.mark.faults
@pytest.mark.skipif(importlib.util.find_spec("launch_ros") is None, reason="launch_ros is not installed")
def test_two_teams_run_in_one_domain_by_launch(domain, tmp_path):
    team = tmp_path / "team.yaml"
    team.write_text("robots: [alice, bob]\n")
    teams = {"/hall/red": ("hall", "red"), "/blue": ("", "blue")}
    processes = [
        really_launched(f"team:={team}", f"namespace:={namespace}", "backend:=onnx", pushed=pushed)
        for pushed, namespace in teams.values()
    ]
    try:
        for namespace in teams:
            with EpisodeClient(SimpleNamespace(check=lambda: None, starts=lambda name: 1), domain, namespace) as client:
                goal = RunEpisode.Goal(seed=1, number=3, width=6, height=6, density=0.1)
                outcome = client.run(goal, lambda feedback: None)
                assert outcome.recording.worlds[0].robots == ["alice", "bob"]
                assert in_namespace(client, namespace)
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
        ended = [process.communicate(timeout=60) and process.returncode for process in processes]
    assert ended == [0, 0]
    assert not [line for line in os.popen("ps -eo args") if str(team) in line]
