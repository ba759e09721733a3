# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Robots that die, wrong models, interruption: no collision, no hang, nothing left behind."""

import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import psutil
import pytest
import rclpy
from rclpy.parameter import Parameter

from magat_bringup.environment import own_domain
from magat_evaluation.splits import SPLITS
from magat_expert import check_paths
from magat_node.errors import TeamError
from magat_robot.forked import _carrying, _namespace
from magat_robot.forked import main as robots
from magat_robot.node import RobotNode

pytestmark = pytest.mark.system

CASE = SPLITS["test"][9]


@pytest.mark.faults
def test_a_robot_killed_in_mid_episode_stays_in_the_world_and_nobody_runs_into_it(start_team):
    with start_team(5, ready_timeout=20.0, respawn=False) as team:
        victims = []

        def kill_at_tick_three(feedback):
            if feedback.tick == 3 and not victims:
                victims.append(team.processes.pids("robots")[0])
                os.kill(victims[0], signal.SIGKILL)

        outcome = team.run(team.goal(CASE), kill_at_tick_three)
        result, recording = outcome.result, outcome.recording
        assert victims
        assert result.silent > 0
        # The independent checker knows nothing of goals missed; all else must hold.
        complaints = check_paths(
            recording.obstacles, recording.positions[0], recording.positions[-1], recording.positions
        )
        assert complaints == []
        still = [(recording.positions[5:, i] == recording.positions[5, i]).all() for i in range(5)]
        assert any(still)
        assert result.ticks_per_second > 2, "two deadlines of a second, and then nobody waits for the dead"
        with pytest.raises(TeamError, match="not there after"):
            team.client.run(team.goal(CASE), lambda _: None)


@pytest.mark.faults
def test_a_stopped_and_continued_robot_takes_part_again(start_team):
    with start_team(4) as team:
        stopped = []

        def stop_and_continue(feedback):
            if feedback.tick == 2 and not stopped:
                stopped.append(team.processes.pids("robots")[0])
                os.kill(stopped[0], signal.SIGSTOP)
            if feedback.tick == 6 and len(stopped) == 1:
                os.kill(stopped[0], signal.SIGCONT)
                stopped.append(None)

        outcome = team.run(team.goal(CASE, t_max=2000), stop_and_continue)
        assert len(stopped) == 2
        assert outcome.result.silent >= 2
        assert team.run(team.goal(CASE)).result.silent == 0


def test_a_policy_that_is_damaged_is_named_and_nothing_is_left(tmp_path, policy_folder):
    for name in ("config.json", "card.md"):
        (tmp_path / name).write_bytes((policy_folder / name).read_bytes())
    (tmp_path / "model.safetensors").write_bytes((policy_folder / "model.safetensors").read_bytes()[:-100])
    ended = _magat(
        "run", "--robots", "2", "--episodes", "1", "--policy", str(tmp_path), "--output", str(tmp_path / "out")
    )
    output, _ = ended.communicate(timeout=60)
    assert ended.returncode == 1
    assert "model.safetensors is damaged" in re.sub(r"\s+", " ", output)
    assert _team_processes(tmp_path) == []


@pytest.mark.parametrize("moment", ["starting", "running"])
@pytest.mark.parametrize(
    "number",
    [
        pytest.param(signal.SIGINT, marks=pytest.mark.faults),
        signal.SIGTERM,
        pytest.param(signal.SIGKILL, marks=pytest.mark.faults),
    ],
)
def test_no_process_is_left_behind(tmp_path, number, moment):
    magat = _magat("run", "--robots", "3", "--episodes", "500", "--output", str(tmp_path / "out"))
    logs = tmp_path / "out" / "logs"
    wanted = {"starting": lambda: _team_processes(tmp_path), "running": lambda: _solved(logs)}[moment]
    _wait_for(wanted, 60.0)
    magat.send_signal(number)
    output, _ = magat.communicate(timeout=20)
    _wait_for(lambda: _team_processes(tmp_path) == [], 10.0)
    assert magat.returncode == (-number if number == signal.SIGKILL else 130), output


def test_ten_robots_start_and_each_costs_less_than_100_mib(start_team):
    started = time.monotonic()
    joined = []

    def note(feedback):
        if feedback.joined == 10 and not joined:
            joined.append(time.monotonic() - started)

    with start_team(10) as team:
        team.run(team.goal(CASE), note)
        memory = [psutil.Process(pid).memory_full_info().pss / 2**20 for pid in team.processes.pids("robots")]
    print(f"joined after {joined[0]:.1f} s, PSS {min(memory):.0f} to {max(memory):.0f} MiB")
    assert len(memory) == 10
    assert max(memory) < 100
    # A quiet machine takes 4 to 6 s (`magat bench-runtime` measures it), a busy one several times as long.
    assert joined[0] < 40


@pytest.mark.faults
def test_a_robot_started_alone_walks_the_same_path(start_team, policy_folder):
    with start_team(3, ready_timeout=20.0, respawn=False) as team:
        forked = team.run(team.goal(CASE)).recording.positions
        os.kill(team.processes.pids("robots")[0], signal.SIGKILL)
        # Which of the three died shows in which one the simulator misses.
        with pytest.raises(TeamError, match="not there after") as error:
            _until_missed(team)
        name = re.search(r"robot_\d", str(error.value)).group()
        parameters = ["-r", f"__ns:=/{name}", "-p", f"policy:={policy_folder}", "-p", "team_size:=3"]
        command = [sys.executable, "-m", "magat_robot.node", "--ros-args", *parameters]
        with subprocess.Popen(command, env=os.environ | team.environment) as alone:
            try:
                positions = team.run(team.goal(CASE)).recording.positions
            finally:
                alone.send_signal(signal.SIGINT)
            assert alone.wait(10) == 0
        np.testing.assert_array_equal(positions, forked)


@pytest.mark.parametrize(
    ("arguments", "team"),
    [
        ([], ""),
        (["-r", "__ns:=/hall/red"], "/hall/red"),
        (["-p", "team_size:=2", "--remap", "__ns:=/red/"], "/red"),
        (["-r", "robot:__ns:=red", "--ros-args", "-r", "__ns:=/blue"], "/red"),
        (["-r", "simulator:__ns:=/red", "-r", "__node:=x"], ""),
    ],
)
def test_robots_and_crews_are_in_the_namespace_that_their_launcher_is_given(arguments, team):
    assert _namespace(arguments) == team
    assert _carrying(["alice"], team) == ["-r", f"__ns:={team}/alice"]
    # Shared topics lie in the team's namespace, whichever way its robots are carried.
    assert _carrying(["alice", "bob"], team) == ["-r", f"__ns:={team}/alice", "-p", "robots:=[alice,bob]"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--crew", "0", "a"], "at least 1"),
        (["--crew", "2", "left/a", "right/b"], "the robot name 'left/a' is invalid: give a name without slashes"),
        (["a__b"], "the robot name 'a__b' is invalid"),
        (["a", "--ros-args", "-r", "__ns:=/red team"], "the namespace '/red team' is invalid"),
    ],
    ids=["nobody", "slashes", "no name", "no namespace"],
)
def test_crews_that_cannot_be_are_refused_before_any_process_starts(arguments, said, capsys):
    with pytest.raises(SystemExit) as ended:
        robots(["--policy", "anywhere", *arguments])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("namespace", "parameters", "said"),
    [
        ("", {}, "the namespace / is not the name of any of the robots ['']: start the node with -r __ns:=/NAME"),
        ("/c", {"robots": ["a", "b"]}, "the namespace /c is not the name of any of the robots ['a', 'b']"),
        ("/a", {"robots": ["a", "b", "a"]}, "name each only once"),
        ("/a", {"radio": "pigeon"}, "radio is 'pigeon'"),
        ("/a", {"encoding": "morse"}, "encoding is 'morse'"),
    ],
    ids=["no name", "another's name", "a name twice", "no radio", "no encoding"],
)
def test_a_robot_that_cannot_be_says_why(policy_folder, namespace, parameters, said):
    context = rclpy.Context()
    with own_domain() as domain:
        rclpy.init(args=[], context=context, domain_id=domain)
        overrides = [
            Parameter(name, value=value) for name, value in ({"policy": str(policy_folder)} | parameters).items()
        ]
        try:
            with pytest.raises(ValueError, match=re.escape(said)):
                RobotNode(context=context, namespace=namespace, parameter_overrides=overrides)
        finally:
            context.try_shutdown()


def _until_missed(team):
    for _ in range(3):
        team.run(team.goal(CASE))


def _magat(*arguments: str) -> subprocess.Popen:
    environment = {k: v for k, v in os.environ.items() if k != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
    return subprocess.Popen(
        [sys.executable, "-m", "magat_cli", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=environment | {"MAGAT_TEST_RUN": arguments[-1]},
    )


def _team_processes(folder) -> list[int]:
    """Processes of the run that writes below ``folder``, known by the environment they inherited from it."""
    mark = f"MAGAT_TEST_RUN={folder}".encode()
    found = []
    for process in psutil.process_iter():
        try:
            with open(f"/proc/{process.pid}/environ", "rb") as environ:
                variables = environ.read().split(b"\0")
            command = " ".join(process.cmdline())
        except (OSError, psutil.Error):
            continue
        if any(v.startswith(mark) for v in variables) and "magat_cli" not in command and command:
            found.append(process.pid)
    return found


def _solved(logs) -> bool:
    log = logs / "expert.log"
    return log.exists() and "SOLVED" in log.read_text()


def _wait_for(condition, seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not come about in time"
        time.sleep(0.05)
