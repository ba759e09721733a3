"""What a robot asks of its policy, whatever computes it. Free of torch."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from magat_robot.policy.config import PolicyConfig


@dataclass(frozen=True)
class LatentState:
    """What R robots know after looking, and after each round of messages; and what they send next."""

    #: What they have made of the tick so far, in the form that the backend likes; never sent.
    state: Any
    #: ``[R, n]`` float32, n of `PolicyConfig.message_sizes`: what each sends. In the first round these are the features
    #: x, whose values are exact in float16, too.
    messages: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Decision:
    """What R robots decide."""

    #: ``[R, 5]`` float64 whole numbers proportional to the probabilities of the primitives.
    weights: npt.NDArray[np.float64]
    #: ``[R]`` int64, the primitives drawn.
    primitives: npt.NDArray[np.int64]

    @property
    def log_probabilities(self) -> npt.NDArray[np.float32]:
        """``[R, 5]`` natural logarithms of the probabilities; one that rounds to 0 counts as half a unit."""
        share = np.maximum(self.weights, 0.5) / self.weights.sum(axis=1, keepdims=True)
        return np.log(share).astype(np.float32)


class RobotPolicy(Protocol):
    """A policy as robots carry it: observation -> message, messages -> (next message, ...) decision.

    Its results do not depend on what computes it, on how many robots are computed together or on the order of messages,
    to the last bit.
    """

    config: PolicyConfig
    #: SHA-256 of the weights, hexadecimal.
    digest: str

    def perceive(self, view: npt.NDArray[np.uint8]) -> LatentState:
        """Look: ``[R, 3, 11, 11]`` of 0 and 1.

        Raises:
            ValueError: another shape, or other values: exact sums rest on them.
        """

    def hear(self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]) -> LatentState:
        """One round of messages, of those that a tick has.

        Args:
            own: of the R robots.
            messages: ``[R, M, n]`` what each heard, in any order; M may be 0.
            present: ``[R, M]`` which of the M places hold a message.
        """

    def decide(self, own: LatentState, streams: npt.NDArray[np.uint64], tick: int) -> Decision:
        """After the last round: weigh the primitives, and draw from each robot's stream (``[R]``) for ``tick``."""
