# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulator node without a team: relayed messages, the request to the expert, and bad parameters."""

from unittest import mock

import pytest
import rclpy
from rclpy.parameter import Parameter
from team_secret import SECRET

from magat_bringup.environment import own_domain
from magat_interfaces.action import RunEpisode
from magat_interfaces.msg import Feature, Observation
from magat_node import cdr
from magat_sim.case import draw_case
from magat_sim.constants import EXPERT_W
from magat_sim.episode_states import EpisodeRequest, Gathering, Idle
from magat_sim.node import SimulatorNode

NAMES = ["a", "b", "c", "d"]
EPISODE = 7


class Recorder:
    """A fake publisher, and a fake timer."""

    def __init__(self):
        self.sent = []
        self.running = False

    def publish(self, message):
        self.sent.append(message)

    def reset(self):
        assert not self.running, "a running deadline must not be restarted"
        self.running = True

    def cancel(self):
        self.running = False

    def is_canceled(self):
        return not self.running


@pytest.fixture
def simulator():
    """A node in a tick with four robots in range of each other, of which d is absent; and their tags."""
    context = rclpy.Context()
    with own_domain() as domain:
        rclpy.init(args=[], context=context, domain_id=domain)
        parameters = [Parameter("robots", value=NAMES), Parameter("radio", value="relayed")]
        node = SimulatorNode(context=context, parameter_overrides=parameters)
        node._send, node._relay_to = ([Recorder() for _ in NAMES] for _ in range(2))
        node.destroy_timer(node._server.relay_deadline)
        node._server.relay_deadline = Recorder()
        for member in node._team.members[:3]:
            member.join()
        request = EpisodeRequest(
            EPISODE, draw_case(1, 0, 5, 5, 4), seed=1, number=0, t_max=9, expert_w=1.1, secret=bytes(32)
        )
        node._server._start(Gathering(None, request, begun=0.0), None, "")
        tags = [sender.sent[-1].own_tag if sender.sent else None for sender in node._send]
        assert tags[3] is None
        yield node, tags
        node.destroy_node()
        context.try_shutdown()


def send(simulator, robot, number=0, encoding=Feature.FLOAT16, **changes):
    node, tags = simulator
    fields = {"episode": EPISODE, "tick": 0, "round": number, "tag": tags[robot], "encoding": encoding}
    feature = cdr.PackedFeature(**fields, payload=bytes([robot, number]))._replace(**changes)
    node._on_feature(cdr.pack_feature(*feature))


def relayed(simulator):
    """The bundles of each robot since the last call: round, encoding, payloads."""
    result = []
    for publisher in simulator[0]._relay_to:
        bundles = [cdr.unpack_bundle(data) for data in publisher.sent]
        publisher.sent = []
        for bundle in bundles:
            assert (bundle.episode, bundle.tick) == (EPISODE, 0)
            assert len(bundle.payloads) == 2 * bundle.messages
        split = [sorted(b.payloads[i : i + 2] for i in range(0, len(b.payloads), 2)) for b in bundles]
        result.append([(b.round, b.encoding, parts) for b, parts in zip(bundles, split, strict=True)])
    return result


def test_a_round_is_relayed_when_the_messages_of_all_participants_are_there(simulator):
    node, _ = simulator
    for number in range(3):
        for robot in (2, 0):
            send(simulator, robot, number)
            assert relayed(simulator) == [[]] * 4
            assert node._server.relay_deadline.running, "it runs from the first message on"
        send(simulator, 1, number)
        others = [[bytes([j, number]) for j in range(3) if j != i] for i in range(3)]
        assert relayed(simulator) == [*[[(number, Feature.FLOAT16, parts)] for parts in others], []]
        assert not node._server.relay_deadline.running


def test_at_the_deadline_the_messages_so_far_are_relayed(simulator):
    node, _ = simulator
    send(simulator, 1)
    node._server.end_round()
    assert relayed(simulator) == [[(0, 1, [b"\1\0"])], [(0, 1, [])], [(0, 1, [b"\1\0"])], []]
    assert not node._server.relay_deadline.running
    send(simulator, 0)  # late: this round is over
    assert not node._server.relay_deadline.running
    send(simulator, 0, number=1)
    assert node._server.relay_deadline.running
    assert relayed(simulator) == [[]] * 4


@pytest.mark.parametrize(
    "changes",
    [
        {"episode": EPISODE + 1},
        {"tick": 1},
        {"tick": Observation.HELLO},
        {"round": 1},
        {"tag": 5},
    ],
    ids=["another episode", "another tick", "a hello", "another round", "an unknown tag"],
)
def test_messages_that_cannot_be_used_are_neither_relayed_nor_counted(simulator, changes):
    node, _ = simulator
    send(simulator, 0, **changes)
    assert not node._server.relay_deadline.running
    for robot in range(3):
        send(simulator, robot)
    assert [len(bundles) for bundles in relayed(simulator)] == [1, 1, 1, 0]


def test_damaged_messages_are_ignored(simulator):
    node, _ = simulator
    for data in (b"", b"abc", cdr.pack_feature(EPISODE, 0, 0, simulator[1][0], 0, b"xy")[:-1]):
        node._on_feature(data)
    assert not node._server.relay_deadline.running
    send(simulator, 0, encoding=99, payload=b"of another kind")
    send(simulator, 1)
    assert relayed(simulator) == [[]] * 4
    send(simulator, 2)
    assert relayed(simulator) == [[(0, 1, [b"\1\0", b"\2\0"])], [(0, 1, [b"\2\0"])], [(0, 1, [b"\1\0"])], []]


def test_nothing_is_relayed_between_episodes(simulator):
    node, _ = simulator
    node._server.state = Idle()
    send(simulator, 0)
    node._server.end_round()
    assert relayed(simulator) == [[]] * 4
    assert not node._server.relay_deadline.running


def test_an_unknown_radio_is_refused():
    context = rclpy.Context()
    with own_domain() as domain:
        rclpy.init(args=[], context=context, domain_id=domain)
        parameters = [Parameter("robots", value=NAMES), Parameter("radio", value="pigeon")]
        try:
            with pytest.raises(ValueError, match=r"radio is 'pigeon': choose one of \['direct', 'relayed'\]"):
                SimulatorNode(context=context, parameter_overrides=parameters)
        finally:
            context.try_shutdown()


@pytest.mark.parametrize(("given", "asked"), [(5.0, 5.0), (0.0, EXPERT_W)])
def test_the_expert_is_asked_with_the_bound_of_the_goal(simulator, given, asked):
    """Else a team on a large case would have another T_max than the batched simulator."""
    node, _ = simulator
    node._server.state = Idle()
    for member in node._team.members:
        member.join()
    node._solve = mock.Mock()
    node._begin(mock.Mock(request=RunEpisode.Goal(seed=1, width=5, height=5, expert_w=given), cancel_requested=False))
    (request,) = node._solve.call_async.call_args.args
    assert request.w == asked
    assert len(request.start_x) == len(NAMES)


def begin(simulator, **fields):
    """The goal of an episode, for which all robots are there and the expert is asked."""
    node, _ = simulator
    node._server.state = Idle()
    for member in node._team.members:
        member.join()
    node._solve = mock.Mock()
    running = mock.Mock(request=RunEpisode.Goal(seed=1, width=5, height=5, **fields), cancel_requested=False)
    node._begin(running)
    return running


def test_the_streams_of_an_episode_follow_from_the_secret_of_its_goal(simulator):
    begin(simulator, secret=SECRET)
    assert simulator[0]._server.state.gathered.request.secret == SECRET


def test_a_goal_without_a_secret_gets_a_new_one_each_time(simulator):
    drawn = set()
    for _ in range(3):
        begin(simulator)
        drawn.add(simulator[0]._server.state.gathered.request.secret)
    assert len(drawn) == 3
    assert {len(secret) for secret in drawn} == {32}


@pytest.mark.parametrize("length", [1, 31, 33])
def test_a_secret_of_another_length_is_refused(simulator, length):
    running = begin(simulator, secret=bytes(length))
    (result,) = running.abort.call_args.args
    assert result.error == f"the secret has {length} bytes: give 32, or none, to have one drawn"
    assert isinstance(simulator[0]._server.state, Idle)


def test_hellos_go_out_in_random_order(simulator):
    node, _ = simulator
    orders, sent = set(), []
    for robot in range(len(NAMES)):
        node._send[robot] = mock.Mock(publish=lambda _, robot=robot: sent.append(robot))
    for member in node._team.members:
        member.leave()
    for _ in range(100):
        sent.clear()
        node._on_beat()
        orders.add(tuple(sent))
    assert all(sorted(order) == [0, 1, 2, 3] for order in orders)
    assert len(orders) > 12  # of 24; the chance of 12 or fewer is below one in a million million
