"""The network of a policy: CNN, feature reduction, graph layers, action MLP (MAGAT paper, Sec. IV and V-C).

One definition, two ways to compute it: as built, the network is trained in float32; `to_fixed_point` turns a copy of it
into the fixed-point form that robots and simulators run (see `fixed_point`).
"""

import copy
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn

from magat_robot.policy import fixed_point as fp
from magat_robot.policy.config import PRIMITIVES, PolicyConfig
from magat_robot.policy.extractor import CNN_FEATURES, ConvNorm, FeatureExtractor, Sum
from magat_robot.policy.graph import GraphLayer, build_layer


@dataclass(frozen=True)
class NodeState:
    """What R robots have made of a tick so far, between rounds of messages."""

    #: ``[R, 128]`` the CNN's features; never sent.
    features: Tensor
    #: Rounds of messages heard.
    rounds: int
    #: ``[R, F]`` what the current graph layer works on; after the last one, what all of them made of it.
    x: Tensor
    #: ``[R, P, F]`` what the current layer's rounds aggregated last; None before its first.
    aggregated: Tensor | None
    #: ``[R, P * G]`` the current layer's sum so far.
    total: Tensor


class PolicyNetwork(fp.Exactable):
    """CNN -> MLP -> graph layers -> MLP -> five logits."""

    def __init__(self, config: PolicyConfig) -> None:
        super().__init__()
        self.config = config
        self.extractor = FeatureExtractor(config.channels, config.layer.plain_cnn)
        self.reduction = nn.Linear(CNN_FEATURES, config.features)
        fused = config.heads * config.features
        widths = [config.features, *[fused] * (config.layers - 1)]
        self.layers = nn.ModuleList(build_layer(config, width) for width in widths)
        self.hidden = nn.Linear(fused + (CNN_FEATURES if config.bottleneck else 0), config.hidden)
        self.action = nn.Linear(config.hidden, PRIMITIVES)

    @property
    def rounds(self) -> int:
        """Rounds of messages in a tick."""
        return len(self.config.message_sizes)

    def look(self, view: Tensor) -> NodeState:
        """Before the exchange: ``[R, 3, 11, 11]`` float32."""
        features = self.extractor(view)
        x = fp.rectified(self.reduction(features), self.exact)
        return self._enter(0, NodeState(features, 0, x, None, x))

    def message(self, state: NodeState) -> Tensor:
        """What each robot sends next: ``[R, n]``, n of `PolicyConfig.message_sizes`."""
        if self.config.taps == 1:
            return state.x[:, :0]
        return self._layer(state.rounds // (self.config.taps - 1)).message(state.x, state.aggregated)

    def hear(self, state: NodeState, messages: Tensor, present: Tensor) -> NodeState:
        """One round: messages ``[R, M, n]`` in any order, ``present`` ``[R, M]`` bool says which places hold one."""
        rounds, hops = state.rounds + 1, self.config.taps - 1
        if hops == 0:
            return replace(state, rounds=rounds)
        number, hop = divmod(state.rounds, hops)
        layer = self._layer(number)
        aggregated = layer.receive(state.x, messages, present)
        state = replace(state, rounds=rounds, aggregated=aggregated, total=state.total + layer.tap(hop + 1, aggregated))
        return state if hop + 1 < hops else self._leave(number, state)

    def attention(self, state: NodeState, messages: Tensor, present: Tensor) -> Tensor:
        """How much each robot listens to what `hear` would hear: ``[R, P, M]``, e_ij of Eq. 7, or 1 where it adds up.

        Raises:
            ValueError: robots that do not talk (K = 1) have nobody to listen to.
        """
        if self.config.taps == 1:
            raise ValueError(f"{self.config.name} has one tap: its robots do not talk, and there is no attention")
        layer = self._layer(state.rounds // (self.config.taps - 1))
        weights, total = layer.attention(state.x, messages[:, :, : layer.inputs], present)
        return weights / total

    def logits(self, state: NodeState) -> Tensor:
        """After the last round: ``[R, 5]``."""
        x = torch.cat([state.features, state.x], dim=1) if self.config.bottleneck else state.x
        logits = self.action(fp.rectified(self.hidden(x), self.exact))
        return fp.snap(logits, fp.EXPONENT_BITS, -fp.SIGNED_MAX, fp.SIGNED_MAX) if self.exact else logits

    def forward(self, view: Tensor, heard: Tensor) -> Tensor:
        """All of it, every robot hearing the rows that it names.

        Args:
            view: ``[R, 3, 11, 11]``.
            heard: ``[R, M]`` int64, rows that each robot hears, filled up with -1.

        Returns:
            ``[R, 5]`` logits.
        """
        state, present, rows = self.look(view), heard >= 0, heard.clamp_min(0)
        for _ in range(self.rounds):
            state = self.hear(state, self.message(state)[rows], present)
        return self.logits(state)

    def _layer(self, number: int) -> GraphLayer:
        layer = self.layers[number]
        assert isinstance(layer, GraphLayer)
        return layer

    def _enter(self, number: int, state: NodeState) -> NodeState:
        total = self._layer(number).own(state.x)
        state = replace(state, aggregated=None, total=total)
        return state if self.config.taps > 1 else self._leave(number, state)

    def _leave(self, number: int, state: NodeState) -> NodeState:
        state = replace(state, x=fp.rectified(state.total, self.exact))
        return state if number + 1 == self.config.layers else self._enter(number + 1, state)


def to_fixed_point(network: PolicyNetwork) -> PolicyNetwork:
    """A copy of ``network`` in fixed point: normalisation folded, weights on their grids, exact sums.

    Convolutions stay in float32, everything after them is computed in float64.

    Raises:
        ValueError: the weights are not finite (or a variance is negative), or too large for exact sums.
    """
    deployed = copy.deepcopy(network).eval().requires_grad_(False)
    _check_finite(deployed)
    for module in list(deployed.modules()):
        if isinstance(module, ConvNorm | GraphLayer):
            module.fold()
    deployed.requires_grad_(False)
    _check_finite(deployed)  # again: a negative variance becomes NaN
    for added in deployed.extractor.sums():
        _snap_convs(added)
    for head in (deployed.extractor.linear, deployed.reduction, deployed.layers, deployed.hidden, deployed.action):
        head.double()
    for name, parameter in deployed.named_parameters():
        if parameter.dtype == torch.float64:
            parameter.copy_(fp.snap_float64(parameter, name))
    for module in deployed.modules():
        if isinstance(module, fp.Exactable):
            module.exact = True
    return deployed


def _check_finite(network: PolicyNetwork) -> None:
    for name, tensor in network.state_dict().items():
        if not tensor.isfinite().all():
            raise ValueError(f"weights {name} hold NaN or infinity: the file is damaged or training diverged")


def _snap_convs(added: Sum) -> None:
    convs = [layer.conv for layer in added.convs]
    biases = [conv.bias for conv in convs if conv.bias is not None]
    bits = fp.weight_bits([conv.weight for conv in convs], biases, added.input_bits, added.input_max)
    for conv in convs:
        conv.weight.copy_(fp.snap_rows(conv.weight, bits))
    for bias in biases:
        bias.copy_(fp.snap_rows(bias, bits + added.input_bits))
