# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of real teams shows their worlds and the details of a robot, and does not disturb the team."""

import os
import re
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest
import rclpy
from rclpy.node import NodeNameNonExistentError

from magat_bringup.client import EpisodeOutcome
from magat_evaluation.splits import SPLITS
from magat_sim.radio import neighbours
from magat_viewer.address import HOST, free_port
from magat_viewer.detail import TeamSnapshot
from magat_viewer.follower import Follower
from magat_viewer.serve import live_page

pytestmark = pytest.mark.system

CASE = SPLITS["test"][3]
#: Of 10 robots in frames, after the head.
POSITIONS = slice(32, 32 + 40)


@pytest.fixture(params=["team", pytest.param("relayed_team", marks=pytest.mark.faults)])
def watched(request) -> Iterator[tuple]:
    """A team of ten robots, with either radio, and its page in this process."""
    team = request.getfixturevalue(request.param)
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=int(team.environment["ROS_DOMAIN_ID"]))
    try:
        with live_page(context, "/") as page:
            yield team, page
    finally:
        context.try_shutdown()


def page_subscriptions(team) -> set[str]:
    try:
        found = team.client.node.get_subscriber_names_and_types_by_node("viewer", "/")
    except NodeNameNonExistentError:  # its messages may come before its name
        return set()
    return {topic for topic, _ in found}


@pytest.mark.timeout(200)
def test_it_shows_the_world_and_the_detail_of_the_chosen_robot(watched):
    team, page = watched
    with Follower(page.url, chosen=3) as follower:
        assert team.client.spin(lambda: follower.counts["team"] > 0, 20.0)
        details, recordings, missed = [{"neighbours": []}], {}, False

        def look(_: object) -> None:
            details.append(follower.last.get("detail", details[0]))

        deadline = time.monotonic() + 90
        # At first the policy is not loaded, and the observations are not subscribed to.
        while not any(any(one["attention"] for one in detail["neighbours"]) for detail in details):
            assert time.monotonic() < deadline, details[-1:]
            outcome = team.run(team.goal(CASE), look)
            missed |= any(any(world.missing) for world in outcome.recording.worlds.values())
            # If it joined late, it did not receive the first world of the episode either.
            if team.client.spin(lambda ticks=outcome.result.ticks: shown_tick(follower) == ticks, 5.0):
                recordings[follower.last["scene"]["episode"]] = outcome.recording
        needed = {"/world", "/robot_status", "/robot_3/observation"}
        assert team.client.spin(lambda: page_subscriptions(team) >= needed, 20.0)
        others = {"/preference", "/feature", "/robot_3/heard"}
        if not missed:  # subscribing to robots' messages would cost them time
            assert team.client.spin(lambda: not page_subscriptions(team) & others, 5.0)

        last = outcome.recording
        frame = follower.last["frames"]
        size = len(frame) // max(1, len(frame) // (32 + 52))
        cells = np.frombuffer(frame[-size:][POSITIONS], "<i2").reshape(2, 10).T
        assert cells.tolist() == last.positions[-1].tolist()
        assert follower.last["scene"]["goals"] == last.goals.tolist()

        detail = next(d for d in reversed(details) if any(one["attention"] for one in d["neighbours"]))
        recording, tick = recordings[detail["episode"]], detail["tick"]
        snapshot = TeamSnapshot(tick, recording.positions[tick], recording.goals, recording.obstacles)
        [view] = snapshot.fields_of_view([3])
        assert detail["field_of_view"] == ["".join(map(str, channel.ravel())) for channel in view]
        row = neighbours(np.zeros(10, dtype=np.int64), snapshot.positions)[3]
        assert [one["robot"] for one in detail["neighbours"]] == row[row >= 0].tolist()
        assert sum(one["attention"][0] for one in detail["neighbours"] if one["attention"]) == pytest.approx(
            1, abs=1e-3
        )
        assert sum(detail["probabilities"]) == pytest.approx(1, abs=1e-3)
        assert detail["action"] == recording.action[tick, 3]
        assert detail["no_attention"] == ""
    # No robot is chosen any more.
    node = team.client.node
    assert team.client.spin(lambda: page_subscriptions(team) == {"/world", "/robot_status"}, 20.0)
    spoken = {topic for topic, _ in node.get_publisher_names_and_types_by_node("viewer", "/")}
    assert spoken <= {"/rosout", "/parameter_events"}


def run_until_shown(team, follower: Follower) -> EpisodeOutcome:
    """Runs episodes until one is shown: a page that has just started discovers the simulator a little later."""
    seen, deadline = follower.counts["frames"], time.monotonic() + 30
    while True:
        assert time.monotonic() < deadline, "no episode is shown"
        outcome = team.run(team.goal(CASE))
        if team.client.spin(lambda: follower.counts["frames"] > seen, 1.0):
            return outcome


def shown_tick(follower: Follower) -> int:
    frame = follower.last.get("frames")
    return -1 if frame is None else struct.unpack_from("<I", frame, len(frame) - (32 + 52) + 4)[0]


@pytest.mark.faults
def test_a_page_that_is_killed_is_restarted(start_team):
    port = free_port()
    with start_team(2, view=port) as team, Follower(f"http://{HOST}:{port}/") as follower:
        for times in (1, 2):
            assert team.client.spin(lambda times=times: follower.counts["team"] == times, 60.0)
            outcome = run_until_shown(team, follower)
            assert follower.last["scene"]["robots"] == outcome.recording.robots
            if times == 1:
                os.kill(team.processes.pids("viewer")[0], signal.SIGKILL)
        digest = next(iter(team.statuses().values())).digest

        def well() -> bool:
            processes = follower.last.get("health", {"processes": []})["processes"]
            return sorted((process["robots"], process["digest"]) for process in processes) == [
                ([0], digest),
                ([1], digest),
            ]

        assert team.client.spin(well, 20.0)


@pytest.mark.faults
def test_magat_view_joins_a_running_team(team):
    inherited = {k: v for k, v in os.environ.items() if k != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
    view = subprocess.Popen(
        [sys.executable, "-m", "magat_cli", "view", "--namespace", "/"],
        env=inherited | team.environment | {"PYTHONUNBUFFERED": "1"},
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        said = view.stderr.readline()
        [url] = re.findall(r"http://\S+", said)
        with Follower(url) as follower:
            assert team.client.spin(lambda: follower.counts["team"] > 0, 20.0)
            run_until_shown(team, follower)
        view.send_signal(signal.SIGINT)
        assert view.wait(20) == 130
    finally:
        view.kill()
