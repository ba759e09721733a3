"""The random streams of an episode, all derived from a seed and a number."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class EpisodeStreams:
    """The random streams of an episode. The same seed and number give the same streams."""

    #: Decides which of several robots gets a contested cell.
    shield: np.random.Generator
    #: Draws the one-time tags of messages and their order.
    tags: np.random.Generator
    #: ``[N]`` uint64, the seed of each robot's own stream; each robot receives only its own.
    robots: npt.NDArray[np.uint64]


def episode_streams(seed: int, number: int, robots: int) -> EpisodeStreams:
    """The streams of episode ``number`` under ``seed`` for a team of ``robots``; independent of the case."""
    # The spawn key separates these streams from the one that draws the case of the same seed and number.
    state = (
        np.random.SeedSequence([seed, number], spawn_key=(1,)).generate_state(robots + 2, np.uint64).astype(np.uint64)
    )
    return EpisodeStreams(
        shield=np.random.Generator(np.random.PCG64(int(state[0]))),
        tags=np.random.Generator(np.random.PCG64(int(state[1]))),
        robots=state[2:],
    )
