# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page's node: what it learns from the topics of a team, and that no message can crash it."""

import itertools
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from hostile import HOSTILE, MALFORMED

from magat_bringup.environment import loopback, own_domain
from magat_interfaces.msg import Feature, Observation, Preference, RobotStatus, World
from magat_node import qos
from magat_robot.policy.store import load, save
from magat_viewer.detail import RECEIVED_UNKNOWN, Neighbour, RobotDetail, TeamSnapshot
from magat_viewer.node import LiveTeam

NAMES = ["alice", "bob"]
EPISODES = itertools.count(100)


def world(tick: int, episode: int = 5, **fields: object) -> World:
    said = {"x": [tick, 0], "y": [0, 1], "goal_x": [9, 0], "goal_y": [0, 1], "action": [4, 0], "moved": [4, 0]}
    said |= {"silent": [False, False], "visited": [False, True], "robots": NAMES, "width": 10, "height": 2}
    said |= {"obstacles": [0] * 20 if tick == 0 else [], "missing": [0, 0], "t_max": 30, "seconds": 0.1, "links": 2}
    return World(episode=episode, tick=tick, **(said | fields))


@pytest.fixture(scope="module")
def talk() -> Iterator[SimpleNamespace]:
    """A `LiveTeam`, and ``say``, which publishes in place of the team once the page has subscribed."""
    with own_domain() as domain, pytest.MonkeyPatch.context() as patch:
        for name, value in loopback(domain).items():
            patch.setenv(name, value)
        context = rclpy.Context()
        rclpy.init(args=[], context=context, domain_id=domain)
        folders: dict[str, Path] = {}
        team = LiveTeam(context, folders.get, "/")
        node = rclpy.create_node("speaker", context=context)
        publishers: dict[str, object] = {}

        def until(condition: Callable[[], bool], chosen: set[int] = frozenset()) -> None:
            deadline = time.monotonic() + 20
            while not condition():
                assert time.monotonic() < deadline
                team.poll(chosen)
                time.sleep(0.005)

        def say(topic: str, message: object, profile: object, chosen: set[int] = frozenset()) -> None:
            if topic not in publishers:
                publishers[topic] = node.create_publisher(type(message), topic, profile)
            publisher = publishers[topic]
            until(lambda: publisher.get_subscription_count() > 0, chosen)
            publisher.publish(message)

        try:
            yield SimpleNamespace(team=team, say=say, until=until, node=node, folders=folders)
        finally:
            node.destroy_node()
            team.destroy()
            context.try_shutdown()


def show(talk: SimpleNamespace, message: World) -> None:
    talk.say("world", message, qos.reliable(100))
    talk.until(lambda: talk.team.newest >= 0 and talk.team.frames(talk.team.newest, -1)[0] == message.tick)


def no_attention(talk: SimpleNamespace, tick: int) -> str:
    """Why there is no attention of the second robot; empty if it has no detail."""
    found = talk.team.detail(0, tick, 1)
    return "" if found is None else found.no_attention


def test_each_world_is_a_frame(talk):
    before = talk.team.newest
    for tick in range(3):
        show(talk, world(tick))
    assert talk.team.newest == before + 1
    assert talk.team.scene(talk.team.newest).robots == NAMES
    tick, frames = talk.team.frames(talk.team.newest, 0)
    assert (tick, len(frames)) == (2, 2 * (32 + 12)), "two frames are new"
    assert talk.team.frames(talk.team.newest, 2) == (2, b"")


def test_an_episode_that_is_over_has_a_result(talk):
    show(talk, world(0, episode=6))
    show(talk, world(1, episode=6, t_max=1))
    assert talk.team.results()[-1].measures.success is False
    assert talk.team.results()[-1].episode == talk.team.newest


@pytest.mark.parametrize(
    "damage",
    [
        {"action": [1]},
        {"moved": []},
        {"missing": [0]},
        {"x": [1]},
        {"x": [1, 10]},
        {"y": [0, -1]},
        {"goal_y": [2, 0]},
        {"robots": []},
        {"obstacles": [0] * 7},
        {"width": 0},
    ],
)
def test_a_damaged_world_is_not_shown(talk, damage):
    episode = next(EPISODES)
    show(talk, world(0, episode=episode))
    number = talk.team.newest
    talk.say("world", world(1, episode=episode, **damage), qos.reliable(100))
    show(talk, world(2, episode=episode))
    assert talk.team.newest == number
    tick, frames = talk.team.frames(number, -1)
    assert (tick, len(frames)) == (2, 2 * (32 + 12))


def test_other_robots_or_another_map_are_another_episode(talk):
    show(talk, world(0, episode=7))
    number = talk.team.newest
    show(talk, world(1, episode=7, width=12, height=3))
    show(talk, world(2, episode=7, robots=["alice", "carol"]))
    assert talk.team.newest == number + 2
    assert talk.team.scene(talk.team.newest).obstacles is None


def test_a_robot_has_details_while_it_is_chosen(talk):
    """Its policy is not known here, so the page subscribes to all messages."""
    show(talk, world(0, episode=8))
    status = RobotStatus(robots=["bob"], policy="MAGAT-F-128", digest="d" * 64, radio="direct")
    talk.say("robot_status", status, qos.reliable(100), {1})
    view = np.tile([0, 1, 0], 121).astype(np.uint8)
    for tick in range(2):
        told = Observation(episode=8, tick=tick, own_tag=77, audible_tags=[5], field_of_view=view)
        wish = Preference(episode=8, tick=tick, primitive=2, heard=1, compute_us=1500)
        wish.log_probabilities = np.log([0.1, 0.2, 0.4, 0.2, 0.1]).astype(np.float32)
        damaged = Observation(episode=8, tick=tick, own_tag=78)
        hello = Observation(tick=Observation.HELLO, field_of_view=view)
        for message in (told, damaged, hello):
            talk.say("bob/observation", message, qos.newest(10), {1})
        for tag in (77, 99) if tick == 1 else ():
            wish.tag = tag
            talk.say("preference", wish, qos.newest(10), {1})
        talk.say("world", world(tick + 1, episode=8), qos.reliable(100), {1})
        talk.until(lambda: "there is no policy" in no_attention(talk, 0), {1})
    talk.until(lambda: talk.team.detail(0, 0, 1).probabilities is not None, {1})
    found = talk.team.detail(0, 0, 1)
    assert found.probabilities == pytest.approx([0.1, 0.2, 0.4, 0.2, 0.1], abs=1e-4)
    assert (found.tick, found.action, found.audible, found.heard) == (1, 2, 1, 1)
    assert found.field_of_view[0] == "".join(map(str, view[:121]))
    assert talk.team.detail(0, 0, 0) is None, "alice is not chosen"
    talk.until(lambda: talk.node.count_subscribers("bob/observation") == 0)


@pytest.mark.parametrize("odd", [{"action": [4, 3]}, {"missing": [0, 1]}])
def test_messages_are_subscribed_to_only_if_a_decision_does_not_follow_from_the_world(
    talk, random_network, tmp_path, odd
):
    number = next(EPISODES)
    digest = f"{number:064d}"
    show(talk, world(0, episode=number))
    talk.folders[digest] = tmp_path
    save(random_network(), tmp_path, "")
    policy, snapshot = (
        load(tmp_path),
        TeamSnapshot(0, np.array([[0, 0], [0, 1]]), np.array([[9, 0], [0, 1]]), np.zeros((2, 10))),
    )
    status = RobotStatus(robots=["bob"], policy="MAGAT-F-16", digest=digest, radio="direct", encoding="float32")
    talk.say("robot_status", status, qos.reliable(100), {1})
    alice, bob = (policy.perceive(snapshot.fields_of_view([robot])) for robot in range(2))
    after = policy.hear(bob, alice.messages[None], np.ones((1, 1), bool))
    stream = np.array([9], np.uint64)

    def tick(at: int, listened: bool = False, **fields: object) -> None:
        told = Observation(episode=number, tick=at, own_tag=10 + at, audible_tags=[20 + at], stream=9)
        told.field_of_view = snapshot.fields_of_view([1]).ravel()
        decision = policy.decide(after, stream, at)
        primitive = int(decision.primitives[0])
        talk.say("bob/observation", told, qos.newest(10), {1})
        if listened:
            said = Feature(episode=number, tick=at, tag=20 + at, payload=alice.messages.tobytes())
            talk.say("feature", said, qos.newest(10), {1})
            wish = Preference(episode=number, tick=at, tag=10 + at, heard=1, primitive=primitive)
            wish.log_probabilities = np.log([0.96, 0.01, 0.01, 0.01, 0.01]).astype(np.float32)
            talk.say("preference", wish, qos.newest(10), {1})
        shown = {"x": [0, 0], "action": [4, primitive]} | fields
        if "action" in fields:
            shown["action"] = [4, (primitive + 1) % 5]
        talk.say("world", world(at + 1, episode=number, **shown), qos.reliable(100), {1})

    def found(at: int) -> RobotDetail:
        last = talk.team.detail(0, at, 1)
        return last if last and last.tick == at else RobotDetail(1, at, [], None, None, 0, None, [], "not yet")

    tick(0)
    talk.until(lambda: found(0).no_attention == "", {1})
    expected = np.exp(policy.decide(after, stream, 0).log_probabilities[0])
    assert found(0).probabilities == pytest.approx(expected, abs=1e-4)
    assert found(0).neighbours == [Neighbour(0, [1.0])]
    assert found(0).heard == 1
    assert talk.node.count_subscribers("feature") == talk.node.count_subscribers("preference") == 0
    tick(1, **odd)
    talk.until(lambda: found(1).no_attention == RECEIVED_UNKNOWN, {1})
    assert found(1).probabilities is None
    tick(2, listened=True)
    talk.until(lambda: found(2).probabilities == pytest.approx([0.96, 0.01, 0.01, 0.01, 0.01], abs=1e-4), {1})
    talk.until(lambda: found(2).no_attention == "" and found(2).neighbours[0].attention == [1.0], {1})
    talk.until(lambda: talk.node.count_subscribers("feature") == 0)
    assert talk.node.count_subscribers("preference") == 0


def test_a_live_team_that_does_not_communicate_is_shown(talk, random_network, tmp_path):
    number = next(EPISODES)
    digest = f"{number:064d}"
    talk.folders[digest] = tmp_path
    save(random_network(taps=1), tmp_path, "")
    policy = load(tmp_path)
    status = RobotStatus(robots=["bob"], policy="MAGAT-F-16", digest=digest, radio="direct", encoding="int8")
    snapshot = TeamSnapshot(0, np.array([[0, 0], [0, 1]]), np.array([[9, 0], [0, 1]]), np.zeros((2, 10)))
    view = snapshot.fields_of_view([1])
    latent = policy.hear(policy.perceive(view), np.zeros((1, 1, 0), np.float32), np.ones((1, 1), bool))
    decision = policy.decide(latent, np.array([9], np.uint64), 0)
    observation = Observation(episode=number, tick=0, own_tag=10, audible_tags=[20], stream=9)
    observation.field_of_view = view.ravel()
    show(talk, world(0, episode=number))
    talk.say("robot_status", status, qos.reliable(100), {1})
    talk.say("bob/observation", observation, qos.newest(10), {1})
    action = [4, int(decision.primitives[0])]
    talk.say("world", world(1, episode=number, action=action), qos.reliable(100), {1})
    talk.until(lambda: "do not communicate" in no_attention(talk, 0), {1})
    expected = np.exp(decision.log_probabilities[0])
    assert talk.team.detail(0, 0, 1).probabilities == pytest.approx(expected, abs=1e-4)


def test_the_page_waits_for_the_first_status_before_it_subscribes_to_messages(talk):
    number = next(EPISODES)
    names = {"robots": ["carol", "dave"]}
    show(talk, world(0, episode=number, **names))
    told = Observation(episode=number, tick=0, own_tag=7, audible_tags=[8], field_of_view=np.zeros(363, np.uint8))
    talk.say("dave/observation", told, qos.newest(10), {1})
    talk.say("world", world(1, episode=number, **names), qos.reliable(100), {1})
    talk.until(lambda: "no robot has reported" in no_attention(talk, 0), {1})
    talk.team.poll({1})
    assert talk.node.count_subscribers("preference") == 0
    talk.until(lambda: talk.node.count_subscribers("dave/observation") == 0)


def test_a_page_that_joins_late_subscribes_to_messages_until_the_next_map(talk, random_network, tmp_path):
    number = next(EPISODES)
    talk.folders["f" * 64] = tmp_path
    save(random_network(), tmp_path, "")
    status = RobotStatus(robots=["bob"], policy="MAGAT-F-16", digest="f" * 64, radio="direct", encoding="float32")
    talk.say("robot_status", status, qos.reliable(100), {1})
    told = Observation(episode=number, tick=3, own_tag=7, audible_tags=[8], field_of_view=np.zeros(363, np.uint8))
    show(talk, world(3, episode=number))
    talk.say("bob/observation", told, qos.newest(10), {1})
    talk.say("world", world(4, episode=number), qos.reliable(100), {1})
    talk.until(lambda: "the map is not known" in no_attention(talk, 3), {1})
    talk.until(lambda: talk.node.count_subscribers("preference") == 1, {1})
    talk.say("world", world(0, episode=next(EPISODES)), qos.reliable(100), {1})
    talk.until(lambda: talk.node.count_subscribers("preference") == 0, {1})
    talk.until(lambda: talk.node.count_subscribers("bob/observation") == 0)


def test_nan_does_not_reach_browsers(talk):
    show(talk, world(0, episode=9))
    status = RobotStatus(robots=["alice"], policy="MAGAT-F-128", digest="d" * 64, radio="direct")
    talk.say("robot_status", status, qos.reliable(100), {0})
    for tick in range(2):
        told = Observation(episode=9, tick=tick, own_tag=3, field_of_view=np.zeros(363, dtype=np.uint8))
        talk.say("alice/observation", told, qos.newest(10), {0})
        if tick == 1:
            wish = Preference(episode=9, tick=tick, tag=3)
            wish.log_probabilities = np.array([np.nan, np.inf, -np.inf, 900.0, -0.5], dtype=np.float32)
            talk.say("preference", wish, qos.newest(10), {0})
        talk.say("world", world(tick + 1, episode=9), qos.reliable(100), {0})
        talk.until(lambda at=tick: getattr(talk.team.detail(0, 0, 0), "tick", None) == at, {0})
    talk.until(lambda: talk.team.detail(0, 0, 0).probabilities is not None, {0})
    found = json.loads(json.dumps(asdict(talk.team.detail(0, 0, 0)), allow_nan=False))
    assert found["probabilities"] == pytest.approx([0.0, 1.0, 0.0, 1.0, 0.6065])


def test_no_message_of_a_stranger_ends_the_page(talk, capfd):
    number = next(EPISODES)
    show(talk, world(0, episode=number))
    for topic, kind in (("world", World), ("robot_status", RobotStatus)):
        talk.say(topic, kind(), qos.reliable(100), {0, 1})
        for data in HOSTILE[topic]:
            talk.say(topic, data, qos.reliable(100), {0, 1})
    for data in MALFORMED:
        talk.say("alice/observation", Observation(), qos.newest(10), {0, 1})
        talk.say("alice/observation", data, qos.newest(10), {0, 1})
    episode = talk.team.newest
    show(talk, world(1, episode=number))
    assert talk.team.newest == episode
    talk.team.poll({0, 1})
    said = capfd.readouterr().err
    assert said.count("[viewer]: dropped") <= 3, "one line a topic"
    assert len(said) < 1500
    assert "remaining buffer" not in said
