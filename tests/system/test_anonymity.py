"""No message a robot receives, and no metadata it reads, tells who sent it."""

import collections
import inspect

import pytest

from magat_interfaces.msg import Feature, Observation
from magat_node import qos
from magat_robot.node import RobotNode
from magat_training.cases import SPLITS

pytestmark = pytest.mark.system

CASE = SPLITS["test"][7]


@pytest.fixture(scope="module")
def overheard(team):
    """Every feature message of an episode, and every observation of every robot, as an eavesdropper gets them."""
    features, observations = [], collections.defaultdict(list)
    node = team.client.node
    subscriptions = [node.create_subscription(Feature, "/feature", features.append, qos.newest(4096))]
    for i in range(team.robots):
        topic = f"/robot_{i}/observation"
        subscriptions.append(node.create_subscription(Observation, topic, observations[i].append, qos.newest(512)))
    assert team.client.spin(lambda: all(s.get_publisher_count() for s in subscriptions), 20.0)
    outcome = team.run(team.goal(CASE))
    assert team.client.spin(lambda: len(features) >= 0.9 * team.robots * outcome.result.ticks, 5.0)
    for subscription in subscriptions:
        node.destroy_subscription(subscription)
    heard = [f for f in features if f.tick != Observation.HELLO]
    assert heard and all(observations.values())
    return outcome, heard, {i: [o for o in seen if o.tick != Observation.HELLO] for i, seen in observations.items()}


def test_a_feature_message_has_no_field_for_its_sender():
    fields = Feature.get_fields_and_field_types()
    assert set(fields) == {"episode", "tick", "round", "tag", "encoding", "payload"}


def test_no_tag_is_used_twice(overheard):
    _, features, _ = overheard
    tags = [feature.tag for feature in features]
    assert len(set(tags)) == len(tags)


def test_nothing_but_tick_tag_and_payload_differs_between_messages(overheard):
    _, features, _ = overheard
    assert len({(f.episode, f.round, f.encoding, len(f.payload)) for f in features}) == 1


def test_tags_do_not_order_the_robots(overheard):
    """Neither by value nor by their place in the list of audible tags does a tag tell whose it is."""
    _, _, observations = overheard
    by_tick = collections.defaultdict(dict)
    for robot, seen in observations.items():
        for observation in seen:
            by_tick[observation.tick][robot] = observation
    rank_sums = collections.Counter()
    in_order = lists = 0
    for seen in by_tick.values():
        owner = {observation.own_tag: robot for robot, observation in seen.items()}
        for rank, tag in enumerate(sorted(owner)):
            rank_sums[owner[tag]] += rank
        for observation in seen.values():
            listed = [owner[tag] for tag in observation.audible_tags if tag in owner]
            if len(listed) >= 3:
                lists += 1
                in_order += listed == sorted(listed)
    ticks = len(by_tick)
    assert lists > 30
    assert in_order < 0.5 * lists  # a random order of three is sorted one time in six
    assert all(0.2 * 9 < total / ticks < 0.8 * 9 for total in rank_sums.values())


def test_a_robot_is_told_its_own_stream_only(overheard):
    _, _, observations = overheard
    streams = {robot: {o.stream for o in seen} for robot, seen in observations.items()}
    assert all(len(own) == 1 for own in streams.values())
    assert len(set.union(*streams.values())) == len(streams)


def test_robots_never_ask_the_middleware_where_a_message_came_from():
    """Callbacks of one argument get no MessageInfo, whose sequence number could link a sender's messages."""
    for callback in (RobotNode._on_feature, RobotNode._on_observation):
        assert list(inspect.signature(callback).parameters) == ["self", "message"]
    source = inspect.getsource(RobotNode)
    for name in ("get_publishers_info_by_topic", "get_subscriptions_info_by_topic", "get_node_names"):
        assert name not in source


def test_names_make_no_difference(team, overheard, start_named_team):
    """The same case walked by robots of other names, listed in another order of names: the same paths."""
    outcome, _, _ = overheard
    with start_named_team([f"unit_{name}" for name in "jihgfedcba"]) as other:
        positions = other.run(team.goal(CASE)).recording.positions
    assert (positions == outcome.recording.positions).all()
