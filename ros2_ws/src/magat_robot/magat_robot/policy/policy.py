"""The backend torch: the reference implementation of `RobotPolicy`."""

import numpy as np
import numpy.typing as npt
import torch

from magat_robot.policy import fixed_point as fp
from magat_robot.policy import payload
from magat_robot.policy.config import PRIMITIVES, PolicyConfig
from magat_robot.policy.interface import Decision, LatentState, check_field_of_view
from magat_robot.policy.latent_cache import LatentCache
from magat_robot.policy.network import NodeState, PolicyNetwork, to_fixed_point
from magat_robot.policy.sampling import choose, uniform

#: Robots in one batch of the CNN: larger batches exceed the processor's cache.
_CHUNK = 256


class Policy:
    """A trained network in fixed point, computed by torch; `store.load` loads one from a folder."""

    def __init__(self, network: PolicyNetwork, digest: str = "") -> None:
        """Convert a copy of ``network`` to fixed point; ``digest`` identifies its weights.

        Raises:
            ValueError: as `to_fixed_point`.
        """
        self.config: PolicyConfig = network.config
        self.digest = digest
        self._network = to_fixed_point(network)
        self._cache = LatentCache(self.perceive)

    @torch.inference_mode()
    def perceive(self, field_of_view: npt.NDArray[np.uint8]) -> LatentState:
        """See `RobotPolicy.perceive`."""
        check_field_of_view(field_of_view)
        inputs = torch.from_numpy(field_of_view.astype(np.float32)).contiguous(memory_format=torch.channels_last)
        parts = [self._network.perceive(chunk) for chunk in inputs.split(_CHUNK)]
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
        """Attention weights of a round: ``[R, P, M]``, 0 in empty places; arguments as for `hear`.

        Raises:
            ValueError: robots with this policy send no messages (K = 1).
        """
        heard = torch.from_numpy(messages).double()
        return self._network.attention(own.state, heard, torch.from_numpy(present)).numpy()

    @torch.inference_mode()
    def weights(self, own: LatentState) -> npt.NDArray[np.float64]:
        """After the last round: ``[R, 5]`` float64 whole numbers proportional to softmax(logits / T)."""
        logits = self._network.logits(own.state)
        exponents = fp.snap(logits / self.config.temperature, fp.EXPONENT_BITS, -1e6, 1e6)
        weights = fp.exp_weights(exponents).numpy()
        assert weights.shape == (len(own.messages), PRIMITIVES)
        return weights

    def decide(self, own: LatentState, streams: npt.NDArray[np.uint64], tick: int) -> Decision:
        """See `RobotPolicy.decide`."""
        weights = self.weights(own)
        return Decision(weights, choose(weights, uniform(streams, tick)))

    def decide_together(
        self,
        field_of_view: npt.NDArray[np.uint8],
        heard: npt.NDArray[np.int64],
        streams: npt.NDArray[np.uint64],
        tick: int,
    ) -> Decision:
        """A whole tick of R robots, with the exchange of messages among them.

        Fields of view that were there in the call before are not computed again.

        Args:
            field_of_view: ``[R, 3, 11, 11]`` of 0 and 1.
            heard: ``[R, M]`` the rows that each robot hears, -1 for none.
            streams: ``[R]`` seeds of the robots' random streams.
            tick: from 0.
        """
        own, rows, present = self._cache.perceive(field_of_view), np.maximum(heard, 0), heard >= 0
        for _ in range(self.rounds):
            own = self.hear(own, payload.round_trip(own.messages, self.config.encoding)[rows], present)
        return self.decide(own, streams, tick)

    @property
    def rounds(self) -> int:
        """Rounds of messages in a tick."""
        return self._network.rounds

    def _latent_state(self, state: NodeState) -> LatentState:
        finished = state.rounds == self.rounds
        messages = state.x[:, :0] if finished else self._network.message(state)
        return LatentState(state, messages.float().numpy())
