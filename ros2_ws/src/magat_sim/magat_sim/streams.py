# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The random streams of an episode, all derived from a seed, a number and, in a team of processes, a secret.

Without a secret the streams come from NumPy's `SeedSequence`, which everybody can compute. A robot that tries all
likely seeds and numbers finds its own stream among the results, and with it those of all others. `SeedSequence` is
made for good statistics, not to resist a search or an inversion.

With a secret, each stream is a hash of its own, keyed with the secret (BLAKE2b, RFC 7693). For those without the
256-bit key, the streams are as good as independent random numbers, even if they know seed, number and other streams.
So a robot's stream tells it nothing about the streams of others.
"""

import hashlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from magat_node.errors import MagatError

#: Length of an episode's secret.
SECRET_BYTES = 32


class InvalidSecretError(MagatError):
    """The secret of an episode has the wrong length."""


def check_secret(secret: bytes) -> bytes:
    """The secret itself.

    Raises:
        InvalidSecretError: it has not `SECRET_BYTES` bytes.
    """
    if len(secret) != SECRET_BYTES:
        raise InvalidSecretError(f"the secret has {len(secret)} bytes: give {SECRET_BYTES}, or none, to have one drawn")
    return secret


@dataclass(frozen=True)
class EpisodeStreams:
    """The random streams of an episode. The same seed, number and secret give the same streams."""

    #: Decides which of several robots gets a contested cell.
    shield: np.random.Generator
    #: ``[N]`` uint64, the seed of each robot's own stream; each robot receives only its own.
    robots: npt.NDArray[np.uint64]


def episode_streams(seed: int, number: int, robots: int, secret: bytes | None = None) -> EpisodeStreams:
    """The streams of an episode; independent of the case.

    Args:
        seed: not negative.
        number: of the episode under that seed, not negative.
        robots: N.
        secret: `SECRET_BYTES` bytes that the robots do not know. None where nothing has to be hidden from robots, as
            in the batched simulator.

    Raises:
        InvalidSecretError: a secret of another length.
    """
    if secret is None:
        # The spawn key separates these streams from the one that draws the case of the same seed and number. The second
        # number is not used.
        sequence = np.random.SeedSequence([seed, number], spawn_key=(1,))
        state = sequence.generate_state(robots + 2, np.uint64).astype(np.uint64)
        return EpisodeStreams(np.random.Generator(np.random.PCG64(int(state[0]))), state[2:])
    check_secret(secret)

    def derived(purpose: str, size: int) -> bytes:
        message = f"{purpose} of {seed}/{number}".encode()
        return hashlib.blake2b(message, digest_size=size, key=secret, person=b"magat.streams").digest()

    shield = np.random.PCG64(int.from_bytes(derived("shield", 16), "little"))
    own = b"".join(derived(f"robot {robot}", 8) for robot in range(robots))
    return EpisodeStreams(np.random.Generator(shield), np.frombuffer(own, dtype="<u8").astype(np.uint64))
