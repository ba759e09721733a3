# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults of processes and of the network: no robot collides, nothing hangs, and the measures show what went wrong."""

import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState

from magat_evaluation.splits import SPLITS
from magat_expert import check_paths
from magat_robot.policy.models import find_policy

pytestmark = pytest.mark.system

CASE = SPLITS["test"][9]
#: So that what is lost costs tests little time.
HASTE = {"robot": {"feature_deadline": 0.03}, "simulator": {"tick_deadline": 0.2, "relay_deadline": 0.02}}


def assert_safe(recording):
    """Nobody has left the free cells, jumped, or collided, by the independent checker."""
    positions = recording.positions
    assert check_paths(recording.obstacles, positions[0], positions[-1], positions) == []


class At:
    """Feedback's callback that acts once at each of some ticks, or soon after."""

    def __init__(self, actions):
        self._actions = sorted(actions.items())
        self.results = []

    def __call__(self, feedback):
        while self._actions and feedback.t_max > 0 and feedback.tick >= self._actions[0][0]:
            self.results.append(self._actions.pop(0)[1]())

    @property
    def done(self):
        return not self._actions


def killed(team, name="robots", which=0):
    """An action: kill a process."""

    def kill():
        pid = sorted(team.processes.pids(name))[which]
        os.kill(pid, signal.SIGKILL)
        return pid

    return kill


def until_undisturbed(team, goal):
    """Episodes until one in which everybody takes part; that one."""
    for _ in range(10):
        outcome = team.run(goal)
        assert_safe(outcome.recording)
        if (outcome.result.silent, outcome.result.features_missing) == (0, 0):
            return outcome
    raise AssertionError(f"{outcome.result.silent} times silent, {outcome.result.features_missing} features missing")


# --- Processes ---


def stubborn(team, robots, t_max):
    """A case that lasts for ``t_max`` ticks: the way of each robot leads through all others, in a corridor."""
    goal = team.goal(0, width=2 * robots, height=1, obstacles=[0] * 2 * robots, t_max=t_max)
    goal.start_x, goal.start_y = list(range(robots)), [0] * robots
    goal.goal_x, goal.goal_y = list(range(robots))[::-1], [0] * robots
    return goal


@pytest.mark.parametrize(
    ("radio", "crew"),
    [
        ("direct", 1),
        pytest.param("relayed", 1, marks=pytest.mark.faults),
        pytest.param("relayed", 2, marks=pytest.mark.faults),
    ],
)
def test_robots_killed_in_mid_episode_are_started_again_and_take_part(start_team, radio, crew):
    with start_team(6, radio=radio, crew=crew, parameters=HASTE) as team:
        clean = until_undisturbed(team, team.goal(CASE))
        before = set(team.processes.pids("robots"))
        act = At({3: killed(team, which=0), 6: killed(team, which=1)})
        outcome = team.run(stubborn(team, 6, t_max=800), act)
        assert act.done
        assert_safe(outcome.recording)
        silent = np.array([world.silent for tick, world in sorted(outcome.recording.worlds.items()) if tick > 0])
        assert silent.any(axis=0).sum() >= 2 * crew
        assert not silent[-100:].all(axis=0).any(), "they are back before the episode is over"
        assert len(set(team.processes.pids("robots")) - before) == 2
        again = until_undisturbed(team, team.goal(CASE))
        np.testing.assert_array_equal(again.recording.positions, clean.recording.positions)


@pytest.mark.faults
def test_the_simulator_is_killed_and_the_episode_is_run_from_its_begin(start_team):
    with start_team(4) as team:
        goal = team.goal(CASE)
        clean = until_undisturbed(team, goal)
        act = At({5: killed(team, "simulator")})
        team.run(goal, act)
        assert act.done
        assert team.processes.starts("simulator") == 2
        assert team.has_said("simulator", "killed by signal 9, restarted")
        again = until_undisturbed(team, goal)
        np.testing.assert_array_equal(again.recording.positions, clean.recording.positions)


@pytest.mark.faults
def test_all_robots_are_killed_with_the_process_that_they_come_from(start_team):
    with start_team(4, parameters=HASTE) as team:
        goal = team.goal(CASE)
        clean = until_undisturbed(team, goal)
        parent = team.processes._running["robots"].pid
        act = At({5: lambda: os.kill(parent, signal.SIGKILL)})
        outcome = team.run(goal, act)
        assert_safe(outcome.recording)
        assert outcome.result.silent >= 8
        again = until_undisturbed(team, goal)
        np.testing.assert_array_equal(again.recording.positions, clean.recording.positions)


@pytest.mark.faults
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_expert_that_does_not_answer_is_asked_again(start_team, number):
    with start_team(2, parameters={"simulator": {"expert_time_limit": 0.5}}) as team:
        clean = until_undisturbed(team, team.goal(CASE))
        (expert,) = team.processes.pids("expert")
        os.kill(expert, signal.SIGSTOP)
        told = time.monotonic()
        woken = []

        def wake(_):
            # It was asked, and did not answer.
            if not woken and team.has_said("simulator", "the expert did not answer within 2.5 s: it is asked again"):
                os.kill(expert, signal.SIGCONT if number == signal.SIGSTOP else number)
                woken.append(expert)

        outcome = team.run(team.goal(CASE), wake)
        assert time.monotonic() - told > 2.5
        assert team.processes.starts("expert") == (2 if number == signal.SIGKILL else 1)
        np.testing.assert_array_equal(outcome.recording.positions, clean.recording.positions)
        assert outcome.result.delta_ft == clean.result.delta_ft


@pytest.mark.faults
def test_without_an_expert_an_episode_is_run_if_it_says_how_long(start_team):
    with start_team(2, parameters={"simulator": {"expert_time_limit": 0.5}}) as team:
        (expert,) = team.processes.pids("expert")
        os.kill(expert, signal.SIGSTOP)
        result = team.run(team.goal(CASE, t_max=40)).result
        assert result.ticks > 0
        assert np.isnan(result.delta_ft)
        os.kill(expert, signal.SIGCONT)


@pytest.mark.faults
def test_a_robot_that_comes_back_with_other_weights_is_named_and_takes_no_part(start_team):
    with start_team(3, parameters=HASTE, respawn=False, radio="relayed") as team:
        until_undisturbed(team, team.goal(CASE))
        victim = sorted(team.processes.pids("robots"))[0]
        other = find_policy("GNN-F-128")
        started = []

        def replace():
            os.kill(victim, signal.SIGKILL)
            parameters = ["-r", "__ns:=/robot_0", "-p", f"policy:={other}", "-p", "radio:=relayed"]
            command = [sys.executable, "-m", "magat_robot.node", "--ros-args", *parameters]
            started.append(subprocess.Popen(command, env=os.environ | team.environment))

        named = "robot_0: with another policy, encoding or radio than the team's, and takes no part"
        try:
            act = At({2: replace})
            outcome = team.run(stubborn(team, 3, t_max=1000), act)
            assert act.done
            assert_safe(outcome.recording)
            assert team.has_said("simulator", named), team.said
            assert not team.has_said("simulator", "robot_0 is back")
            silent = np.array([world.silent for tick, world in sorted(outcome.recording.worlds.items()) if tick > 4])
            assert silent[:, 0].all(), "to the end"
        finally:
            for process in started:
                process.terminate()
                process.wait(10)


def test_a_robot_that_is_deactivated_is_absent_until_it_is_activated(start_team):
    with start_team(3, parameters=HASTE) as team:
        node = team.client.node
        change = node.create_client(ChangeState, "/robot_1/robot/change_state")
        ask = node.create_client(GetState, "/robot_1/robot/get_state")
        assert team.client.spin(lambda: change.service_is_ready() and ask.service_is_ready(), 20.0)

        def changed(transition):
            future = change.call_async(ChangeState.Request(transition=Transition(id=transition)))
            assert team.client.spin(future.done, 10.0)
            asked = ask.call_async(GetState.Request())
            assert team.client.spin(asked.done, 10.0)
            return future.result().success, asked.result().current_state.id

        clean = until_undisturbed(team, team.goal(CASE))
        assert changed(Transition.TRANSITION_DEACTIVATE) == (True, State.PRIMARY_STATE_INACTIVE)
        outcome = team.run(team.goal(CASE))
        assert_safe(outcome.recording)
        assert all(world.silent[1] for tick, world in outcome.recording.worlds.items() if tick > 0)
        # Through all states and back.
        assert changed(Transition.TRANSITION_CLEANUP) == (True, State.PRIMARY_STATE_UNCONFIGURED)
        assert changed(Transition.TRANSITION_CONFIGURE) == (True, State.PRIMARY_STATE_INACTIVE)
        assert changed(Transition.TRANSITION_ACTIVATE) == (True, State.PRIMARY_STATE_ACTIVE)
        again = until_undisturbed(team, team.goal(CASE))
        np.testing.assert_array_equal(again.recording.positions, clean.recording.positions)


# --- The network ---


@pytest.mark.faults
@pytest.mark.parametrize(("radio", "topic"), [("direct", "feature"), ("relayed", "heard")])
def test_what_is_late_repeated_and_out_of_order_changes_nothing(start_team, radio, topic):
    with start_team(5, radio=radio) as team:
        clean = until_undisturbed(team, team.goal(CASE))
    faults = {name: {"repeated": 0.5, "delay": 0.03} for name in (topic, "observation", "preference")}
    with start_team(5, radio=radio, faults=faults) as team:
        outcome = until_undisturbed(team, team.goal(CASE))
        np.testing.assert_array_equal(outcome.recording.positions, clean.recording.positions)
        assert min(status.messages_dropped for status in team.statuses().values()) > 5, "what was repeated"


@pytest.mark.parametrize(
    ("share", "radio"),
    [
        (0.2, "direct"),
        *(
            pytest.param(share, radio, marks=pytest.mark.faults)
            for share, radio in ((0.1, "direct"), (0.5, "direct"), (0.2, "relayed"), (0.5, "relayed"))
        ),
    ],
)
def test_lost_features_are_counted_and_the_rest_is_used(start_team, share, radio):
    topic = {"direct": "feature", "relayed": "heard"}[radio]
    with start_team(6, radio=radio, faults={topic: {"lost": share}}, parameters=HASTE) as team:
        missing = ticks = links = silent = 0
        for number in range(3):
            outcome = team.run(team.goal(CASE + number, width=12, height=12))
            assert_safe(outcome.recording)
            worlds = outcome.recording.worlds
            links += sum(world.links for world in worlds.values())
            missing += outcome.result.features_missing
            silent += outcome.result.silent
            ticks += outcome.result.ticks
        assert share / 2 < missing / links < min(1.0, 1.6 * share + 0.05), (missing, links)
        assert silent < 0.1 * 6 * ticks, "a lost feature costs quality, never the step"


@pytest.mark.faults
@pytest.mark.parametrize("share", [0.2, 0.5])
def test_damaged_features_are_as_good_as_lost(start_team, share):
    with start_team(5, faults={"feature": {"damaged": share}}, parameters=HASTE) as team:
        outcome = team.run(team.goal(CASE, width=12, height=12))
        assert_safe(outcome.recording)
        assert outcome.result.features_missing > 0
        why = {re.sub(r"[\d.]+", "", status.last_drop) for status in team.statuses().values()}
        assert all(status.messages_dropped > 0 for status in team.statuses().values()), why


@pytest.mark.faults
@pytest.mark.parametrize("radio", ["direct", "relayed"])
@pytest.mark.parametrize("share", [0.2, 0.5])
def test_whatever_is_lost_the_episode_ends_and_says_so(start_team, share, radio):
    """On every topic of the tick, both ways."""
    topics = ("observation", "feature", "heard", "preference")
    faults = {topic: {"lost": share, "repeated": 0.1, "delay": 0.02} for topic in topics}
    with start_team(5, radio=radio, faults=faults, parameters=HASTE) as team:
        outcome = team.run(team.goal(CASE, width=12, height=12))
        assert_safe(outcome.recording)
        result = outcome.result
        assert result.silent > 0
        assert result.ticks <= result.t_max
        assert result.success == (result.p_rg == 1.0)
