"""A policy that computes nothing: what a team does without its network, to measure what the rest costs."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from magat_robot.policy.config import PRIMITIVES
from magat_robot.policy.folder import read_folder
from magat_robot.policy.interface import Decision, Encoding
from magat_robot.policy.sampling import choose, uniform


class EchoPolicy:
    """A `RobotPolicy` that sends messages of the size of another's, all zeros, and walks at random."""

    def __init__(self, folder: Path, **changes: Any) -> None:
        """Take over the configuration in ``folder``; ``changes`` as for `load_policy`.

        Raises:
            ModelError: it is no policy folder.
        """
        config, self.digest, _ = read_folder(folder)
        self.config = config.deployed(**changes)

    def encode(self, view: npt.NDArray[np.uint8]) -> Encoding:
        """See `RobotPolicy.encode`."""
        return self._after(0, len(view))

    def hear(self, own: Encoding, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]) -> Encoding:
        """See `RobotPolicy.hear`."""
        return self._after(own.thought + 1, len(own.messages))

    def decide(self, own: Encoding, streams: npt.NDArray[np.uint64], tick: int) -> Decision:
        """See `RobotPolicy.decide`."""
        weights = np.ones((len(own.messages), PRIMITIVES))
        return Decision(weights, choose(weights, uniform(streams, tick)))

    def _after(self, rounds: int, robots: int) -> Encoding:
        sizes = (*self.config.message_sizes, 0)
        return Encoding(rounds, np.zeros((robots, sizes[rounds]), dtype=np.float32))
