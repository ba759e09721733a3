# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The backend echo: no network, for measuring the cost of everything around it."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from magat_robot.policy.config import PRIMITIVES
from magat_robot.policy.folder import read_folder
from magat_robot.policy.grids import EXP_TABLE_BITS
from magat_robot.policy.interface import Decision, LatentState
from magat_robot.policy.sampling import choose, uniform
from magat_robot.policy.visit_memory import lowered


class EchoPolicy:
    """A `RobotPolicy` that computes nothing: its messages are zeros of the right size, its actions uniform draws."""

    def __init__(self, folder: Path, **changes: Any) -> None:
        """Read the configuration in ``folder``.

        Args:
            folder: policy folder.
            changes: see `load_policy`.

        Raises:
            ModelError: ``folder`` is no policy folder.
        """
        config, self.digest, _ = read_folder(folder)
        self.config = config.with_changes(**changes)

    def perceive(self, field_of_view: npt.NDArray[np.uint8]) -> LatentState:
        """See `RobotPolicy.perceive`."""
        return self._after(0, len(field_of_view))

    def hear(self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]) -> LatentState:
        """See `RobotPolicy.hear`."""
        return self._after(own.state + 1, len(own.messages))

    def decide(
        self,
        own: LatentState,
        streams: npt.NDArray[np.uint64],
        tick: int,
        visits: npt.NDArray[np.int64] | None = None,
    ) -> Decision:
        """See `RobotPolicy.decide`."""
        equal = np.full((len(own.messages), PRIMITIVES), 2.0**EXP_TABLE_BITS)
        weights = lowered(equal, visits, self.config.visit_memory)
        return Decision(weights, choose(weights, uniform(streams, tick)))

    def _after(self, rounds: int, robots: int) -> LatentState:
        sizes = (*self.config.message_sizes, 0)
        return LatentState(rounds, np.zeros((robots, sizes[rounds]), dtype=np.float32))
