# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Deployment of a new policy to a running team: all robots switch between the same two episodes, or none does."""

import io
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rclpy.action import ActionClient
from rich.console import Console
from team_secret import SECRET

from magat_bringup.deploy import deploy
from magat_evaluation.cases import solved_cases
from magat_evaluation.planners import run_policy, simulator_for
from magat_evaluation.splits import SPLITS
from magat_interfaces.action import DeployPolicy
from magat_interfaces.msg import PolicyFile, RobotStatus
from magat_node import qos
from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import read_files, read_folder
from magat_robot.policy.models import find_policy
from magat_robot.policy.store import load, save

pytestmark = pytest.mark.system

CASE = SPLITS["test"][3]


@pytest.fixture(scope="module")
def other() -> Path:
    """A policy other than the one that the teams start with."""
    return find_policy("MAGAT-B-32-P4")


@pytest.fixture(scope="module")
def talkative(tmp_path_factory, random_network) -> Path:
    """A policy that sends longer messages than the shipped ones."""
    folder = tmp_path_factory.mktemp("models") / "talkative"
    save(random_network("MAGAT-F-128", taps=3), folder, "")
    return folder


def batched(folder: Path, number: int) -> np.ndarray:
    """The paths of a case in the batched simulator."""
    simulator = simulator_for(list(solved_cases([number])), secret=SECRET)
    positions = [simulator.position.copy()]
    run_policy(load(folder), simulator, lambda after: positions.append(after.position.copy()))
    return np.stack(positions)


class Deployer:
    """Deploys policies to a team through the simulator's action."""

    def __init__(self, team):
        self._team = team
        team.statuses()  # waits for all robots
        self._action = ActionClient(team.client.node, DeployPolicy, "deploy_policy")
        assert team.client.spin(self._action.server_is_ready, 20.0)

    def send(self, folder: Path, at: dict | None = None) -> None:
        """Deploy the policy in ``folder``; ``at`` maps states to functions, called at a state's first feedback."""
        self._at = dict(at or {})
        files = [PolicyFile(name=name, data=data) for name, data in read_files(folder).items()]
        goal = DeployPolicy.Goal(digest=read_folder(folder)[1], files=files)
        self._accepted = self._action.send_goal_async(
            goal, feedback_callback=lambda said: self._at.pop(said.feedback.state, lambda: None)()
        )

    def error(self, timeout: float = 60.0) -> str:
        """Wait for the deployment to end; returns its error, or an empty string."""
        assert self._team.client.spin(self._accepted.done, 20.0)
        ended = self._accepted.result().get_result_async()
        assert self._team.client.spin(ended.done, timeout)
        assert not self._at, "what should have happened in between"
        return ended.result().result.error


def all_carry(team, folder: Path) -> bool:
    """Whether all robots carry the policy in ``folder``; a robot that was just restarted has a moment to report it."""
    digest = read_folder(folder)[1]
    return team.client.spin(lambda: {said.digest for said in team.statuses().values()} == {digest}, 20.0)


def test_all_switch_at_the_end_of_the_episode_and_walk_as_the_new_policy(start_team, policy_folder, other):
    with start_team(10) as team:
        deployer, sent = Deployer(team), []

        def send(feedback):
            if feedback.tick >= 5 and not sent:
                sent.append(deployer.send(other))

        before = team.run(team.goal(CASE), send)
        after = team.run_undisturbed(team.goal(CASE))
        assert sent
        if (before.result.silent, before.result.features_missing) == (0, 0):  # otherwise the machine is too busy
            np.testing.assert_array_equal(before.recording.positions, batched(policy_folder, CASE))
        np.testing.assert_array_equal(after.recording.positions, batched(other, CASE))
        assert deployer.error(timeout=1.0) == ""
        assert after.result.bytes_per_tick == 164
        assert all_carry(team, other)

        deploy(policy_folder, None, Console(file=io.StringIO()))
        assert all_carry(team, policy_folder)
        back = team.run_undisturbed(team.goal(CASE))
        np.testing.assert_array_equal(back.recording.positions, batched(policy_folder, CASE))


def test_one_refuses_and_nobody_switches(start_team, policy_folder, other, talkative):
    limits = {"robot": {"max_payload": 4096}, "robot_3/robot": {"max_payload": 600}}
    with start_team(10, parameters=limits, backend="torch") as team:
        deployer = Deployer(team)
        deployer.send(talkative)
        said = deployer.error()
        assert "robot_3 refuses: MAGAT-F-128 sends up to 1024 bytes in a message, as float32" in said
        assert said.count("refuses") == 1
        assert all_carry(team, policy_folder)
        with pytest.raises(ModelError, match="radio of robot_3 carries 600: nothing was sent"):
            deploy(talkative, None, Console(file=io.StringIO()))
        outcome = team.run_undisturbed(team.goal(CASE))
        np.testing.assert_array_equal(outcome.recording.positions, batched(policy_folder, CASE))
        # A refused policy does not prevent the next one.
        deployer.send(other)
        assert deployer.error() == ""
        assert all_carry(team, other)


@pytest.mark.faults
@pytest.mark.parametrize("state", ["PREPARING", "SWITCHING"])
def test_one_is_killed_in_the_middle_and_started_again_and_carries_what_the_others_do(start_team, other, state):
    with start_team(10) as team:
        deployer, victims = Deployer(team), sorted(team.processes.pids("robots"))

        def kill():
            os.kill(victims.pop(), signal.SIGKILL)

        deployer.send(other, {getattr(DeployPolicy.Feedback, state): kill})
        assert deployer.error() == ""
        assert all_carry(team, other)
        # Later: the policy that a robot is started with is not the team's current one.
        kill()
        assert team.client.spin(lambda: not set(victims) - set(team.processes.pids("robots")), 20.0)
        outcome = team.run_undisturbed(team.goal(CASE))
        np.testing.assert_array_equal(outcome.recording.positions, batched(other, CASE))
        assert all_carry(team, other)


@pytest.mark.faults
@pytest.mark.parametrize("state", ["PREPARING", "SWITCHING"])
def test_one_is_killed_in_the_middle_for_good_and_the_others_go_back(start_team, policy_folder, other, state):
    hasty = {"simulator": {"deploy_timeout": 8.0}}
    with start_team(10, respawn=False, parameters=hasty) as team:
        deployer, (slow, victim) = Deployer(team), sorted(team.processes.pids("robots"))[-2:]
        prepared: set[str] = set()

        def note(status: RobotStatus) -> None:
            prepared.update(status.robots if status.prepared else ())

        team.client.node.create_subscription(RobotStatus, "/robot_status", note, qos.reliable(100))
        os.kill(slow, signal.SIGSTOP)
        deployer.send(other, {getattr(DeployPolicy.Feedback, state): lambda: os.kill(victim, signal.SIGKILL)})
        if state == "SWITCHING":
            # Stop it between preparing and the order to switch: otherwise it could switch before the signal arrives.
            assert team.client.spin(lambda: len(prepared) == 9, 20.0)
            os.kill(victim, signal.SIGSTOP)
        os.kill(slow, signal.SIGCONT)
        said = deployer.error()
        assert "no answer within 8 s from robot_" in said
        left = replace(team, robots=9)
        assert all_carry(left, policy_folder)


@pytest.mark.faults
def test_the_simulator_is_killed_in_the_middle_and_the_next_deployment_brings_all_together(start_team, other):
    with start_team(10) as team:
        deployer, (simulator,) = Deployer(team), team.processes.pids("simulator")
        killed = []
        deployer.send(
            other, {DeployPolicy.Feedback.SWITCHING: lambda: killed.append(os.kill(simulator, signal.SIGKILL))}
        )
        assert team.client.spin(lambda: killed and team.processes.starts("simulator") == 2, 20.0)
        deploy(other, None, Console(file=io.StringIO()))
        assert all_carry(team, other)
        outcome = team.run_undisturbed(team.goal(CASE))
        np.testing.assert_array_equal(outcome.recording.positions, batched(other, CASE))
