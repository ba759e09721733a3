"""The random streams of an episode."""

import numpy as np

from magat_sim.streams import EpisodeStreams, episode_streams


def draws(streams: EpisodeStreams) -> list:
    return [streams.shield.random(4).tolist(), streams.tags.random(4).tolist(), streams.robots.tolist()]


def test_one_seed_and_number_always_give_the_same_streams() -> None:
    assert draws(episode_streams(2021, 5, 8)) == draws(episode_streams(2021, 5, 8))


def test_every_machine_derives_the_same_streams() -> None:
    streams = episode_streams(2021, 0, 2)
    assert streams.robots.dtype == np.uint64
    assert streams.robots.tolist() == [2257124868553747245, 5253285458400783194]
    assert float(streams.shield.random()) == 0.5373547122195831


def test_no_two_streams_of_many_episodes_are_alike() -> None:
    robots, first_draws = [], []
    for seed in range(5):
        for number in range(100):
            streams = episode_streams(seed, number, 10)
            robots += streams.robots.tolist()
            first_draws += [float(streams.shield.random()), float(streams.tags.random())]
    assert len(set(robots)) == 5 * 100 * 10
    assert len(set(first_draws)) == 5 * 100 * 2


def test_an_episode_does_not_repeat_the_draws_that_made_its_case() -> None:
    making = np.random.Generator(np.random.PCG64(np.random.SeedSequence([3, 4]))).random(1000)
    streams = episode_streams(3, 4, 2)
    assert not np.isin(making, [streams.shield.random(1000), streams.tags.random(1000)]).any()
