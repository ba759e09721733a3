# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The discovery server: teams with it are like others, and nothing that they open can be reached from elsewhere."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import psutil
import pytest

from magat_bringup.environment import LOOPBACK, Network
from magat_evaluation.splits import SPLITS
from magat_node.errors import TeamError

pytestmark = pytest.mark.system

CASE = SPLITS["test"][9]


def test_a_robot_that_is_killed_comes_back_through_the_server(start_team):
    with start_team(3, server=True) as team:
        goal = team.goal(CASE)
        whole = team.run_undisturbed(goal).recording.positions
        before = set(team.processes.pids("robots"))
        os.kill(min(before), signal.SIGKILL)
        assert team.client.spin(lambda: len(set(team.processes.pids("robots")) - before) == 1, 30.0)
        again = team.run_undisturbed(goal).recording.positions
    np.testing.assert_array_equal(again, whole)


def test_a_team_whose_server_is_killed_ends_and_says_so(start_team):
    with start_team(2, server=True, backend="echo") as team:
        os.kill(team.processes.pids("discovery")[0], signal.SIGKILL)
        with pytest.raises(TeamError, match="discovery: killed by signal 9, not started again"):
            team.client.spin(lambda: False, 20.0)


@pytest.mark.parametrize("server", [False, True], ids=["peers", "server"])
def test_no_process_of_a_team_can_be_reached_from_elsewhere(start_team, server):
    with start_team(2, server=server) as team:
        for name in ("robots", "simulator", "expert"):
            for pid in team.processes.pids(name):
                assert set(listening(pid)) == {LOOPBACK}, name
        if server:
            (pid,) = team.processes.pids("discovery")
            # What it sends from, it does not listen on.
            port = Network(int(team.environment["ROS_DOMAIN_ID"]), LOOPBACK).port
            assert [address for address, ports in listening(pid).items() if port in ports] == [LOOPBACK]


def listening(pid: int) -> dict[str, set[int]]:
    """UDP and TCP ports that a process has bound, by address."""
    ports: dict[str, set[int]] = {}
    for one in psutil.Process(pid).net_connections("inet"):
        ports.setdefault(one.laddr.ip, set()).add(one.laddr.port)
    return ports


def test_the_server_dies_with_its_team(tmp_path):
    environment = {k: v for k, v in os.environ.items() if k != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
    command = ["run", "--robots", "2", "--episodes", "500", "--interface", "lo", "--output", str(tmp_path)]
    with subprocess.Popen(
        [sys.executable, "-m", "magat_cli", *command], env=environment, stdout=subprocess.DEVNULL
    ) as run:
        try:
            wait_for(lambda: servers_of(run.pid))
            (server,) = servers_of(run.pid)
        finally:
            run.kill()
    psutil.wait_procs([server], timeout=10)
    assert not server.is_running()


def servers_of(pid: int) -> list[psutil.Process]:
    return [child for child in psutil.Process(pid).children() if child.name().startswith("fast-discovery")]


def wait_for(condition) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline, "it did not come about in time"
        time.sleep(0.05)


@pytest.mark.faults
@pytest.mark.timeout(600)
def test_a_hundred_and_twenty_processes_find_each_other(start_team):
    joined = []
    started = time.monotonic()
    with start_team(120, server=True, backend="echo", radio="relayed", ready_timeout=400.0) as team:
        goal = team.goal(CASE, width=70, height=70, t_max=5)
        result = team.run(goal, lambda feedback: joined.append(feedback.joined)).result
        print(f"an episode of 120 processes ended {time.monotonic() - started:.0f} s after the first was started")
        assert len(team.processes.pids("robots")) == 120
    assert max(joined) == 120
    assert result.ticks == 5
