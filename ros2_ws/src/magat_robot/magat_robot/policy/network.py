# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The network of a policy: CNN, feature reduction, graph layers, action MLP (MAGAT paper, Sec. IV and V-C).

There is one definition and two forms: the network is built and trained in float32, and `to_fixed_point` converts a copy
to the fixed-point form that robots and simulators run (see `fixed_point`).
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
    """The network's state for R robots between two rounds of messages."""

    #: ``[R, 128]`` the CNN's features; never sent.
    features: Tensor
    #: Rounds of messages processed so far in this tick.
    rounds: int
    #: ``[R, F]`` input of the current graph layer; output of the last layer once all rounds are over.
    x: Tensor
    #: ``[R, P, F]`` aggregate of the current layer's last hop, ``[(E * S)^k X]``; None before its first hop.
    aggregated: Tensor | None
    #: ``[R, P * G]`` the current layer's sum over taps so far.
    total: Tensor


class PolicyNetwork(fp.Exactable):
    """CNN -> MLP -> graph layers -> MLP -> five logits."""

    def __init__(self, config: PolicyConfig) -> None:
        super().__init__()
        self.config = config
        self.extractor = FeatureExtractor(config.channels, config.layer.plain_cnn, config.cnn == "centred")
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

    def perceive(self, field_of_view: Tensor) -> NodeState:
        """The state before the first round, from ``[R, 3, 11, 11]`` float32."""
        features = self.extractor(field_of_view)
        x = fp.rectified(self.reduction(features), self.exact)
        return self._enter(0, NodeState(features, 0, x, None, x))

    def message(self, state: NodeState) -> Tensor:
        """The messages of the next round: ``[R, n]``, n of `PolicyConfig.message_sizes`."""
        if self.config.taps == 1:
            return state.x[:, :0]
        return self._layer(state.rounds // (self.config.taps - 1)).message(state.x, state.aggregated)

    def hear(self, state: NodeState, messages: Tensor, present: Tensor) -> NodeState:
        """The state after one more round.

        Args:
            state: before the round.
            messages: ``[R, M, n]`` received messages, in any order.
            present: ``[R, M]`` bool, which of the M places hold a message.
        """
        rounds, hops = state.rounds + 1, self.config.taps - 1
        if hops == 0:
            return replace(state, rounds=rounds)
        number, hop = divmod(state.rounds, hops)
        layer = self._layer(number)
        aggregated = layer.receive(state.x, messages, present)
        state = replace(state, rounds=rounds, aggregated=aggregated, total=state.total + layer.tap(hop + 1, aggregated))
        return state if hop + 1 < hops else self._leave(number, state)

    def attention(self, state: NodeState, messages: Tensor, present: Tensor) -> Tensor:
        """Attention weights of the next round: ``[R, P, M]``, e_ij of Eq. 6; arguments as for `hear`.

        Layers without attention give 1 over the receiver's degree, or 1 if they are not normalised.

        Raises:
            ValueError: there are no messages, because K = 1.
        """
        if self.config.taps == 1:
            raise ValueError(f"{self.config.name} has one tap (K = 1): its robots send no messages to attend to")
        layer = self._layer(state.rounds // (self.config.taps - 1))
        weights, total = layer.attention(state.x, messages[:, :, : layer.inputs], present)
        return weights / total

    def logits(self, state: NodeState) -> Tensor:
        """After the last round: ``[R, 5]``."""
        x = torch.cat([state.features, state.x], dim=1) if self.config.bottleneck else state.x
        logits = self.action(fp.rectified(self.hidden(x), self.exact))
        return fp.snap(logits, fp.EXPONENT_BITS, -fp.SIGNED_MAX, fp.SIGNED_MAX) if self.exact else logits

    def forward(self, field_of_view: Tensor, heard: Tensor) -> Tensor:
        """A whole tick of R robots, with the exchange of messages among them.

        Args:
            field_of_view: ``[R, 3, 11, 11]``.
            heard: ``[R, M]`` int64, rows that each robot hears, padded with -1.

        Returns:
            ``[R, 5]`` logits.
        """
        state, present, rows = self.perceive(field_of_view), heard >= 0, heard.clamp_min(0)
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
    """A copy of ``network`` in fixed point: normalisation folded, weights rounded to their units, all sums exact.

    Convolutions stay in float32; everything after them is computed in float64.

    Raises:
        ValueError: the weights are not finite (or a variance is negative), or too large for exact sums.
    """
    fixed = copy.deepcopy(network).eval().requires_grad_(False)
    _check_finite(fixed)
    for module in list(fixed.modules()):
        if isinstance(module, ConvNorm | GraphLayer):
            module.fold()
    fixed.requires_grad_(False)
    _check_finite(fixed)  # again: folding turns a negative variance into NaN
    for added in fixed.extractor.sums():
        _snap_convs(added)
    for head in (fixed.extractor.linear, fixed.reduction, fixed.layers, fixed.hidden, fixed.action):
        head.double()
    for name, parameter in fixed.named_parameters():
        if parameter.dtype == torch.float64:
            parameter.copy_(fp.snap_float64(parameter, name))
    for module in fixed.modules():
        if isinstance(module, fp.Exactable):
            module.exact = True
    return fixed


def _check_finite(network: PolicyNetwork) -> None:
    for name, tensor in network.state_dict().items():
        if not tensor.isfinite().all():
            raise ValueError(f"weights {name} hold NaN or infinity: the file is damaged, or training diverged")


def _snap_convs(added: Sum) -> None:
    convs = [layer.conv for layer in added.convs]
    biases = [conv.bias for conv in convs if conv.bias is not None]
    bits = fp.weight_bits([conv.weight for conv in convs], biases, added.input_bits, added.input_max)
    for conv in convs:
        conv.weight.copy_(fp.snap_rows(conv.weight, bits))
    for bias in biases:
        bias.copy_(fp.snap_rows(bias, bits + added.input_bits))
