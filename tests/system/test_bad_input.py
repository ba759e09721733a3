# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages from foreign processes and wrong requests do no harm: paths do not change, errors are clear."""

import array
import collections
import os
import re
import subprocess
import sys
import types

import numpy as np
import pytest

from magat_bringup.client import EpisodeClient
from magat_bringup.environment import loopback, own_domain
from magat_evaluation.splits import SPLITS
from magat_interfaces.action import RunEpisode
from magat_interfaces.msg import Feature, FeatureBundle, Observation, Preference, RobotStatus
from magat_interfaces.srv import SolveMapf
from magat_node import cdr, qos
from magat_node.errors import TeamError

pytestmark = pytest.mark.system

CASE = SPLITS["test"][8]


class Guest:
    """Speaks and listens beside a team, in a ``with`` statement: at its end nothing of it is left in the domain."""

    def __init__(self, client):
        self._client, self._node = client, client.node
        self._before = self._ends()

    def _ends(self):
        return [*self._node.publishers], [*self._node.subscriptions], [*self._node.timers]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        destroy = (self._node.destroy_publisher, self._node.destroy_subscription, self._node.destroy_timer)
        for end, now, before in zip(destroy, self._ends(), self._before, strict=True):
            for one in now:
                if one not in before:
                    end(one)
        self._client.spin(lambda: False, 0.3)  # the executor lets go of them the next time that it works


class Saboteur(Guest):
    """Answers every message that it overhears with bad ones, as fast as they come."""

    def __init__(self, team):
        super().__init__(team.client)
        node = team.client.node
        self.sent = collections.Counter()
        self.status = {}
        self._rng = np.random.default_rng(0)
        depth = qos.newest(4096)
        self._feature = node.create_publisher(Feature, "/feature", depth)
        self._preference = node.create_publisher(Preference, "/preference", depth)
        self._observation = node.create_publisher(Observation, "/robot_0/observation", depth)
        self._heard = node.create_publisher(FeatureBundle, "/robot_0/heard", depth)
        # It hears its own messages too, and some of them nobody can read.
        node.create_subscription(Feature, "/feature", self._on_feature, depth, raw=True)
        node.create_subscription(FeatureBundle, "/robot_0/heard", self._on_heard, depth, raw=True)
        node.create_subscription(Observation, "/robot_0/observation", self._on_observation, depth)
        node.create_subscription(RobotStatus, "/robot_status", self._on_status, qos.reliable(100))

    def _on_status(self, message):
        for name in message.robots:
            self.status[name] = message

    def _on_feature(self, data):
        heard = cdr.unpack_feature(data)
        if heard is None or heard.tick == Observation.HELLO or heard.encoding == 99 or len(heard.payload) != 512:
            return
        # The tag is taken by the time this comes: a repetition, and with another payload to boot.
        if heard.tag in self.sent:
            return
        self.sent[heard.tag] += 1

        def send(kind, **changes):
            message = heard._replace(**changes)
            self.sent[message.tag] += 1  # or it would answer its own messages
            self._feature.publish(cdr.pack_feature(*message))
            self.sent[kind] += 1

        send("repeated")
        send("late", tick=max(heard.tick - 3, 0), tag=int(self._rng.integers(2**63)))
        send("early", tick=heard.tick + 1000, tag=int(self._rng.integers(2**63)))
        send("foreign", episode=heard.episode + 1, tag=int(self._rng.integers(2**63)))
        send("short", payload=b"abc")
        send("empty", payload=b"")
        send("nan", payload=np.full(128, np.nan, "<f4").tobytes())
        send("huge", payload=np.full(128, 1e30, "<f4").tobytes())
        send("encoding", encoding=99)
        send("round", round=1)
        send("round", round=7)
        send("hello", episode=0, tick=Observation.HELLO, payload=b"\xff" * 4)
        send("hello", episode=0, tick=Observation.HELLO, payload=b"")
        for damaged in (data[:20], data[:-1], b"", b"\0\0\0\0" + data[4:], b"\xff" * 600):
            self._feature.publish(damaged)
        for wrong in (
            Preference(episode=heard.episode, tick=heard.tick, tag=heard.tag + 1, primitive=3),
            Preference(episode=heard.episode + 1, tick=heard.tick, tag=heard.tag, primitive=3),
            Preference(episode=heard.episode, tick=heard.tick + 1, tag=heard.tag, primitive=3),
            Preference(episode=heard.episode, tick=heard.tick, tag=heard.tag, primitive=200),
        ):
            self._preference.publish(wrong)

    def _on_heard(self, data):
        heard = cdr.unpack_bundle(data)
        if heard is None or heard.encoding == 99 or heard.round or (heard.episode, heard.tick) in self.sent:
            return
        self.sent[heard.episode, heard.tick] += 1
        # What robot 0 heard is there by the time these come.
        for number, encoding, payloads in ((0, 0, []), (0, 0, [bytes(512)]), (1, 0, []), (0, 99, [bytes(512)])):
            self._heard.publish(cdr.pack_bundle(heard.episode, heard.tick, number, encoding, payloads))
        self._heard.publish(data[:-1])
        self.sent["bundle"] += 1

    def _on_observation(self, heard):
        if heard.tick == Observation.HELLO or len(heard.field_of_view) != 363 or heard.tick in self.sent:
            return
        self.sent[heard.tick] += 1
        self._observation.publish(heard)  # repeated
        heard.field_of_view = array.array("B", bytes(5))
        self._observation.publish(heard)
        self.sent["observation"] += 1


@pytest.mark.parametrize(("radio", "crew"), [("direct", 1), pytest.param("relayed", 2, marks=pytest.mark.faults)])
def test_a_saboteur_on_every_topic_changes_nothing(start_team, radio, crew):
    with start_team(4, radio=radio, crew=crew) as team:
        goal = team.goal(CASE)
        clean = team.run_undisturbed(goal)
        # What is relayed the simulator drops, for all of them; robot_0 is sent bad bundles, too.
        harassed = [f"robot_{i}" for i in range(4 if radio == "direct" else crew)]
        with Saboteur(team) as saboteur:

            def reached():
                status = saboteur.status
                return all(name in status and status[name].messages_dropped > 5 for name in harassed)

            # Its messages reach robots only once it is matched with them.
            episodes = 0
            while episodes < 3 or (episodes < 15 and not team.client.spin(reached, 1.5)):
                outcome = team.run_undisturbed(goal)
                assert (outcome.result.silent, outcome.result.features_missing) == (0, 0)
                np.testing.assert_array_equal(outcome.recording.positions, clean.recording.positions)
                episodes += 1
            assert reached(), saboteur.status
            assert min(saboteur.sent[kind] for kind in ("repeated", "nan", "short", "hello", "observation")) > 5
            assert saboteur.sent["bundle"] > 5 or radio == "direct"


def test_no_hello_makes_a_robot_hear_fewer_others(team):
    """Whatever number of robots a foreign process claims to carry."""
    most = 2**32 - 1
    with Guest(team.client):
        stranger = team.client.node.create_publisher(Feature, "/feature", qos.newest(10))
        assert team.client.spin(lambda: stranger.get_subscription_count() == team.robots, 20.0)

        def counted():
            stranger.publish(cdr.pack_feature(0, Observation.HELLO, 0, 5, 0, most.to_bytes(4, "little")))
            return {status.peers_heard for status in team.statuses().values()} == {most}

        assert team.client.spin(counted, 20.0)


@pytest.fixture
def lone_simulator():
    """A simulator of three robots without robot processes; yields a client."""
    with own_domain() as domain:
        environment = os.environ | loopback(domain)
        environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
        parameters = ["-p", "robots:=[alice, bob, carol]", "-p", "ready_timeout:=1.5"]
        command = [sys.executable, "-m", "magat_sim.node", "--ros-args", *parameters]
        with subprocess.Popen(command, env=environment) as process:
            watched = types.SimpleNamespace(check=lambda: None, starts=lambda name: 1)
            try:
                with EpisodeClient(watched, domain) as client:
                    client.wait_for_simulator()
                    yield client
            finally:
                process.terminate()


class Pretender(Guest):
    """Says hello for three robots, and what they carry; bob's equipment may differ."""

    def __init__(self, client):
        super().__init__(client)
        node = client.node
        self.differs = {}
        self._answer = node.create_publisher(Preference, "/preference", qos.newest(10))
        self._report = node.create_publisher(RobotStatus, "/robot_status", qos.reliable(10))
        for name in ("alice", "bob", "carol"):
            node.create_subscription(Observation, f"/{name}/observation", self._on_hello, qos.newest(10))
        node.create_timer(0.1, self._on_beat)

    def _on_hello(self, hello):
        self._answer.publish(Preference(tick=Observation.HELLO, tag=hello.own_tag))

    def _on_beat(self):
        equipment = {"digest": "0" * 64, "encoding": "float32", "radio": "direct", "peers_heard": 2}
        self._report.publish(RobotStatus(robots=["alice", "carol"], **equipment))
        self._report.publish(RobotStatus(robots=["bob"], **equipment | self.differs))


def test_robots_that_do_not_fit_together_are_refused_by_name(lone_simulator):
    goal = RunEpisode.Goal(seed=1, number=0, width=9, height=9, density=0.1, t_max=2)
    zeros = "0" * 12

    def refused():
        try:
            assert lone_simulator.run(goal, lambda _: None).result.ticks == 2
        except TeamError as error:
            return str(error)
        return "all is well"

    def says(said, pretender, **differs):
        pretender.differs = differs
        # The simulator may not have heard of it yet.
        return lone_simulator.spin(lambda: re.search(said, refused()), 20.0)

    others = f"does not fit together .*radio is direct; alice, carol: policy {zeros}, float32, direct radio; bob: "
    with Pretender(lone_simulator) as pretender:
        # It is deaf, and the reason is given with its name.
        deaf = f"not there after 1.5 s: bob; .*{others}policy {zeros}, float32, relayed radio"
        assert says(deaf, pretender, radio="relayed", peers_heard=0)
        assert says(f"{others}policy {zeros}, int8, direct radio", pretender, encoding="int8")
        assert says(f"{others}policy {'1' * 12}, float32, direct radio", pretender, digest="1" * 64)
        assert says("all is well", pretender)


def test_an_impossible_case_is_answered_with_its_reason(team):
    goal = team.goal(0, obstacles=[0] * 400)
    goal.start_x, goal.start_y = [0] * 10, [0] * 10
    goal.goal_x, goal.goal_y = list(range(10)), [5] * 10
    with pytest.raises(TeamError, match=r"robots 0 and 1 share the start \(0, 0\)"):
        team.run(goal)
    goal.start_x = list(range(9))
    with pytest.raises(TeamError, match="for a team of 10"):
        team.run(goal)
    for density in (-1.0, float("nan"), float("inf")):
        with pytest.raises(TeamError, match=r"the obstacle density is .*: give a share"):
            team.run(team.goal(0, density=density))
    with pytest.raises(TeamError, match="do not fit"):
        team.run(team.goal(0, density=0.99))
    with pytest.raises(TeamError, match="a map of 0x20 cells has no cells"):
        team.run(team.goal(0, width=0))
    with pytest.raises(TeamError, match="65535x65535 cells is too large"):
        team.run(team.goal(0, width=65535, height=65535))
    assert team.run(team.goal(CASE)).result.ticks > 0, "the simulator goes on"


def test_a_case_the_expert_cannot_solve_in_time_is_answered_with_its_reason(team):
    """A corridor in which ten robots would have to turn around in place."""
    goal = team.goal(0, width=12, height=1, obstacles=[0] * 12)
    goal.start_x, goal.start_y = list(range(10)), [0] * 10
    goal.goal_x, goal.goal_y = list(range(9, -1, -1)), [0] * 10
    with pytest.raises(TeamError, match="no makespan"):
        team.run(goal)


def test_with_a_given_t_max_it_is_run_without_the_expert(team):
    goal = team.goal(0, width=12, height=1, obstacles=[0] * 12, t_max=5)
    goal.start_x, goal.start_y = list(range(10)), [0] * 10
    goal.goal_x, goal.goal_y = list(range(9, -1, -1)), [0] * 10
    result = team.run(goal).result
    assert (result.ticks, result.t_max, result.success) == (5, 5, False)
    assert np.isnan(result.delta_ft)


@pytest.fixture(scope="module")
def ask_expert(team):
    client = team.client.node.create_client(SolveMapf, "/solve_mapf")
    assert team.client.spin(client.service_is_ready, 20.0)

    def ask(**fields) -> SolveMapf.Response:
        request = SolveMapf.Request(width=3, height=3, obstacles=[0] * 9, w=1.1, time_limit=1.0)
        request.start_x, request.start_y, request.goal_x, request.goal_y = [0, 2], [0, 0], [2, 0], [0, 0]
        for name, value in fields.items():
            setattr(request, name, value)
        future = client.call_async(request)
        assert team.client.spin(future.done, 20.0)
        return future.result()

    return ask


def test_the_expert_solves(ask_expert):
    answer = ask_expert()
    assert answer.status == SolveMapf.Response.SOLVED
    paths = np.stack([answer.path_x, answer.path_y], axis=-1).reshape(answer.makespan + 1, 2, 2)
    np.testing.assert_array_equal(paths[-1], [[2, 0], [0, 0]])
    assert answer.cost <= 1.1 * answer.lower_bound


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"obstacles": [0] * 5}, "3 x 3"),
        ({"start_x": [0]}, "differ in length"),
        ({"start_x": [0, 0]}, "start"),
        ({"start_x": [0, 9]}, "start"),
        ({"w": 0.5}, "w"),
        ({"w": float("nan")}, "w"),
        ({"time_limit": -1.0}, "time_limit"),
    ],
)
def test_the_expert_answers_a_bad_request_and_goes_on(ask_expert, fields, said):
    answer = ask_expert(**fields)
    assert answer.status == SolveMapf.Response.INVALID
    assert said in answer.message
    assert ask_expert().status == SolveMapf.Response.SOLVED


def test_the_experts_time_limit_holds(ask_expert):
    corridor = {"width": 12, "height": 1, "obstacles": [0] * 12}
    corridor |= {"start_x": list(range(8)), "goal_x": list(range(7, -1, -1))}
    answer = ask_expert(**corridor, start_y=[0] * 8, goal_y=[0] * 8, time_limit=0.5)
    assert answer.status in (SolveMapf.Response.TIMED_OUT, SolveMapf.Response.NO_SOLUTION)
    assert answer.time < 0.7
