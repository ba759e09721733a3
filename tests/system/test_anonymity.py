# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""No message that a robot receives, and no metadata that it reads, identifies the sender."""

import collections
import functools
import inspect

import pytest

from magat_evaluation.splits import SPLITS
from magat_interfaces.msg import Feature, FeatureBundle, Observation
from magat_node import qos
from magat_robot.node import RobotNode

pytestmark = pytest.mark.system

CASE = SPLITS["test"][7]


def _matched(subscriptions, robots):
    """The first one hears all robots, the others the simulator."""
    feature, *others = (subscription.get_publisher_count() for subscription in subscriptions)
    return feature == robots and all(others)


@pytest.fixture(scope="module")
def overheard(team):
    """Every feature message of an episode, and every observation of every robot, as an eavesdropper gets them."""
    features, observations = [], collections.defaultdict(list)
    node = team.client.node
    subscriptions = [node.create_subscription(Feature, "/feature", features.append, qos.newest(4096))]
    for i in range(team.robots):
        topic = f"/robot_{i}/observation"
        subscriptions.append(node.create_subscription(Observation, topic, observations[i].append, qos.newest(512)))
    assert team.client.spin(lambda: _matched(subscriptions, team.robots), 20.0)
    outcome = team.run(team.goal(CASE))
    assert team.client.spin(lambda: len(features) >= 0.9 * team.robots * outcome.result.ticks, 5.0)
    for subscription in subscriptions:
        node.destroy_subscription(subscription)
    heard = [f for f in features if f.tick != Observation.HELLO]
    assert heard and all(observations.values())
    return outcome, heard, {i: [o for o in seen if o.tick != Observation.HELLO] for i, seen in observations.items()}


@pytest.fixture(scope="module")
def handed_on(relayed_team):
    """Per tick of an episode: by robot what the simulator handed to it, and by robot's tag what was sent."""
    team = relayed_team
    bundles, tags, sent = (collections.defaultdict(dict) for _ in range(3))
    node = team.client.node

    def note_feature(feature):
        sent[feature.tick][feature.tag] = bytes(feature.payload)

    def note_bundle(robot, bundle):
        bundles[bundle.tick][robot] = bundle

    def note_observation(robot, observation):
        tags[observation.tick][robot] = observation

    depth = qos.newest(4096)
    subscriptions = [node.create_subscription(Feature, "/feature", note_feature, depth)]
    for i in range(team.robots):
        for kind, topic, note in (
            (FeatureBundle, "heard", note_bundle),
            (Observation, "observation", note_observation),
        ):
            callback = functools.partial(note, i)
            subscriptions.append(node.create_subscription(kind, f"/robot_{i}/{topic}", callback, depth))
    assert team.client.spin(lambda: _matched(subscriptions, team.robots), 20.0)
    outcome = team.run(team.goal(CASE))
    team.client.spin(lambda: sum(map(len, bundles.values())) >= 0.9 * team.robots * outcome.result.ticks, 5.0)
    for subscription in subscriptions:
        node.destroy_subscription(subscription)
    whole = [t for t in bundles if len(bundles[t]) == len(tags[t]) == len(sent[t]) == team.robots]
    assert len(whole) > 0.5 * outcome.result.ticks
    return [(bundles[t], tags[t], sent[t]) for t in whole]


def test_a_feature_message_has_no_field_for_its_sender():
    fields = Feature.get_fields_and_field_types()
    assert set(fields) == {"episode", "tick", "round", "tag", "encoding", "payload"}


def test_a_bundle_has_no_field_for_senders_or_their_tags():
    fields = FeatureBundle.get_fields_and_field_types()
    assert set(fields) == {"episode", "tick", "round", "encoding", "messages", "payloads"}


def test_a_bundle_is_what_was_sent_under_the_tags_that_its_robot_hears(handed_on):
    for bundles, observations, sent in handed_on:
        for robot, bundle in bundles.items():
            observation = observations[robot]
            assert (bundle.episode, bundle.round, bundle.encoding) == (observation.episode, 0, Feature.FLOAT32)
            assert bundle.messages == len(observation.audible_tags)
            assert sorted(parts(bundle)) == sorted(sent[tag] for tag in observation.audible_tags)


def parts(bundle):
    data = bytes(bundle.payloads)
    assert len(data) == 512 * bundle.messages
    return [data[i : i + 512] for i in range(0, len(data), 512)]


def test_the_order_in_a_bundle_tells_neither_the_robots_nor_their_tags(handed_on):
    lists = by_robot = by_tag = as_announced = alike = shared = 0
    for bundles, observations, sent in handed_on:
        owner = {observation.own_tag: robot for robot, observation in observations.items()}
        tag_of = {payload: tag for tag, payload in sent.items()}
        for robot, bundle in bundles.items():
            tags = [tag_of[payload] for payload in parts(bundle)]
            if len(tags) < 3 or len(set(tags)) < len(tags):  # robots that see the same send the same
                continue
            lists += 1
            by_robot += [owner[tag] for tag in tags] == sorted(owner[tag] for tag in tags)
            by_tag += tags == sorted(tags)
            as_announced += tags == list(observations[robot].audible_tags)
            for other in range(robot):
                # What two robots hear both, each in an order of its own.
                common = [tag_of[payload] for payload in parts(bundles[other])]
                both = [tag for tag in tags if tag in common]
                if len(both) >= 3:
                    shared += 1
                    alike += both == [tag for tag in common if tag in tags]
    assert min(lists, shared) > 30
    # A random order of three is any given one time in six.
    assert max(by_robot, by_tag, as_announced) < 0.4 * lists
    assert alike < 0.4 * shared


def test_no_tag_is_used_twice(overheard):
    _, features, _ = overheard
    tags = [feature.tag for feature in features]
    assert len(set(tags)) == len(tags)


def test_nothing_but_tick_tag_and_payload_differs_between_messages(overheard):
    _, features, _ = overheard
    assert len({(f.episode, f.round, f.encoding, len(f.payload)) for f in features}) == 1


def test_tags_do_not_order_the_robots(overheard):
    """Neither the value of a tag nor its place in the list of audible tags identifies its sender."""
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
    """Callbacks with one argument get no MessageInfo: its sequence number could link the messages of one sender."""
    assert list(inspect.signature(RobotNode._on_feature).parameters) == ["self", "data"]
    # Which of its robots a message is for is bound before.
    assert list(inspect.signature(RobotNode._on_bundle).parameters) == ["self", "robot", "data"]
    assert list(inspect.signature(RobotNode._on_observation).parameters) == ["self", "robot", "message"]
    source = inspect.getsource(RobotNode)
    for name in ("get_publishers_info_by_topic", "get_subscriptions_info_by_topic", "get_node_names"):
        assert name not in source


def test_names_make_no_difference(team, start_named_team):
    """The same case walked by robots of other names, listed in another order of names: the same paths."""
    outcome = team.run_undisturbed(team.goal(CASE))
    with start_named_team([f"unit_{name}" for name in "jihgfedcba"]) as other:
        positions = other.run_undisturbed(team.goal(CASE)).recording.positions
    assert (positions == outcome.recording.positions).all()


def test_the_secret_that_an_episode_returns_repeats_it_and_no_other_episode_has_it(team):
    first, second = (team.run_undisturbed(team.goal(CASE, secret=b"")) for _ in range(2))
    secrets = [bytes(outcome.result.secret) for outcome in (first, second)]
    assert len(set(secrets)) == 2
    assert {len(secret) for secret in secrets} == {32}
    assert first.recording.positions.tolist() != second.recording.positions.tolist()
    again = team.run_undisturbed(team.goal(CASE, secret=secrets[0]))
    assert bytes(again.result.secret) == secrets[0]
    assert again.recording.positions.tolist() == first.recording.positions.tolist()
