# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The random streams of an episode."""

import hashlib

import numpy as np
import pytest

from magat_sim.streams import EpisodeStreams, InvalidSecretError, episode_streams

SECRET = bytes(range(32))


def draws(streams: EpisodeStreams) -> list:
    return [streams.shield.random(4).tolist(), streams.robots.tolist()]


@pytest.mark.parametrize("secret", [None, SECRET], ids=["no secret", "a secret"])
def test_one_seed_number_and_secret_always_give_the_same_streams(secret: bytes | None) -> None:
    assert draws(episode_streams(2021, 5, 8, secret)) == draws(episode_streams(2021, 5, 8, secret))


def test_every_machine_derives_the_same_streams() -> None:
    streams = episode_streams(2021, 0, 2)
    assert streams.robots.dtype == np.uint64
    assert streams.robots.tolist() == [2257124868553747245, 5253285458400783194]
    assert float(streams.shield.random()) == 0.5373547122195831


def test_every_machine_derives_the_same_streams_from_a_secret() -> None:
    streams = episode_streams(2021, 0, 2, SECRET)
    assert streams.robots.dtype == np.uint64
    hashes = [
        hashlib.blake2b(f"robot {i} of 2021/0".encode(), digest_size=8, key=SECRET, person=b"magat.streams").digest()
        for i in range(2)
    ]
    assert streams.robots.tolist() == [int.from_bytes(data, "little") for data in hashes]
    assert float(streams.shield.random()) == 0.7280317377989249


@pytest.mark.parametrize("secret", [None, SECRET], ids=["no secret", "a secret"])
def test_no_two_streams_of_many_episodes_are_alike(secret: bytes | None) -> None:
    robots, first_draws = [], []
    for seed in range(5):
        for number in range(100):
            streams = episode_streams(seed, number, 10, secret)
            robots += streams.robots.tolist()
            first_draws.append(float(streams.shield.random()))
    assert len(set(robots)) == 5 * 100 * 10
    assert len(set(first_draws)) == 5 * 100


def test_another_bit_of_the_secret_gives_other_streams() -> None:
    secrets = [SECRET, *(bytes([SECRET[0] ^ 1 << bit]) + SECRET[1:] for bit in range(8)), bytes(32)]
    every = [episode_streams(1, 2, 5, secret) for secret in secrets] + [episode_streams(1, 2, 5)]
    assert len({robot for streams in every for robot in streams.robots.tolist()}) == 5 * len(every)
    assert len({float(streams.shield.random()) for streams in every}) == len(every)


@pytest.mark.parametrize("length", [0, 31, 33])
def test_a_secret_of_another_length_is_refused(length: int) -> None:
    with pytest.raises(InvalidSecretError, match=f"the secret has {length} bytes: give 32, or none"):
        episode_streams(1, 0, 2, bytes(length))


def test_an_episode_does_not_repeat_the_draws_that_made_its_case() -> None:
    making = np.random.Generator(np.random.PCG64(np.random.SeedSequence([3, 4]))).random(1000)
    assert not np.isin(making, episode_streams(3, 4, 2).shield.random(1000)).any()
