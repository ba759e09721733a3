# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""An episode tick by tick: tags lead answers home, silence idles, nonsense is dropped."""

import numpy as np
import pytest

from magat_sim.case import draw_case
from magat_sim.grid import Primitive
from magat_sim.radio import neighbours
from magat_sim.simulator import Rules
from magat_sim.streams import episode_streams
from magat_sim.ticks import DistributedEpisode, ReceivedPreference

ROBOTS = 6
ALL = np.ones(ROBOTS, dtype=bool)


@pytest.fixture
def episode() -> DistributedEpisode:
    case = draw_case(5, 0, 12, 12, ROBOTS)
    return DistributedEpisode(case, 50, episode_streams(5, 0, ROBOTS))


def test_observations_are_those_of_the_simulator(episode):
    observation = episode.simulator.observe()
    observations = episode.look(ALL)
    for observed, view, stream in zip(observations, observation.field_of_view, observation.streams, strict=True):
        np.testing.assert_array_equal(observed.field_of_view, view)
        assert observed.stream == stream


def test_audible_tags_are_those_of_the_neighbours_that_are_present(episode):
    heard = neighbours(np.zeros(ROBOTS, dtype=np.int64), episode.simulator.position)
    for present in (ALL, np.arange(ROBOTS) % 2 == 0):
        observations = episode.look(present)
        for row, observed in zip(heard, observations, strict=True):
            expected = {observations[j].own_tag for j in row if j >= 0 and present[j]}
            assert set(observed.audible_tags) == expected
            assert len(observed.audible_tags) == len(expected)


def test_lost_links_are_not_announced_and_are_those_of_the_simulator():
    case = draw_case(5, 0, 12, 12, ROBOTS)
    episode, whole = (DistributedEpisode(case, 50, episode_streams(5, 0, ROBOTS), Rules(loss)) for loss in (0.5, 0.0))
    fewer = 0
    for _ in range(10):
        heard = episode.simulator.observe().heard
        observations = episode.look(ALL)
        assert [set(observed.audible_tags) for observed in observations] == [
            {observations[j].own_tag for j in row if j >= 0} for row in heard
        ]
        fewer += sum(len(observed.audible_tags) for observed in whole.look(ALL)) > (heard >= 0).sum()
        assert episode.advance().links == (heard >= 0).sum()
        whole.advance()
    assert fewer > 5


def test_tags_are_new_in_every_tick(episode):
    seen = [observed.own_tag for _ in range(20) for observed in episode.look(ALL)]
    assert len(set(seen)) == len(seen)


def test_answers_move_their_own_robots_and_the_silent_stay(episode):
    observations = episode.look(ALL)
    before = episode.simulator.position.copy()
    for robot in (2, 0):
        assert episode.answer(observations[robot].own_tag, ReceivedPreference(Primitive.UP, 0, 100)) is None
    np.testing.assert_array_equal(episode.answered, [True, False, True, False, False, False])
    outcome = episode.advance()
    np.testing.assert_array_equal(outcome.actions, [1, 0, 1, 0, 0, 0])
    np.testing.assert_array_equal(outcome.silent, ~np.array([True, False, True, False, False, False]))
    np.testing.assert_array_equal(episode.simulator.position[[1, 3, 4, 5]], before[[1, 3, 4, 5]])
    assert episode.silent == 4
    assert episode.bytes_per_tick == 100


def test_missing_features_are_those_announced_and_not_fused(episode):
    observations = episode.look(ALL)
    audible = [len(observed.audible_tags) for observed in observations]
    for observed, count in zip(observations, audible, strict=True):
        episode.answer(observed.own_tag, ReceivedPreference(0, max(count - 1, 0), 1))
    episode.advance()
    assert episode.features_missing == sum(count > 0 for count in audible) > 0


def test_nonsense_is_dropped_and_the_robot_may_still_answer(episode):
    old = episode.look(ALL)[0].own_tag
    tag = episode.look(ALL)[0].own_tag
    assert "not given out" in str(episode.answer(old, ReceivedPreference(0, 0, 0)))
    assert "primitive 5" in str(episode.answer(tag, ReceivedPreference(5, 0, 0)))
    assert episode.answer(tag, ReceivedPreference(0, 0, 0)) is None
    assert "second" in str(episode.answer(tag, ReceivedPreference(1, 0, 0)))
    assert episode.advance().actions[0] == 0


def test_what_is_relayed_reaches_the_neighbours_that_are_present(episode):
    heard = neighbours(np.zeros(ROBOTS, dtype=np.int64), episode.simulator.position)
    assert 0 < (heard >= 0).sum() < ROBOTS * (ROBOTS - 1)
    for present in (ALL, np.arange(ROBOTS) % 2 == 0):
        observations = episode.look(present)
        for number in range(2):
            for robot in np.flatnonzero(present)[::-1]:
                assert not episode.relay.complete
                assert episode.relay.receive(number, observations[robot].own_tag, 0, bytes([robot])) is None
            assert episode.relay.complete
            for row, bundle in zip(heard, episode.relayed(), strict=True):
                assert sorted(bundle.payloads) == [bytes([j]) for j in row if j >= 0 and present[j]]


def test_what_is_relayed_is_as_much_as_was_announced(episode):
    observations = episode.look(ALL)
    for observed in observations:
        episode.relay.receive(0, observed.own_tag, 0, b"x")
    assert [len(bundle.payloads) for bundle in episode.relayed()] == [
        len(observed.audible_tags) for observed in observations
    ]


def test_relaying_draws_nothing_from_the_streams_of_robots_and_shield():
    case = draw_case(5, 0, 12, 12, ROBOTS)
    streams = [episode_streams(5, 0, ROBOTS) for _ in range(2)]
    direct, relayed = (DistributedEpisode(case, 50, own) for own in streams)
    for _ in range(10):
        for run in (direct, relayed):
            observations = run.look(ALL)
            for observed in observations:
                run.relay.receive(0, observed.own_tag, 0, b"x")
            if run is relayed:
                assert sum(len(bundle.payloads) for bundle in run.relayed()) > ROBOTS
            for robot, observed in enumerate(observations):
                run.answer(observed.own_tag, ReceivedPreference(robot % 5, 0, 0))
            run.advance()
        np.testing.assert_array_equal(relayed.simulator.position, direct.simulator.position)
        assert streams[0].shield.bit_generator.state == streams[1].shield.bit_generator.state
        np.testing.assert_array_equal(streams[0].robots, streams[1].robots)


def test_tags_of_the_tick_before_are_not_relayed(episode):
    old = episode.look(ALL)
    new = episode.look(ALL)
    assert "not given out" in str(episode.relay.receive(0, old[0].own_tag, 0, b"x"))
    assert episode.relay.receive(0, new[0].own_tag, 0, b"x") is None
