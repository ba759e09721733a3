# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the backends that compute a policy have in common. Free of torch and onnxruntime."""

from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from magat_robot.policy import payload
from magat_robot.policy.config import PolicyConfig
from magat_robot.policy.interface import Decision, LatentState
from magat_robot.policy.latent_cache import LatentCache
from magat_robot.policy.sampling import choose, uniform
from magat_robot.policy.visit_memory import lowered


class ComputedPolicy(ABC):
    """A `RobotPolicy` with a network; it also gives attention, and decides for many robots together."""

    def __init__(self, config: PolicyConfig, digest: str) -> None:
        """Keep the configuration and the digest of the weights (SHA-256, hexadecimal)."""
        self.config = config
        self.digest = digest
        self._cache = LatentCache(self.perceive)

    @abstractmethod
    def perceive(self, field_of_view: npt.NDArray[np.uint8]) -> LatentState:
        """See `RobotPolicy.perceive`."""

    @abstractmethod
    def hear(self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]) -> LatentState:
        """See `RobotPolicy.hear`."""

    @abstractmethod
    def attention(
        self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.float64]:
        """Attention weights of a round: ``[R, P, M]``, 0 in empty places; arguments as for `hear`.

        Raises:
            ValueError: robots with this policy send no messages (K = 1).
        """

    @abstractmethod
    def weights(self, own: LatentState) -> npt.NDArray[np.float64]:
        """After the last round: ``[R, 5]`` float64 whole numbers proportional to softmax(logits / T)."""

    @property
    def rounds(self) -> int:
        """Rounds of messages in a tick."""
        return len(self.config.message_sizes)

    def decide(
        self,
        own: LatentState,
        streams: npt.NDArray[np.uint64],
        tick: int,
        visits: npt.NDArray[np.int64] | None = None,
    ) -> Decision:
        """See `RobotPolicy.decide`."""
        weights = lowered(self.weights(own), visits, self.config.visit_memory)
        return Decision(weights, choose(weights, uniform(streams, tick)))

    def decide_together(
        self,
        field_of_view: npt.NDArray[np.uint8],
        heard: npt.NDArray[np.int64],
        streams: npt.NDArray[np.uint64],
        tick: int,
        visits: npt.NDArray[np.int64] | None = None,
    ) -> Decision:
        """A whole tick of R robots, with the exchange of messages among them.

        Fields of view that were there in the call before are not computed again.

        Args:
            field_of_view: ``[R, 3, 11, 11]`` of 0 and 1.
            heard: ``[R, M]`` the rows that each robot hears, -1 for none.
            streams: ``[R]`` seeds of the robots' random streams.
            tick: from 0.
            visits: ``[R, 4]``, see `RobotPolicy.decide`.
        """
        own, rows, present = self._cache.perceive(field_of_view), np.maximum(heard, 0), heard >= 0
        for _ in range(self.rounds):
            own = self.hear(own, payload.round_trip(own.messages, self.config.encoding)[rows], present)
        return self.decide(own, streams, tick, visits)
