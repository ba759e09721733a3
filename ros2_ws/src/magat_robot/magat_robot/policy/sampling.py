# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Draws primitives from weights; each robot has its own repeatable stream of random numbers."""

import numpy as np
import numpy.typing as npt

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def uniform(stream: npt.ArrayLike, tick: int) -> npt.NDArray[np.float64]:
    """The random number of each robot at ``tick``.

    The generator is counter-based (SplitMix64, Steele et al., OOPSLA 2014), so a robot that is restarted during an
    episode draws the same numbers as without the restart.

    Args:
        stream: ``[R]`` uint64, the seeds of the robots' streams.
        tick: from 0.

    Returns:
        ``[R]`` float64 in [0, 1), multiples of 2**-53.
    """
    with np.errstate(over="ignore"):
        z = np.asarray(stream, dtype=np.uint64) + np.uint64(tick + 1) * _GOLDEN
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    return (z >> np.uint64(11)).astype(np.float64) * 2.0**-53


def choose(weights: npt.NDArray[np.float64], draws: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """Choose one alternative a row, with probabilities proportional to the weights.

    Args:
        weights: ``[R, A]`` whole numbers below 2**50; at least one in each row is above 0.
        draws: ``[R]`` in [0, 1).

    Returns:
        ``[R]`` int64 in [0, A); an alternative of weight 0 is never chosen.
    """
    cumulative = weights.cumsum(axis=1)
    ticket = np.floor(draws * cumulative[:, -1])
    return (cumulative <= ticket[:, None]).sum(axis=1).astype(np.int64)
