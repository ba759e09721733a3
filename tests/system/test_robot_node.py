# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A robot's node alone: how it handles messages, and when its deadline runs."""

import array

import numpy as np
import pytest
import rclpy
from rclpy.parameter import Parameter

from magat_bringup.environment import own_domain
from magat_interfaces.msg import Feature, Observation
from magat_node import cdr
from magat_robot.node import RobotNode
from magat_robot.policy.payload import encode
from magat_robot.policy.store import save

#: Numbers in a message of each of two rounds, and bytes of all Features of a tick by encoding.
SIZES = (8, 16)
FEATURE_BYTES = {"float32": 72 + 4 * 24, "float16": 72 + 2 * 24, "int8": 72 + 8 + 24}


class Recorder:
    """Replaces a publisher or the timer of the deadline, and records the calls."""

    def __init__(self):
        self.said = []

    def publish(self, message):
        self.said.append(message)

    def reset(self):
        self.said.append("reset")

    def cancel(self):
        self.said.append("cancel")

    def new(self):
        """The calls since the last call of this method."""
        said, self.said = self.said, []
        return said


@pytest.fixture(scope="module")
def two_rounds(random_network, tmp_path_factory):
    """A policy whose robots exchange messages in two rounds."""
    folder = tmp_path_factory.mktemp("policy")
    save(random_network("MAGAT-F-8", taps=3), folder, "")
    return folder


@pytest.fixture
def node(two_rounds):
    """Makes a node whose publishers and deadline are recorders."""
    context = rclpy.Context()
    made = []

    def make(robots, **parameters):
        overrides = {"policy": str(two_rounds), "backend": "torch", "robots": robots} | parameters
        parameters = [Parameter(name, value=value) for name, value in overrides.items()]
        node = RobotNode(context=context, namespace=f"/{robots[0]}", parameter_overrides=parameters)
        made.append(node)
        node.destroy_timer(node._deadline)
        node._send_feature, node._send_preference, node._send_status, node._deadline = (Recorder() for _ in range(4))
        return node

    with own_domain() as domain:
        rclpy.init(args=[], context=context, domain_id=domain)
        try:
            yield make
        finally:
            for node in made:
                node.destroy_node()
            context.try_shutdown()


def observation(tick=0, own_tag=1, audible=(), **fields):
    message = Observation(episode=7, tick=tick, own_tag=own_tag, stream=3, **fields)
    message.audible_tags = array.array("Q", audible)
    message.field_of_view = array.array("B", (np.arange(363) % 5 == 0).astype(np.uint8).tobytes())
    return message


def values(number=0, encoding="float32", seed=0):
    numbers = np.random.default_rng(seed).integers(0, 512, SIZES[number]) / 64
    return encode(numbers.astype(np.float32), encoding)


def feature(tag, tick=0, number=0, encoding=0, payload=None):
    return cdr.pack_feature(7, tick, number, tag, encoding, values(number, seed=tag) if payload is None else payload)


def test_the_deadline_runs_from_the_first_observation_and_from_what_is_sent_in_each_round(node):
    robots = node(["a", "b"])
    robots._on_observation(0, observation(own_tag=1, audible=[5]))
    assert robots._deadline.new() == ["reset"]
    robots._on_observation(1, observation(own_tag=2))
    assert robots._deadline.new() == ["reset"]
    for number in range(2):
        sent = {cdr.unpack_feature(data)[2:4] for data in robots._send_feature.new()}  # the order is random
        assert sent == {(number, 1), (number, 2)}
        assert robots._send_preference.new() == []
        robots._on_feature(feature(5, number=number))
        assert robots._deadline.new() == (["reset"] if number == 0 else ["cancel"] * 2)
    assert len(robots._send_preference.new()) == 2


def test_the_deadline_runs_anew_in_a_tick_that_ends_another_one(node):
    robots = node(["a", "b"])
    robots._on_observation(0, observation())
    robots._deadline.new()
    robots._on_observation(1, observation(tick=1, own_tag=2))
    assert robots._deadline.new() == ["reset"]
    for late_or_repeated in (observation(), observation(tick=1)):
        robots._on_observation(1, late_or_repeated)
    assert robots._deadline.new() == [], "these prolong nothing"


def test_each_deadline_ends_one_wait(node):
    robots = node(["a", "b"])
    robots._on_observation(1, observation(own_tag=2, audible=[5]))
    waits = []
    while not robots._send_preference.said:
        robots._on_deadline()
        waits.append([cdr.unpack_feature(data)[2:4] for data in robots._send_feature.new()])
        assert len(waits) < 9
    assert waits == [[(0, 2)], [(1, 2)], []]
    (preference,) = robots._send_preference.said
    assert (preference.tag, preference.heard) == (2, 0)
    # No deadline runs after the tick.
    assert robots._deadline.said[-1] == "cancel"


@pytest.mark.parametrize("encoding", FEATURE_BYTES)
def test_a_preference_says_what_was_sent_and_heard(node, encoding):
    robot = node(["a"], encoding=encoding)
    code = {"float32": Feature.FLOAT32, "float16": Feature.FLOAT16, "int8": Feature.INT8}[encoding]
    robot._on_observation(0, observation(own_tag=9, audible=[4, 5, 6]))
    for number in range(2):
        for tag in (4, 5):  # the messages of 6 are missing in both rounds
            robot._on_feature(feature(tag, 0, number, code, values(number, encoding, tag)))
        robot._on_deadline()
    sent = robot._send_feature.new()
    assert [cdr.unpack_feature(data).encoding for data in sent] == [code] * 2
    (preference,) = robot._send_preference.new()
    assert (preference.episode, preference.tick, preference.tag) == (7, 0, 9)
    assert preference.feature_bytes == sum(map(len, sent)) == FEATURE_BYTES[encoding]
    # Three were announced, and two are missing over both rounds.
    assert preference.heard == 1
    assert np.exp(preference.log_probabilities).sum() == pytest.approx(1)
    assert robot._crew.exchange.dropped == 0


def test_features_that_cannot_be_read_are_dropped_and_counted(node):
    robot = node(["a"], encoding="float16")
    robot._on_observation(0, observation(audible=[4]))
    good = feature(4, encoding=Feature.FLOAT16, payload=values(0, "float16"))
    bad = {
        "a damaged message of 20 bytes": good[:20],
        "of encoding 0": feature(4),
        "of encoding 99": feature(4, encoding=99, payload=values(0, "float16")),
        "5 bytes, not 16": feature(4, tick=1, encoding=Feature.FLOAT16, payload=bytes(5)),
        "late": feature(4, tick=0, encoding=Feature.FLOAT16, payload=values(0, "float16")),
    }
    robot._on_observation(0, observation(tick=1, audible=[4]))
    for count, (why, data) in enumerate(bad.items(), start=1):
        robot._on_feature(data)
        assert robot._crew.exchange.dropped == count
        assert why in robot._crew.exchange.last_drop
    robot._on_feature(feature(4, tick=1, encoding=Feature.FLOAT16, payload=values(0, "float16")))
    assert cdr.unpack_feature(robot._send_feature.said[-1])[1:3] == (1, 1), "it goes on with the good one"


def test_bundles_are_taken_apart_and_those_that_cannot_be_read_dropped_and_counted(node):
    direct, relayed = node(["a"]), node(["b"], radio="relayed")
    direct._on_observation(0, observation(audible=[4, 5, 6]))
    relayed._on_observation(0, observation(audible=[4, 5, 6]))
    for number in range(2):
        for tag in (4, 5, 6):
            direct._on_feature(feature(tag, number=number))
        good = cdr.pack_bundle(7, 0, number, Feature.FLOAT32, [values(number, seed=tag) for tag in (6, 4, 5)])
        dropped = relayed._crew.exchange.dropped
        relayed._on_bundle(0, good[:-1])
        assert "damaged bundle" in relayed._crew.exchange.last_drop
        relayed._on_bundle(0, cdr.pack_bundle(7, 0, number, Feature.INT8, [bytes(12)]))
        assert "of encoding 2" in relayed._crew.exchange.last_drop
        assert relayed._crew.exchange.dropped == dropped + 2
        relayed._on_bundle(0, good)
    assert direct._send_feature.said[1:] == relayed._send_feature.said[1:]
    (one,), (other,) = direct._send_preference.said, relayed._send_preference.said
    assert one.log_probabilities.tobytes() == other.log_probabilities.tobytes()
    assert one.heard == other.heard == 3


def test_a_process_that_waits_says_hello_for_all_its_robots_and_counts_the_others(node):
    robots = node(["a", "b", "c"], encoding="int8")
    robots._on_beat()
    (hello,) = map(cdr.unpack_feature, robots._send_feature.new())
    assert (hello.episode, hello.tick, hello.round, hello.payload) == (0, Observation.HELLO, 0, b"\3\0\0\0")
    robots._on_feature(cdr.pack_feature(*hello))  # the node receives its own hello
    for nonce, count in ((100, 4), (101, 1), (100, 4)):
        robots._on_feature(cdr.pack_feature(0, Observation.HELLO, 0, nonce, 0, bytes([count, 0, 0, 0])))
    robots._on_feature(cdr.pack_feature(0, Observation.HELLO, 0, 102, 0, b""))  # without a count
    robots._on_beat()
    status = robots._send_status.said[-1]
    assert (status.robots, status.state) == (["a", "b", "c"], status.WAITING)
    assert (status.encoding, status.radio) == ("int8", "direct")
    assert status.peers_heard == 2 + 4 + 1
    assert (status.messages_dropped, robots._crew.exchange.dropped) == (0, 0)


@pytest.mark.parametrize(
    ("parameters", "every"),
    [({"team_size": 64}, 1), ({"team_size": 65}, 2), ({"team_size": 600}, 10), ({"radio": "relayed"}, None)],
)
def test_in_large_teams_hellos_are_seldom_and_where_nobody_hears_them_there_are_none(node, parameters, every):
    """Each process has two robots."""
    robots = node(["a", "b"], **parameters)
    said = []
    for beat in range(20):
        robots._on_beat()
        said += [beat] * len(robots._send_feature.new())
    assert said == (list(range(0, 20, every)) if every else [])
    assert len(robots._send_status.said) == 20


def test_a_hello_is_answered_in_the_name_that_it_asks(node):
    robots = node(["a", "b"])
    robots._on_observation(1, Observation(tick=Observation.HELLO, own_tag=77))
    (answer,) = robots._send_preference.said
    assert (answer.tick, answer.tag) == (Observation.HELLO, 77)
    assert (robots._deadline.said, robots._send_feature.said) == ([], [])


@pytest.mark.parametrize(
    ("options", "topics"),
    [
        (
            {"namespace": "/hall/a"},
            {"/hall/feature", "/hall/preference", "/hall/robot_status", "/hall/deployment", "/hall/a/observation"},
        ),
        ({"namespace": "/a"}, {"/feature", "/preference", "/robot_status", "/deployment", "/a/observation"}),
    ],
    ids=["in a namespace", "at the root"],
)
def test_a_team_may_live_in_a_namespace_and_a_crew_in_it(two_rounds, options, topics):
    def found(radio, robots=None, **options):
        parameters = {"policy": str(two_rounds), "radio": radio, "backend": "torch"}
        parameters |= {"robots": robots} if robots else {}
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = RobotNode(context=context, parameter_overrides=overrides, **options)
        topics = {end.topic_name for end in (*node.publishers, *node.subscriptions)}
        assert node.robots == (robots or ["a"])
        node.destroy_node()
        return {topic for topic in topics if topic not in ("/rosout", "/parameter_events")}

    context = rclpy.Context()
    team = options["namespace"].removesuffix("/a")
    with own_domain() as domain:
        rclpy.init(args=[], context=context, domain_id=domain)
        try:
            assert found("direct", **options) == topics
            assert found("relayed", **options) == topics | {f"{team}/a/heard"}
            # The same robot and another one in one process.
            crew = found("relayed", ["a", "b"], namespace=f"{team}/a")
            assert crew == topics | {f"{team}/a/heard", f"{team}/b/heard", f"{team}/b/observation"}
        finally:
            context.try_shutdown()
