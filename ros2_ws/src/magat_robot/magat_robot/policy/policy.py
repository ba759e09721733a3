# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The backend torch: the reference implementation of `RobotPolicy`."""

import numpy as np
import numpy.typing as npt
import torch

from magat_robot.policy import fixed_point as fp
from magat_robot.policy.computed import ComputedPolicy
from magat_robot.policy.config import PRIMITIVES
from magat_robot.policy.interface import CHUNK, LatentState, check_field_of_view
from magat_robot.policy.network import NodeState, PolicyNetwork, to_fixed_point


class Policy(ComputedPolicy):
    """A trained network in fixed point, computed by torch; `store.load` loads one from a folder."""

    def __init__(self, network: PolicyNetwork, digest: str = "") -> None:
        """Convert a copy of ``network`` to fixed point; ``digest`` identifies its weights.

        Raises:
            ValueError: as `to_fixed_point`.
        """
        super().__init__(network.config, digest)
        self._network = to_fixed_point(network)

    @torch.inference_mode()
    def perceive(self, field_of_view: npt.NDArray[np.uint8]) -> LatentState:
        """See `RobotPolicy.perceive`."""
        check_field_of_view(field_of_view)
        inputs = torch.from_numpy(field_of_view.astype(np.float32)).contiguous(memory_format=torch.channels_last)
        parts = [self._network.perceive(chunk) for chunk in inputs.split(CHUNK)]
        features, x, total = (torch.cat([getattr(part, name) for part in parts]) for name in ("features", "x", "total"))
        return self._latent_state(NodeState(features, 0, x, None, total))

    @torch.inference_mode()
    def hear(self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]) -> LatentState:
        """See `RobotPolicy.hear`."""
        # Empty places may hold anything, and NaN times 0 is NaN.
        heard = torch.from_numpy(np.where(present[:, :, None], messages, np.float32(0))).double()
        return self._latent_state(self._network.hear(own.state, heard, torch.from_numpy(present)))

    @torch.inference_mode()
    def attention(
        self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.float64]:
        """See `ComputedPolicy.attention`."""
        heard = torch.from_numpy(messages).double()
        return self._network.attention(own.state, heard, torch.from_numpy(present)).numpy()

    @torch.inference_mode()
    def weights(self, own: LatentState) -> npt.NDArray[np.float64]:
        """See `ComputedPolicy.weights`."""
        logits = self._network.logits(own.state)
        exponents = fp.snap(logits / self.config.temperature, fp.EXPONENT_BITS, -1e6, 1e6)
        weights = fp.exp_weights(exponents).numpy()
        assert weights.shape == (len(own.messages), PRIMITIVES)
        return weights

    def _latent_state(self, state: NodeState) -> LatentState:
        finished = state.rounds == self.rounds
        messages = state.x[:, :0] if finished else self._network.message(state)
        return LatentState(state, messages.float().numpy())
