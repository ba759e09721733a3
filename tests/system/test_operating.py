# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nodes alone, as an operator handles them: parameters, logs, lifecycle, and what their end tells others."""

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest
import rclpy
from lifecycle_msgs.msg import State
from rcl_interfaces.msg import Log
from rclpy.action import ActionClient
from rclpy.parameter import Parameter

from magat_bringup.environment import loopback, own_domain
from magat_interfaces.action import DeployPolicy, RunEpisode
from magat_node.errors import MagatError
from magat_node.topics import ROBOT_STATUS
from magat_node.visitor import Visitor
from magat_robot.node import RobotNode
from magat_robot.policy.config import ENCODINGS
from magat_robot.policy.store import save
from magat_sim.case import draw_case
from magat_sim.episode_server import EpisodeServer
from magat_sim.episode_states import CANCELLED, EpisodeEnd, EpisodeRequest, Gathering
from magat_sim.node import SETTABLE, SimulatorNode, _result

CLIENT_TIMEOUT = 20.0


@pytest.fixture
def context(monkeypatch) -> Iterator[rclpy.Context]:
    with own_domain() as domain:
        for name, value in loopback(domain).items():
            monkeypatch.setenv(name, value)
        context = rclpy.Context()
        rclpy.init(args=[], context=context, domain_id=domain)
        yield context
        context.try_shutdown()


@pytest.fixture
def simulator(context) -> Iterator[SimulatorNode]:
    node = SimulatorNode(context=context, parameter_overrides=[Parameter("robots", value=["a", "b"])])
    yield node
    node.destroy_node()


def reason(node: object, name: str, value: object) -> str:
    """Why a parameter cannot be set; empty if it was."""
    (result,) = node.set_parameters([Parameter(name, value=value)])
    return result.reason


def begin(server: EpisodeServer) -> None:
    """Let an episode wait for its robots, for nobody."""
    request = EpisodeRequest(7, draw_case(1, 0, 5, 5, 2), 1, 0, 9, 1.1, bytes(32))
    server.state = Gathering(None, request, time.monotonic())


# --- The simulator ---


def test_rules_and_deadlines_of_the_simulator_are_set_between_episodes_only(simulator):
    values = {
        "shield": "pibt",
        "link_loss": 0.25,
        "tick_deadline": 2,
        "relay_deadline": 0.5,
        "ready_timeout": 9.0,
        "expert_time_limit": 3.0,
        "deploy_timeout": 4.0,
    }
    assert set(values) == set(SETTABLE)
    begin(simulator._server)
    for name, value in values.items():
        assert reason(simulator, name, value).startswith(f"{name}: can be set between episodes only")
    simulator._server.state = type(simulator._server).__dataclass_fields__["state"].default_factory()
    for name, value in values.items():
        assert reason(simulator, name, value) == ""
        assert simulator.get_parameter(name).value == value
    assert (simulator._server.rules.shield, simulator._server.rules.link_loss) == ("pibt", 0.25)
    limits = simulator._server.limits
    assert (limits.ready_timeout, limits.expert_time_limit, limits.relay_deadline) == (9.0, 3.0, 0.5)
    assert simulator._server.tick_deadline.timer_period_ns == 2_000_000_000
    assert simulator._deployments.patience == 4.0
    assert "there is no shield 'none': choose one of" in reason(simulator, "shield", "none")
    assert "out of range" in reason(simulator, "link_loss", 1.5)
    assert "read-only" in reason(simulator, "radio", "relayed")


@pytest.mark.parametrize("name", ["red/a", "a__b", "yes"])
def test_a_simulator_for_robots_that_cannot_be_says_why(context, name):
    with pytest.raises(MagatError, match=f"the robot name '{name}' is invalid"):
        SimulatorNode(context=context, parameter_overrides=[Parameter("robots", value=["a", name])])


def test_what_a_cancelled_episode_would_have_measured_is_not_a_number(simulator):
    server = simulator._server
    request = EpisodeRequest(7, draw_case(1, 0, 5, 5, 2), 1, 0, 9, 1.1, bytes(32))
    server._start(Gathering(None, request, 0.0), None, "")
    whole, cut = (_result(EpisodeEnd(7, error, server.state, 1.0)) for error in ("", CANCELLED))
    assert cut.error == CANCELLED
    assert (cut.t_max, cut.ticks) == (9, 0)
    assert math.isnan(cut.delta_ft)
    assert math.isnan(cut.delta_ft_strict)
    assert whole.t_max == 9
    server.stop = lambda why: False


def test_a_simulator_that_is_told_to_end_aborts_what_it_does_and_says_so(monkeypatch):
    with own_domain() as domain:
        for name, value in loopback(domain).items():
            monkeypatch.setenv(name, value)
        with (
            subprocess.Popen([sys.executable, "-m", "magat_sim.node"], env=os.environ) as process,
            Visitor("client", domain=domain) as client,
        ):
            said: list[str] = []
            client.node.create_subscription(Log, "/rosout", lambda log: said.append(log.msg), 100)
            actions = {
                kind: ActionClient(client.node, kind, name)
                for kind, name in ((RunEpisode, "run_episode"), (DeployPolicy, "deploy_policy"))
            }
            assert client.spin(lambda: all(action.server_is_ready() for action in actions.values()), CLIENT_TIMEOUT)

            def ask(kind: type, **fields: object) -> object:
                accepted = actions[kind].send_goal_async(kind.Goal(**fields))
                assert client.spin(accepted.done, CLIENT_TIMEOUT)
                return accepted.result()

            size = {"width": 9, "height": 9}
            results = [handle.get_result_async() for handle in (ask(RunEpisode, **size), ask(DeployPolicy))]
            assert not ask(RunEpisode, **size).accepted  # busy
            process.send_signal(signal.SIGINT)
            assert client.spin(lambda: all(result.done() for result in results), CLIENT_TIMEOUT)
            errors = [result.result().result.error for result in results]
            assert all(error.startswith("the simulator was told to end") for error in errors)
            assert process.wait(CLIENT_TIMEOUT) == 0
            expected = ("run_episode: rejected a goal", "was aborted: the simulator was told to end")
            assert client.spin(lambda: all(any(part in line for line in said) for part in expected), 5.0), said


# --- A robot ---


@pytest.fixture
def robot(context, random_network, tmp_path) -> Iterator[Callable[..., RobotNode]]:
    """Makes robots; their policy sends 16 numbers a message."""
    folder = tmp_path / "policy"
    save(random_network("MAGAT-F-16"), folder, "")
    made = []

    def make(**parameters: object) -> RobotNode:
        given = {"policy": str(folder), "backend": "torch"} | parameters
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        made.append(RobotNode(context=context, namespace="/red/alice", parameter_overrides=overrides))
        return made[-1]

    yield make
    for node in made:
        node.destroy_node()


def test_the_parameters_of_a_robot_show_what_holds(robot):
    alice = robot()
    config = alice._slot.policy.config
    assert alice.get_parameter("robots").value == ["alice"]
    assert alice.get_parameter("encoding").value == config.encoding
    assert alice.get_parameter("encoding").value in ENCODINGS
    assert alice.get_parameter("max_payload").value == alice._slot.max_payload > 0
    for name, value in (("encoding", "int8"), ("robots", ["bob"]), ("max_payload", 9)):
        assert reason(alice, name, value) == f"{name}: fixed while the node runs"
    # A second configuration starts from what was given, not from what was shown.
    alice.trigger_deactivate()
    alice.trigger_cleanup()
    alice.trigger_configure()
    assert alice.get_parameter("encoding").value == config.encoding


def test_the_deadline_of_a_robot_is_set_between_episodes_only(robot):
    alice = robot(feature_deadline=1)
    assert alice._deadline.timer_period_ns == 1_000_000_000
    assert reason(alice, "feature_deadline", 2) == ""
    assert alice._deadline.timer_period_ns == 2_000_000_000
    alice._last_observed = time.monotonic()
    assert reason(alice, "feature_deadline", 3.0).startswith("feature_deadline: can be set between episodes only")
    alice.trigger_deactivate()
    assert reason(alice, "feature_deadline", 3.0) == ""
    alice.trigger_activate()
    assert alice._deadline.timer_period_ns == 3_000_000_000


@pytest.mark.parametrize("active", [True, False])
def test_a_robot_that_is_shut_down_leaves_its_team(robot, active):
    alice = robot(autostart=active)
    topics = {end.topic_name for end in (*alice.publishers, *alice.subscriptions)}
    assert (f"/red/{ROBOT_STATUS.name()}" in topics) == active
    alice.trigger_shutdown()
    topics = {end.topic_name for end in (*alice.publishers, *alice.subscriptions)}
    assert not [topic for topic in topics if topic.startswith("/red") and "transition" not in topic]
    assert [timer for timer in alice.timers if not timer.is_canceled()] == []
    assert alice._state_machine.current_state[0] == State.PRIMARY_STATE_FINALIZED
