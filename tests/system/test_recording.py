# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings of real teams: complete at full rate, nearly complete if the recorder is killed, and replayed."""

import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import rclpy
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from nav_msgs.msg import OccupancyGrid
from rclpy.executors import SingleThreadedExecutor
from rich.console import Console
from rosbags.highlevel import AnyReader
from std_msgs.msg import Empty

from magat_bringup.deploy import deploy
from magat_bringup.environment import LOOPBACK, Network, loopback, own_domain
from magat_cli.main import main
from magat_evaluation.splits import SPLITS
from magat_interfaces.msg import Deployment, World
from magat_node import qos
from magat_node.errors import TeamError
from magat_node.topics import RECORDER_READY
from magat_recording.bag import BagError, bag_files, read_bag
from magat_recording.recovery import recover
from magat_recording.tables import TeamRecording
from magat_robot.policy.folder import read_files
from magat_robot.policy.models import find_policy

pytestmark = pytest.mark.system

CASE = SPLITS["test"][3]
#: What `magat analyze` says of an episode as the action's result does.
SAME = ("success", "success_strict", "delta_ft", "delta_ft_strict", "p_rg", "flowtime", "makespan", "t_max", "ticks",
        "moves_blocked", "silent", "features_missing", "bytes_per_tick")  # fmt: skip


def magat(*arguments: object, environment: dict[str, str] | None = None) -> subprocess.Popen[str]:
    inherited = {k: v for k, v in os.environ.items() if k != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
    return subprocess.Popen(
        [sys.executable, "-m", "magat_cli", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=inherited | (environment or {}),
    )


def said_by(process: subprocess.Popen[str], timeout: float = 60) -> str:
    output, _ = process.communicate(timeout=timeout)
    assert process.returncode == 0, output
    return output


@pytest.fixture(scope="module", params=["direct", pytest.param("relayed", marks=pytest.mark.faults)])
def run(request, tmp_path_factory) -> Path:
    """The output folder of a recorded run of twenty robots with an RViz bridge."""
    folder = tmp_path_factory.mktemp(request.param)
    # The second time fewer processes, which start sooner.
    crew = {"direct": 1, "relayed": 5}[request.param]
    options = ("--robots", 20, "--crew", crew, "--width", 28, "--height", 28, "--episodes", 2, "--radio", request.param)
    said_by(magat("run", *options, "--record", "--rviz", "--output", folder), timeout=110)
    return folder


@pytest.mark.timeout(200)
def test_a_recording_of_twenty_robots_is_complete(run):
    recording = TeamRecording(run / "bag")
    results = json.loads((run / "results.json").read_text())
    ticks = sum(result["ticks"] for result in results)
    assert len(recording.ticks) == ticks > 20
    assert recording.lost.to_numpy().tolist() == []
    messages = recording.messages[recording.messages.tick >= 0]
    counts = messages.groupby("kind").size()
    # On a busy machine, robots that missed the deadline may have sent less.
    late = sum(result["silent"] for result in results)
    for kind in ("Observation", "Feature", "Preference"):
        assert 20 * ticks - late <= counts[kind] <= 20 * ticks, kind
    assert counts["World"] == ticks + 2
    if run.name.startswith("relayed"):
        assert 20 * ticks - late <= counts["FeatureBundle"] <= 20 * ticks
    else:
        assert "FeatureBundle" not in counts


@pytest.mark.timeout(200)
def test_other_libraries_read_all_messages(run):
    count = 0
    with AnyReader([run / "bag"]) as reader:
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            count += 1
        assert count == reader.message_count
        seen = {connection.topic for connection in reader.connections if connection.msgcount}
    assert {"/world", "/feature", "/preference", "/robot_status", "/rosout"} <= seen
    assert {"/diagnostics", "/map", "/markers", "/robot_19/observation"} <= seen
    with bag_files(run / "bag")[0].open("rb") as file:
        decoded = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        assert sum(1 for _ in decoded) == count


@pytest.mark.timeout(200)
def test_magat_analyze_prints_the_measures_of_the_run_and_attention(run, tmp_path, capfd):
    assert main(["analyze", str(run / "bag"), "--json", "--output", str(tmp_path)]) == 0
    said = json.loads(capfd.readouterr().out)
    results = json.loads((run / "results.json").read_text())
    for episode, result in zip(said["episodes"], results, strict=True):
        assert episode["id"] == result["episode"]
        assert {name: episode[name] for name in SAME} == {name: result[name] for name in SAME}
    assert set(said["lost"].values()) == {0}
    # Nearest neighbours are heard most, with a policy whose attention was trained.
    nearest, *_, farthest = said["attention"]["distance"]
    assert nearest["relative"] > farthest["relative"] > 0
    pictures = {path.name for path in tmp_path.glob("*.png")}
    assert pictures == {"attention.png", "timing.png", "decisions.png"}


@pytest.mark.parametrize("run", ["direct"], indirect=True)
def test_the_worked_example_runs(run, tmp_path):
    script = Path(__file__).parents[2] / "docs" / "recording" / "conflicts.py"
    subprocess.run([sys.executable, script, run / "bag"], cwd=tmp_path, timeout=100, check=True)
    assert (tmp_path / "conflicts.png").stat().st_size > 10_000


@pytest.mark.faults
def test_a_recording_with_a_discovery_server_and_a_deployment_is_complete(start_team, tmp_path, monkeypatch):
    with start_team(3, server=True, record=tmp_path / "bag") as team:
        for name, value in Network(int(team.environment["ROS_DOMAIN_ID"]), LOOPBACK).tool_variables.items():
            monkeypatch.setenv(name, value)
        team.client.wait_for_recorder()
        ticks = team.run(team.goal(CASE)).result.ticks
        deploy(find_policy("GNN-F-128"), None, Console(file=io.StringIO()))
        ticks += team.run(team.goal(CASE)).result.ticks
    recording = TeamRecording(tmp_path / "bag")
    assert len(recording.ticks) == ticks > 0
    assert recording.lost.to_numpy().tolist() == []
    assert list(recording.policies.values()) == ["MAGAT-F-128", "GNN-F-128"]
    orders = [said.message for said in read_bag(tmp_path / "bag") if said.topic == "/deployment"]
    assert [order.order for order in orders] == [Deployment.PREPARE, Deployment.SWITCH]
    assert {file.name: bytes(file.data) for file in orders[0].files} == read_files(find_policy("GNN-F-128"))


def test_a_killed_recorder_loses_at_most_the_last_second(start_team, tmp_path):
    bag = tmp_path / "bag"
    began, killed = [], []

    def kill_in_mid_run(feedback):
        if feedback.tick and not began:
            began.append(time.monotonic())
        if began and time.monotonic() - began[0] > 0.6 and not killed:
            os.kill(team.processes.pids("recorder")[0], signal.SIGKILL)
            killed.append((time.time_ns(), feedback.tick))

    with start_team(5, record=bag) as team:
        team.client.wait_for_recorder()
        first = team.run(team.goal(CASE))
        team.client.spin(lambda: False, 1.0)  # what came before the last second is there
        # Far goals: it is not over before the recorder is killed.
        second = team.run(team.goal(CASE, t_max=400, width=150, height=150), kill_in_mid_run)
        # The first flush that brings more than the file's header.
        more = (tmp_path / "bag_2").glob
        assert team.client.spin(lambda: any(file.stat().st_size > 1000 for file in more("*.mcap")), 20.0)
    when, tick = killed[0]
    assert second.result.ticks > tick + 20, "the team does not notice"
    assert len(list(read_bag(tmp_path / "bag_2"))) > 0
    with pytest.raises(BagError, match="was not closed"):
        list(read_bag(bag))
    saved = recover(bag, tmp_path / "saved")
    assert saved.damaged == 0
    last = max(message.received for message in read_bag(tmp_path / "saved"))
    assert when - last < 1e9
    recording = TeamRecording(tmp_path / "saved")
    assert recording.lost[recording.lost.episode == 0].to_numpy().tolist() == []
    assert recording.episodes.id[0] == first.result.episode
    assert recording.episodes.ended.tolist()[0]
    with AnyReader([tmp_path / "saved"]) as reader:
        assert reader.message_count == saved.messages


@pytest.mark.faults
def test_the_recorder_overwrites_nothing_and_publishes_nothing_to_the_team(start_team, tmp_path):
    (tmp_path / "bag").mkdir()
    with pytest.raises(TeamError, match="exists already: remove it"), start_team(2, record=tmp_path / "bag") as team:
        team.client.wait_for_recorder()
    with start_team(2, record=tmp_path / "other") as team:
        team.client.wait_for_recorder()
        node = team.client.node
        spoken = {
            topic
            for name in ("recorder", "recorder_listener")
            for topic, _ in node.get_publisher_names_and_types_by_node(name, "/")
        }
        assert spoken <= {"/recorder/ready", "/rosout", "/parameter_events"}


@pytest.mark.faults
def test_magat_record_joins_a_running_team(start_team, tmp_path):
    bag = tmp_path / "bag"
    with start_team(3) as team:
        team.run(team.goal(CASE))
        recorder = magat("record", bag, environment=team.environment)
        ready: list[Empty] = []
        RECORDER_READY.subscription(team.client.node, ready.append)
        deadline = time.monotonic() + 60
        while not ready:
            assert time.monotonic() < deadline, "it does not hear the whole team"
            team.run(team.goal(CASE))
        episode = team.run(team.goal(CASE)).result.episode
        recorder.send_signal(signal.SIGINT)
        said_by(recorder, timeout=20)
    recording = TeamRecording(bag)
    assert recording.names == ["robot_0", "robot_1", "robot_2"]
    assert recording.episodes.id.tolist()[-1] == episode
    assert len(recording.lost[recording.lost.episode == recording.episodes.episode.max()]) == 0


@pytest.mark.faults
@pytest.mark.parametrize("run", ["direct"], indirect=True)
def test_a_replay_is_faster_and_an_rviz_bridge_draws_it(run):
    worlds, maps = [], []
    context = rclpy.Context()
    with own_domain() as domain:
        environment = loopback(domain)
        replay = magat("replay", run / "bag", "--rate", 3, "--rviz", "--delay", 4, environment=environment)
        before = {name: os.environ.get(name) for name in environment}
        os.environ.update(environment)
        rclpy.init(args=[], context=context, domain_id=domain)
        node = rclpy.create_node("watching", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        try:
            node.create_subscription(World, "/world", worlds.append, qos.reliable(1000))
            node.create_subscription(OccupancyGrid, "/map", maps.append, qos.latched(1))
            deadline = time.monotonic() + 60
            while replay.poll() is None and time.monotonic() < deadline:
                executor.spin_once(timeout_sec=0.1)
        finally:
            executor.shutdown()
            node.destroy_node()
            context.try_shutdown()
            os.environ.update({name: value for name, value in before.items() if value is not None})
    said_by(replay)
    recorded = [message.message for message in read_bag(run / "bag") if message.topic == "/world"]
    assert [(w.episode, w.tick) for w in worlds] == [(w.episode, w.tick) for w in recorded]
    assert {(grid.info.width, grid.info.height) for grid in maps} == {(28, 28)}
    assert 100 in set(maps[0].data)
