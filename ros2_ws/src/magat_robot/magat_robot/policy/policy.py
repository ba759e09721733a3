"""A policy computed by torch: the reference."""

import numpy as np
import numpy.typing as npt
import torch

from magat_robot.policy import fixed_point as fp
from magat_robot.policy import payload
from magat_robot.policy.config import OBSERVATION_SHAPE, PRIMITIVES, PolicyConfig
from magat_robot.policy.interface import Decision, LatentState
from magat_robot.policy.latent_cache import LatentCache
from magat_robot.policy.network import NodeState, PolicyNetwork, to_fixed_point
from magat_robot.policy.sampling import choose, uniform

#: Robots computed in one go: larger batches fall out of the processor's cache.
_CHUNK = 256


class Policy:
    """The deployed form of a trained network, a `RobotPolicy`; `store.load` makes one of a folder."""

    def __init__(self, network: PolicyNetwork, digest: str = "") -> None:
        """Deploy a copy of ``network``; ``digest`` names its weights."""
        self.config: PolicyConfig = network.config
        self.digest = digest
        self._network = to_fixed_point(network)
        self._cache = LatentCache(self.perceive)

    @torch.inference_mode()
    def perceive(self, view: npt.NDArray[np.uint8]) -> LatentState:
        """Look.

        Args:
            view: ``[R, 3, 11, 11]`` of 0 and 1.

        Raises:
            ValueError: another shape, or other values: exact sums rest on them.
        """
        if view.shape[1:] != OBSERVATION_SHAPE:
            raise ValueError(f"an observation has shape {OBSERVATION_SHAPE}, not {view.shape[1:]}")
        if view.size and view.max() > 1:
            raise ValueError(f"an observation holds 0 and 1, not {view.max()}")
        inputs = torch.from_numpy(view.astype(np.float32)).contiguous(memory_format=torch.channels_last)
        parts = [self._network.look(chunk) for chunk in inputs.split(_CHUNK)]
        features, x, total = (torch.cat([getattr(part, name) for part in parts]) for name in ("features", "x", "total"))
        return self._encoding(NodeState(features, 0, x, None, total))

    @torch.inference_mode()
    def hear(self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]) -> LatentState:
        """One round of messages, of those that a tick has.

        Args:
            own: of the R robots.
            messages: ``[R, M, n]`` what each heard, in any order; M may be 0.
            present: ``[R, M]`` which of the M places hold a message.
        """
        # What stands in empty places must not matter, and NaN times 0 would.
        heard = torch.from_numpy(np.where(present[:, :, None], messages, np.float32(0))).double()
        return self._encoding(self._network.hear(own.state, heard, torch.from_numpy(present)))

    @torch.inference_mode()
    def attention(
        self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.float64]:
        """How much each robot listens to each message: ``[R, P, M]``, 0 in empty places; arguments as of `hear`.

        Raises:
            ValueError: robots of this policy do not talk.
        """
        heard = torch.from_numpy(messages).double()
        return self._network.attention(own.state, heard, torch.from_numpy(present)).numpy()

    @torch.inference_mode()
    def weights(self, own: LatentState) -> npt.NDArray[np.float64]:
        """After the last round: ``[R, 5]`` whole numbers proportional to softmax(logits / T)."""
        logits = self._network.logits(own.state)
        exponents = fp.snap(logits / self.config.temperature, fp.EXPONENT_BITS, -1e6, 1e6)
        weights = fp.exp_weights(exponents).numpy()
        assert weights.shape == (len(own.messages), PRIMITIVES)
        return weights

    def decide(self, own: LatentState, streams: npt.NDArray[np.uint64], tick: int) -> Decision:
        """After the last round: as `weights`, then one draw from each robot's stream (``[R]``) for ``tick``."""
        weights = self.weights(own)
        return Decision(weights, choose(weights, uniform(streams, tick)))

    def decide_together(
        self, view: npt.NDArray[np.uint8], heard: npt.NDArray[np.int64], streams: npt.NDArray[np.uint64], tick: int
    ) -> Decision:
        """R robots at once, the exchange in between: row i hears the rows ``heard[i]`` (``[R, M]``, -1 for none).

        Views that were there in the call before are not computed again.
        """
        own, rows, present = self._cache.perceive(view), np.maximum(heard, 0), heard >= 0
        for _ in range(self.rounds):
            own = self.hear(own, payload.carried(own.messages, self.config.encoding)[rows], present)
        return self.decide(own, streams, tick)

    @property
    def rounds(self) -> int:
        """Rounds of messages in a tick."""
        return self._network.rounds

    def _encoding(self, state: NodeState) -> LatentState:
        finished = state.rounds == self.rounds
        messages = state.x[:, :0] if finished else self._network.message(state)
        return LatentState(state, messages.float().numpy())
