"""What the simulator's node makes of messages to be relayed: one node, with nobody there."""

from unittest import mock

import pytest
import rclpy
from rclpy.parameter import Parameter

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
    """In place of a publisher, or of the timer of the deadline."""

    def __init__(self):
        self.said = []
        self.running = False

    def publish(self, message):
        self.said.append(message)

    def reset(self):
        assert not self.running, "a deadline must not be put off"
        self.running = True

    def cancel(self):
        self.running = False

    def is_canceled(self):
        return not self.running


@pytest.fixture
def simulator():
    """A node that has begun a tick of four robots that hear each other, but for d, which is absent; and their tags."""
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
        request = EpisodeRequest(EPISODE, draw_case(1, 0, 5, 5, 4), seed=1, number=0, t_max=9, expert_w=1.1)
        node._server._start(Gathering(None, request, begun=0.0), None, "")
        tags = [sender.said[-1].own_tag if sender.said else None for sender in node._send]
        assert tags[3] is None
        yield node, tags
        node.destroy_node()
        context.try_shutdown()


def send(simulator, robot, number=0, encoding=Feature.FLOAT16, **changes):
    node, tags = simulator
    fields = {"episode": EPISODE, "tick": 0, "round": number, "tag": tags[robot], "encoding": encoding}
    feature = cdr.PackedFeature(**fields, payload=bytes([robot, number]))._replace(**changes)
    node._on_feature(cdr.pack_feature(*feature))


def handed_on(simulator):
    """The bundles of each robot since it was last asked: round, encoding, payloads."""
    result = []
    for publisher in simulator[0]._relay_to:
        bundles = [cdr.unpack_bundle(data) for data in publisher.said]
        publisher.said = []
        for bundle in bundles:
            assert (bundle.episode, bundle.tick) == (EPISODE, 0)
            assert len(bundle.payloads) == 2 * bundle.messages
        split = [sorted(b.payloads[i : i + 2] for i in range(0, len(b.payloads), 2)) for b in bundles]
        result.append([(b.round, b.encoding, parts) for b, parts in zip(bundles, split, strict=True)])
    return result


def test_a_round_is_handed_on_as_soon_as_all_that_take_part_have_spoken(simulator):
    node, _ = simulator
    for number in range(3):
        for robot in (2, 0):
            send(simulator, robot, number)
            assert handed_on(simulator) == [[]] * 4
            assert node._server.relay_deadline.running, "from the first message on"
        send(simulator, 1, number)
        others = [[bytes([j, number]) for j in range(3) if j != i] for i in range(3)]
        assert handed_on(simulator) == [*[[(number, Feature.FLOAT16, parts)] for parts in others], []]
        assert not node._server.relay_deadline.running


def test_at_the_deadline_what_is_there_is_handed_on(simulator):
    node, _ = simulator
    send(simulator, 1)
    node._server.end_round()
    assert handed_on(simulator) == [[(0, 1, [b"\1\0"])], [(0, 1, [])], [(0, 1, [b"\1\0"])], []]
    assert not node._server.relay_deadline.running
    send(simulator, 0)  # late: this round is over
    assert not node._server.relay_deadline.running
    send(simulator, 0, number=1)
    assert node._server.relay_deadline.running
    assert handed_on(simulator) == [[]] * 4


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
def test_what_is_of_no_use_is_not_handed_on_and_waited_for_no_longer(simulator, changes):
    node, _ = simulator
    send(simulator, 0, **changes)
    assert not node._server.relay_deadline.running
    for robot in range(3):
        send(simulator, robot)
    assert [len(bundles) for bundles in handed_on(simulator)] == [1, 1, 1, 0]


def test_what_cannot_be_read_harms_nobody(simulator):
    node, _ = simulator
    for data in (b"", b"abc", cdr.pack_feature(EPISODE, 0, 0, simulator[1][0], 0, b"xy")[:-1]):
        node._on_feature(data)
    assert not node._server.relay_deadline.running
    send(simulator, 0, encoding=99, payload=b"of another kind")
    send(simulator, 1)
    assert handed_on(simulator) == [[]] * 4
    send(simulator, 2)
    assert handed_on(simulator) == [[(0, 1, [b"\1\0", b"\2\0"])], [(0, 1, [b"\2\0"])], [(0, 1, [b"\1\0"])], []]


def test_nothing_is_relayed_between_episodes(simulator):
    node, _ = simulator
    node._server.state = Idle()
    send(simulator, 0)
    node._server.end_round()
    assert handed_on(simulator) == [[]] * 4
    assert not node._server.relay_deadline.running


def test_a_radio_that_does_not_exist_is_refused():
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
