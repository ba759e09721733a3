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


def test_sights_are_what_the_simulator_shows(episode):
    observation = episode.simulator.observe()
    sights = episode.look(ALL)
    for sight, view, stream in zip(sights, observation.field_of_view, observation.streams, strict=True):
        np.testing.assert_array_equal(sight.field_of_view, view)
        assert sight.stream == stream


def test_audible_tags_are_those_of_the_neighbours_that_are_present(episode):
    heard = neighbours(np.zeros(ROBOTS, dtype=np.int64), episode.simulator.position)
    for present in (ALL, np.arange(ROBOTS) % 2 == 0):
        sights = episode.look(present)
        for row, sight in zip(heard, sights, strict=True):
            expected = {sights[j].own_tag for j in row if j >= 0 and present[j]}
            assert set(sight.audible_tags) == expected
            assert len(sight.audible_tags) == len(expected)


def test_lost_links_are_not_announced_and_are_those_of_the_simulator():
    case = draw_case(5, 0, 12, 12, ROBOTS)
    episode, whole = (DistributedEpisode(case, 50, episode_streams(5, 0, ROBOTS), Rules(loss)) for loss in (0.5, 0.0))
    fewer = 0
    for _ in range(10):
        heard = episode.simulator.observe().heard
        sights = episode.look(ALL)
        assert [set(sight.audible_tags) for sight in sights] == [
            {sights[j].own_tag for j in row if j >= 0} for row in heard
        ]
        fewer += sum(len(sight.audible_tags) for sight in whole.look(ALL)) > (heard >= 0).sum()
        assert episode.advance().links == (heard >= 0).sum()
        whole.advance()
    assert fewer > 5


def test_tags_are_new_in_every_tick(episode):
    seen = [sight.own_tag for _ in range(20) for sight in episode.look(ALL)]
    assert len(set(seen)) == len(seen)


def test_answers_move_their_own_robots_and_the_silent_stay(episode):
    sights = episode.look(ALL)
    before = episode.simulator.position.copy()
    for robot in (2, 0):
        assert episode.answer(sights[robot].own_tag, ReceivedPreference(Primitive.UP, 0, 100)) is None
    np.testing.assert_array_equal(episode.answered, [True, False, True, False, False, False])
    outcome = episode.advance()
    np.testing.assert_array_equal(outcome.actions, [1, 0, 1, 0, 0, 0])
    np.testing.assert_array_equal(outcome.silent, ~np.array([True, False, True, False, False, False]))
    np.testing.assert_array_equal(episode.simulator.position[[1, 3, 4, 5]], before[[1, 3, 4, 5]])
    assert episode.silent == 4
    assert episode.bytes_per_tick == 100


def test_missing_features_are_those_announced_and_not_fused(episode):
    sights = episode.look(ALL)
    audible = [len(sight.audible_tags) for sight in sights]
    for sight, count in zip(sights, audible, strict=True):
        episode.answer(sight.own_tag, ReceivedPreference(0, max(count - 1, 0), 1))
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
        sights = episode.look(present)
        for number in range(2):
            for robot in np.flatnonzero(present)[::-1]:
                assert not episode.relay.complete
                assert episode.relay.receive(number, sights[robot].own_tag, 0, bytes([robot])) is None
            assert episode.relay.complete
            for row, bundle in zip(heard, episode.relayed(), strict=True):
                assert sorted(bundle.payloads) == [bytes([j]) for j in row if j >= 0 and present[j]]


def test_what_is_relayed_is_as_much_as_was_announced(episode):
    sights = episode.look(ALL)
    for sight in sights:
        episode.relay.receive(0, sight.own_tag, 0, b"x")
    assert [len(bundle.payloads) for bundle in episode.relayed()] == [len(sight.audible_tags) for sight in sights]


def test_relaying_draws_nothing_from_the_streams_of_robots_and_shield():
    case = draw_case(5, 0, 12, 12, ROBOTS)
    streams = [episode_streams(5, 0, ROBOTS) for _ in range(2)]
    direct, relayed = (DistributedEpisode(case, 50, own) for own in streams)
    for _ in range(10):
        for run in (direct, relayed):
            sights = run.look(ALL)
            for sight in sights:
                run.relay.receive(0, sight.own_tag, 0, b"x")
            if run is relayed:
                assert sum(len(bundle.payloads) for bundle in run.relayed()) > ROBOTS
            for robot, sight in enumerate(sights):
                run.answer(sight.own_tag, ReceivedPreference(robot % 5, 0, 0))
            run.advance()
        np.testing.assert_array_equal(relayed.simulator.position, direct.simulator.position)
        assert streams[0].shield.bit_generator.state == streams[1].shield.bit_generator.state
        np.testing.assert_array_equal(streams[0].robots, streams[1].robots)


def test_tags_of_the_tick_before_are_not_relayed(episode):
    old = episode.look(ALL)
    new = episode.look(ALL)
    assert "not given out" in str(episode.relay.receive(0, old[0].own_tag, 0, b"x"))
    assert episode.relay.receive(0, new[0].own_tag, 0, b"x") is None
