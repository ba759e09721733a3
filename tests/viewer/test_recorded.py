# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of a recording shows its contents, with the attention that the analysis computes."""

import itertools
import struct
from dataclasses import replace

import numpy as np
import pytest

from magat_recording.attention import links
from magat_recording.tables import RecordedEpisode, TeamRecording
from magat_viewer.detail import RECEIVED_UNKNOWN, SILENT, RobotTick, TeamSnapshot, TickOutcome, robot_detail
from magat_viewer.recorded import RecordedTeam, recorded_tick


def looked_at(episode: RecordedEpisode, tick: int, robot: int) -> tuple[TeamSnapshot, RobotTick, TickOutcome]:
    log, after = episode.log, episode.log.worlds[tick + 1]
    snapshot = TeamSnapshot(tick, log.positions[tick], log.goals, log.obstacles)
    outcome = TickOutcome(after.silent[robot], after.missing[robot], after.action[robot])
    return snapshot, recorded_tick(episode, tick, robot), outcome


def test_all_frames_of_an_episode_are_there_once(simulate, small_policy):
    made = simulate(small_policy())
    recording = TeamRecording(made.bag)
    team = RecordedTeam(recording, "", "a bag")
    assert (team.live, team.newest) == (False, 1)
    for episode in recording.all_episodes:
        worlds = episode.log.worlds
        last, frames = team.frames(episode.number, -1)
        assert last == len(worlds) - 1
        assert team.frames(episode.number, last) == (last, b"")
        size = len(frames) // len(worlds)
        for tick, world in worlds.items():
            frame = frames[tick * size : (tick + 1) * size]
            assert struct.unpack_from("<2I", frame) == (episode.number, tick)
            assert np.frombuffer(frame, "<i2", len(made.names), 32).tolist() == list(world.x)
    for result, measures in zip(team.results(), made.measures, strict=True):
        assert result.measures.success == measures.success
        assert result.measures.makespan == measures.makespan


@pytest.mark.parametrize("name", ["MAGAT-F-16", "MAGAT-B-16-P2", "GAT-F-16", "GNN-F-16"])
@pytest.mark.parametrize("encoding", ["float32", "int8"])
def test_attention_is_that_of_the_analysis_though_messages_have_no_sender(simulate, small_policy, name, encoding):
    policy = small_policy(name)
    recording = TeamRecording(simulate(policy, episodes=1, encoding=encoding).bag)
    team, table = RecordedTeam(recording, policy, ""), links(recording, policy)
    table = table[table.tick.between(1, 3)]
    assert len(table) > 10
    for (tick, receiver), rows in table.groupby(["tick", "receiver"]):
        found = team.detail(0, tick, receiver)
        assert found.no_attention == ""
        heard = {one.robot: one.attention for one in found.neighbours}
        assert heard.keys() == set(rows.sender)
        for row in rows.itertuples():
            assert heard[row.sender][row.head] == pytest.approx(row.attention, abs=1e-4)


def test_the_detail_of_a_robot_is_its_observation_and_decision(simulate, small_policy):
    policy = small_policy()
    recording = TeamRecording(simulate(policy, episodes=1).bag)
    team = RecordedTeam(recording, policy, "")
    said = recording.all_episodes[0].ticks[3]
    for robot, observation in said.observations.items():
        found = team.detail(0, 3, robot)
        view = np.frombuffer(observation.message.field_of_view, np.uint8).reshape(3, 121)
        assert found.field_of_view == ["".join(map(str, channel)) for channel in view]
        wish = said.preferences[observation.message.own_tag].message
        assert found.probabilities == pytest.approx(np.exp(wish.log_probabilities), abs=1e-4)
        assert sum(found.probabilities) == pytest.approx(1.0, abs=1e-3)
        assert found.action == wish.primitive
        assert found.heard == found.audible == len(found.neighbours)
    assert team.detail(0, recording.all_episodes[0].log.measures.ticks, 0) is None, "after the last tick"
    assert team.detail(0, 0, 6) is None, "there are six robots"


def test_a_feature_that_was_not_heard_has_no_attention(simulate, small_policy):
    policy = small_policy()
    lost = ("Feature", 2, 1)
    recording = TeamRecording(simulate(policy, episodes=1, lose=lambda *of: of == lost).bag)
    team, table = RecordedTeam(recording, policy, ""), links(recording, policy)
    without = 0
    for robot in range(6):
        found = {one.robot: one.attention for one in team.detail(0, 2, robot).neighbours}
        rows = table[(table.tick == 2) & (table.receiver == robot)]
        assert {other for other, attention in found.items() if attention} == set(rows.sender)
        without += 1 in found and found[1] is None
    assert without > 0


@pytest.mark.parametrize(
    ("name", "encoding"),
    [("MAGAT-F-16", "float32"), ("MAGAT-F-16", "int8"), ("MAGAT-B-16-P2", "float16"), ("GNN-F-16", "int8")],
)
def test_a_decision_follows_from_the_world(simulate, small_policy, name, encoding):
    """The page needs neither features nor preferences if the robot received all messages in range."""
    policy = small_policy(name)
    [episode] = TeamRecording(simulate(policy, episodes=1, encoding=encoding).bag).all_episodes
    looked = 0
    for tick, robot in itertools.product(range(4), range(6)):
        snapshot, messages, outcome = looked_at(episode, tick, robot)
        found = robot_detail(robot, snapshot, messages, policy)
        without = replace(messages, payloads=None, preference=None, outcome=outcome)
        assert robot_detail(robot, snapshot, without, policy) == found
        looked += any(one.attention for one in found.neighbours)
    assert looked > 10


def test_a_robot_without_neighbours_has_a_decision(small_policy):
    policy = small_policy()
    snapshot = TeamSnapshot(3, np.array([[0, 0], [19, 19]]), np.array([[5, 5], [1, 1]]), np.zeros((20, 20), dtype=bool))
    [view] = snapshot.fields_of_view([0])
    own = policy.perceive(view[None])
    heard = np.zeros((1, 0, policy.config.message_sizes[0]), dtype=np.float32), np.zeros((1, 0), dtype=bool)
    decision = policy.decide(policy.hear(own, *heard), np.array([4], dtype=np.uint64), 3)
    outcome = TickOutcome(False, 0, int(decision.primitives[0]))
    found = robot_detail(0, snapshot, RobotTick(view, 0, 4, None, "", outcome=outcome), policy)
    assert found.probabilities == pytest.approx(np.exp(decision.log_probabilities[0]), abs=1e-4)
    assert (found.no_attention, found.neighbours, found.heard) == ("", [], 0)


def test_a_decision_that_does_not_follow_is_not_guessed(simulate, small_policy):
    policy = small_policy()
    [episode] = TeamRecording(simulate(policy, episodes=1).bag).all_episodes
    chosen = next((t, r) for t in range(4) for r in range(6) if len(looked_at(episode, t, r)[1].payloads) > 1)
    snapshot, recorded, outcome = looked_at(episode, *chosen)
    messages = replace(recorded, payloads=None, preference=None, outcome=outcome)
    for case, carried in (
        (replace(messages, outcome=replace(outcome, missing=1)), policy),  # one was lost, and it is not known which
        (replace(messages, outcome=replace(outcome, action=(outcome.action + 1) % 5)), policy),  # another action
        (replace(messages, audible=messages.audible - 1), policy),  # the simulator lost one
        (messages, small_policy(taps=3)),  # several rounds
        (replace(recorded, payloads=None), policy),  # a preference, but not all features
    ):
        found = robot_detail(chosen[1], snapshot, case, carried)
        assert found.no_attention == RECEIVED_UNKNOWN
        assert (found.probabilities is None) == (case.preference is None)
        assert all(one.attention is None for one in found.neighbours)
    for silent in (replace(messages, outcome=replace(outcome, silent=True)), replace(messages, outcome=None)):
        found = robot_detail(chosen[1], snapshot, silent, policy)
        assert found.no_attention == SILENT
        assert found.probabilities is None


def test_another_policys_attention_is_not_invented(simulate, small_policy):
    recording = TeamRecording(simulate(small_policy(), episodes=1).bag)
    other = RecordedTeam(recording, small_policy(seed=1), "")
    unknown = RecordedTeam(recording, "not known", "")
    tick, robot = next((t, r) for t in range(5) for r in range(6) if unknown.detail(0, t, r).neighbours)
    for team, why in ((other, "is it the robots' policy?"), (unknown, "not known")):
        found = team.detail(0, tick, robot)
        assert why in found.no_attention
        assert all(one.attention is None for one in found.neighbours)


def test_without_an_observation_there_is_no_detail(simulate, small_policy):
    made = simulate(small_policy(), episodes=1, lose=lambda kind, tick, robot: kind == "Observation" and robot == 2)
    assert RecordedTeam(TeamRecording(made.bag), "", "").detail(0, 1, 2) is None


def test_health_is_that_of_the_end_and_silences_those_of_the_episode(simulate, small_policy):
    team = RecordedTeam(TeamRecording(simulate(small_policy(), silent=(3, 2)).bag), "", "")
    health = team.health(1)
    assert health.late == {2: 1}
    [process] = health.processes
    assert (process.robots, process.digest) == (list(range(6)), "d" * 64)
