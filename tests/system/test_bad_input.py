"""What strangers send, or the wrong requests, harms nobody: paths stay what they were, errors are clear."""

import array
import collections

import numpy as np
import pytest

from magat_bringup.processes import TeamError
from magat_interfaces.msg import Feature, Observation, Preference, RobotStatus
from magat_interfaces.srv import SolveMapf
from magat_node import qos
from magat_training.cases import SPLITS

pytestmark = pytest.mark.system

CASE = SPLITS["test"][8]


class Saboteur:
    """Answers every message that it overhears with bad ones, as fast as they come."""

    def __init__(self, team):
        node = team.client.node
        self.sent = collections.Counter()
        self.status = {}
        self._rng = np.random.default_rng(0)
        depth = qos.newest(4096)
        self._feature = node.create_publisher(Feature, "/feature", depth)
        self._preference = node.create_publisher(Preference, "/preference", depth)
        self._observation = node.create_publisher(Observation, "/robot_0/observation", depth)
        node.create_subscription(Feature, "/feature", self._on_feature, depth)
        node.create_subscription(Observation, "/robot_0/observation", self._on_observation, depth)
        node.create_subscription(RobotStatus, "/robot_status", self._on_status, qos.reliable(100))

    def _on_status(self, message):
        self.status[message.robot] = message

    def _on_feature(self, heard):
        if heard.tick == Observation.HELLO or heard.encoding == 99 or len(heard.payload) != 512:
            return
        # The tag is taken by the time this comes: a repetition, and with another payload to boot.
        if heard.tag in self.sent:
            return
        self.sent[heard.tag] += 1

        def send(kind, **changes):
            message = Feature(episode=heard.episode, tick=heard.tick, tag=heard.tag, payload=heard.payload)
            for name, value in changes.items():
                setattr(message, name, value)
            self.sent[message.tag] += 1  # it hears its own messages too, and must not answer them
            self._feature.publish(message)
            self.sent[kind] += 1

        send("repeated")
        send("late", tick=max(heard.tick - 3, 0), tag=int(self._rng.integers(2**63)))
        send("early", tick=heard.tick + 1000, tag=int(self._rng.integers(2**63)))
        send("foreign", episode=heard.episode + 1, tag=int(self._rng.integers(2**63)))
        send("short", payload=array.array("B", b"abc"))
        send("empty", payload=array.array("B"))
        send("nan", payload=array.array("B", np.full(128, np.nan, "<f4").tobytes()))
        send("huge", payload=array.array("B", np.full(128, 1e30, "<f4").tobytes()))
        send("encoding", encoding=99)
        send("round", round=7)
        for wrong in (
            Preference(episode=heard.episode, tick=heard.tick, tag=heard.tag + 1, primitive=3),
            Preference(episode=heard.episode + 1, tick=heard.tick, tag=heard.tag, primitive=3),
            Preference(episode=heard.episode, tick=heard.tick + 1, tag=heard.tag, primitive=3),
            Preference(episode=heard.episode, tick=heard.tick, tag=heard.tag, primitive=200),
        ):
            self._preference.publish(wrong)

    def _on_observation(self, heard):
        if heard.tick == Observation.HELLO or len(heard.field_of_view) != 363 or heard.tick in self.sent:
            return
        self.sent[heard.tick] += 1
        self._observation.publish(heard)  # repeated
        heard.field_of_view = array.array("B", bytes(5))
        self._observation.publish(heard)
        self.sent["observation"] += 1


def test_a_saboteur_on_every_topic_changes_nothing(start_team):
    with start_team(4) as team:
        goal = team.goal(CASE)
        clean = team.run(goal)
        saboteur = Saboteur(team)
        # The saboteur's copies reach robots only once it is matched with them; its own tags prove that it heard them.
        for _ in range(5):
            harassed = team.run(goal)
            assert (harassed.result.silent, harassed.result.features_missing) == (0, 0)
            np.testing.assert_array_equal(harassed.recording.positions, clean.recording.positions)
        assert min(saboteur.sent[kind] for kind in ("repeated", "nan", "short", "observation")) > 5
        assert team.client.spin(
            lambda: len(saboteur.status) == 4 and all(s.messages_dropped > 5 for s in saboteur.status.values()), 20.0
        )


def test_an_impossible_case_is_answered_with_its_reason(team):
    goal = team.goal(0, obstacles=[0] * 400)
    goal.start_x, goal.start_y = [0] * 10, [0] * 10
    goal.goal_x, goal.goal_y = list(range(10)), [5] * 10
    with pytest.raises(TeamError, match=r"robots 0 and 1 share the start \(0, 0\)"):
        team.run(goal)
    goal.start_x = list(range(9))
    with pytest.raises(TeamError, match="for a team of 10"):
        team.run(goal)
    for density in (0.99, -1.0, float("nan"), float("inf")):
        with pytest.raises(TeamError, match="do not fit"):
            team.run(team.goal(0, density=density))
    with pytest.raises(TeamError, match="do not fit"):
        team.run(team.goal(0, width=0))
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
