# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The interface between a robot and its policy, the same for all backends. Free of torch."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from magat_robot.policy.config import OBSERVATION_SHAPE, PolicyConfig

#: Robots in one batch of the CNN: larger batches exceed the processor's cache.
CHUNK = 256


@dataclass(frozen=True)
class LatentState:
    """The state of R robots between two rounds of messages, with the messages that they send next."""

    #: State of the network in the backend's own form, a dataclass (`NodeState` in torch); never sent.
    state: Any
    #: ``[R, n]`` float32, n of `PolicyConfig.message_sizes`: the message of each robot in the next round; n is 0 after
    #: the last round. In the first round it is the features x, which float16 represents exactly.
    messages: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Decision:
    """The probabilities and the drawn actions of R robots."""

    #: ``[R, 5]`` float64 whole numbers proportional to the probabilities of the primitives.
    weights: npt.NDArray[np.float64]
    #: ``[R]`` int64, the primitives drawn.
    primitives: npt.NDArray[np.int64]

    @property
    def log_probabilities(self) -> npt.NDArray[np.float32]:
        """``[R, 5]`` natural logarithms of the probabilities; a weight of 0 counts as 0.5, so that all are finite."""
        share = np.maximum(self.weights, 0.5) / self.weights.sum(axis=1, keepdims=True)
        return np.log(share).astype(np.float32)


class RobotPolicy(Protocol):
    """A loaded policy: `perceive` once a tick, `hear` once a round of messages, then `decide`.

    Results are the same to the last bit for every backend, every batch size and every order of messages.
    """

    config: PolicyConfig
    #: SHA-256 of the weights, hexadecimal.
    digest: str

    def perceive(self, field_of_view: npt.NDArray[np.uint8]) -> LatentState:
        """Compute features and the first messages from the observations.

        Args:
            field_of_view: ``[R, 3, 11, 11]`` of 0 and 1.

        Raises:
            ValueError: another shape, or other values. Exact sums depend on both.
        """

    def hear(self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]) -> LatentState:
        """Process one round of messages.

        Args:
            own: state of the R robots before the round.
            messages: ``[R, M, n]`` the messages that each robot received, in any order; M may be 0.
            present: ``[R, M]`` which of the M places hold a message.
        """

    def decide(
        self,
        own: LatentState,
        streams: npt.NDArray[np.uint64],
        tick: int,
        visits: npt.NDArray[np.int64] | None = None,
    ) -> Decision:
        """Weigh the primitives after the last round and draw one a robot.

        Args:
            own: state of the R robots after the last round.
            streams: ``[R]`` seeds of the robots' random streams.
            tick: from 0; each tick has its own draw.
            visits: ``[R, 4]`` earlier visits of the cells that moves lead to, see `VisitMemory`; None: none.
        """


def check_field_of_view(field_of_view: npt.NDArray[np.uint8]) -> None:
    """Check the argument of `RobotPolicy.perceive`.

    Raises:
        ValueError: another shape than ``[R, 3, 11, 11]``, or other values than 0 and 1.
    """
    if field_of_view.shape[1:] != OBSERVATION_SHAPE:
        raise ValueError(f"a field of view has the shape {OBSERVATION_SHAPE}, not {field_of_view.shape[1:]}")
    if field_of_view.size and field_of_view.max() > 1:
        raise ValueError(f"a field of view holds 0 and 1, not {field_of_view.max()}")
