# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The graph layers: how a robot aggregates its neighbours' messages (MAGAT paper, Eq. 3 and 5 to 9).

To add one, define a subclass of `GraphLayer` here and decorate it with `layer`. Its name is then the first part of
valid policy names, and the tests in `tests/robot` run for it, too.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TypeVar

import torch
from torch import Tensor, nn

from magat_robot.policy import fixed_point as fp
from magat_robot.policy.config import PolicyConfig
from magat_robot.policy.layers import LAYERS, LayerSpec

#: Slope of the LeakyReLU in Eq. 6 (the value of the GAT paper).
LEAKY_SLOPE = 0.2
# As a tensor, because torch's exporter would round a Python number to float32.
_SLOPE = torch.tensor(LEAKY_SLOPE, dtype=torch.float64)

_Layer = TypeVar("_Layer", bound="type[GraphLayer]")
_classes: dict[str, "type[GraphLayer]"] = {}


def layer(name: str, *, attention: bool = True, plain_cnn: bool = False) -> Callable[[_Layer], _Layer]:
    """Class decorator: registers a graph layer for the policies whose names begin with ``name``.

    `magat_robot.policy.layers` reads the arguments from this file without running it, so they have to be literals.

    Args:
        name: first part of the policy names.
        attention: see `LayerSpec.attention`.
        plain_cnn: see `LayerSpec.plain_cnn`.

    Raises:
        ValueError: the name is taken, or the decorator is used in another file or with other values than literals.
    """

    def register(cls: _Layer) -> _Layer:
        if LAYERS.get(name) != LayerSpec(name, attention, plain_cnn) or name in _classes:
            raise ValueError(f"the layer {name!r} must be registered once, with literal arguments, in {__file__}")
        _classes[name] = cls
        return cls

    return register


def build_layer(config: PolicyConfig, inputs: int) -> "GraphLayer":
    """A new layer of the kind that ``config`` names, which gets ``inputs`` numbers of each robot."""
    return _classes[config.layer.name](config, inputs)


class GraphLayer(fp.Exactable, ABC):
    """``y_i = sigma(x_i A_0 + sum_{k = 1}^{K - 1} [(E * S)^k X]_i A_k)`` per head, heads concatenated (Eq. 5, 8).

    ``[(E * S)^k X]_i`` is what reaches robot i over k hops, in k rounds of messages. The subclasses define how the
    messages of a neighbourhood are weighted. Shapes: R robots, M places for messages, P heads, F inputs, G outputs.
    """

    def __init__(self, config: PolicyConfig, inputs: int) -> None:
        """Create the weights.

        Args:
            config: of the policy; P, K and G are its ``heads``, ``taps`` and ``features``.
            inputs: F.
        """
        super().__init__()
        self.inputs, self.heads = inputs, config.heads
        self.own = nn.Linear(inputs, config.heads * config.features, bias=False)  # A_0
        self.taps = nn.Parameter(torch.empty(config.taps - 1, config.heads, inputs, config.features))  # A_1, ...
        nn.init.kaiming_uniform_(self.own.weight, nonlinearity="relu")
        for matrix in self.taps.data.flatten(0, 1):
            nn.init.kaiming_uniform_(matrix.T, nonlinearity="relu")

    def message(self, x: Tensor, aggregated: Tensor | None) -> Tensor:
        """The messages of the next hop: x in the first hop, x and the aggregate of the hop before in later ones.

        A layer that overrides this must send as many numbers as `PolicyConfig.message_sizes` says.

        Args:
            x: ``[R, F]``.
            aggregated: ``[R, P, F]``, from `receive`; None in the first hop.

        Returns:
            ``[R, F]`` in the first hop, ``[R, F + P * F]`` in later ones.
        """
        # Each message repeats x, so that a receiver weighs it without knowing which message of the hop before it was.
        return x if aggregated is None else torch.cat([x, aggregated.flatten(1)], dim=1)

    def receive(self, x: Tensor, messages: Tensor, present: Tensor) -> Tensor:
        """The aggregate of one hop: the weighted mean of the neighbours' messages, for each head.

        Args:
            x: ``[R, F]`` of the receivers.
            messages: ``[R, M, F]`` or ``[R, M, F + P * F]`` (see `message`), in any order. M may be 0.
            present: ``[R, M]`` bool, which of the M places hold a message.

        Returns:
            ``[R, P, F]``.
        """
        keys = messages[:, :, : self.inputs]
        weights, total = self.attention(x, keys, present)
        if messages.shape[2] == self.inputs:
            mean = (weights @ keys) / total
        else:
            values = messages[:, :, self.inputs :].unflatten(2, (self.heads, self.inputs))
            mean = torch.einsum("rpm,rmpf->rpf", weights, values) / total
        return fp.snap(mean, fp.EXPONENT_BITS, 0.0, fp.ACTIVATION_MAX) if self.exact else mean

    @abstractmethod
    def attention(self, x: Tensor, keys: Tensor, present: Tensor) -> tuple[Tensor, Tensor]:
        """Attention of each receiver to each message.

        Args:
            x: ``[R, F]`` of the receivers.
            keys: ``[R, M, F]``, x of the senders.
            present: ``[R, M]`` bool, which of the M places hold a message.

        Returns:
            Unnormalised weights ``[R, P, M]``, 0 where there is no message, and their divisors ``[R, P, 1]``;
            e_ij is the quotient.
        """

    def tap(self, hops: int, aggregated: Tensor) -> Tensor:
        """``[(E * S)^k X] A_k`` for k = ``hops`` from 1: ``[R, P, F]`` to ``[R, P * G]``."""
        return torch.einsum("rpf,pfg->rpg", aggregated.expand(-1, self.heads, -1), self.taps[hops - 1]).flatten(1)

    def fold(self) -> None:
        """Compute products of weights in advance; called once, by `to_fixed_point`."""


class ScoredAttention(GraphLayer):
    """Base of layers with ``e_ij = softmax_j LeakyReLU(score_ij)`` (Eq. 6); the subclasses define the scores."""

    def attention(self, x: Tensor, keys: Tensor, present: Tensor) -> tuple[Tensor, Tensor]:
        """Softmax over the messages of each receiver; see `GraphLayer.attention`."""
        scores = self.scores(x, keys)
        scores = torch.maximum(
            scores, _SLOPE.to(scores.dtype) * scores
        )  # LeakyReLU, in operators that all backends have
        present = present[:, None, :].expand_as(scores)
        if self.exact:
            weights = fp.exp_weights(fp.snap(scores, fp.EXPONENT_BITS, -1e6, 1e6), present)
            return weights, weights.sum(-1, keepdim=True).clamp_min(1.0)
        weights = scores.masked_fill(~present, -1e9).softmax(-1) * present
        return weights, weights.new_ones(*weights.shape[:2], 1)

    @abstractmethod
    def scores(self, x: Tensor, keys: Tensor) -> Tensor:
        """Scores ``[R, P, M]``; arguments as for `attention`."""


@layer("MAGAT")
class MessageAwareAttention(ScoredAttention):
    """MAGAT: ``e_ij = softmax_j LeakyReLU(x_i W x_j^T)`` (Eq. 6, 7)."""

    def __init__(self, config: PolicyConfig, inputs: int) -> None:
        super().__init__(config, inputs)
        self.query = nn.Linear(inputs, self.heads * inputs, bias=False)  # x -> x W, head by head
        # Scores are initially near zero, so that attention starts near the unweighted mean.
        nn.init.normal_(self.query.weight, std=0.1 / inputs)

    def scores(self, x: Tensor, keys: Tensor) -> Tensor:
        """``x_i W x_j^T``; see `ScoredAttention.scores`."""
        query = self.query(x).unflatten(1, (self.heads, -1))
        if self.exact:
            query = fp.snap(query, fp.ACTIVATION_BITS, -fp.SIGNED_MAX, fp.SIGNED_MAX)
        return query @ keys.transpose(1, 2)


@layer("GAT")
class GraphAttention(ScoredAttention):
    """GAT: ``e_ij = softmax_j LeakyReLU((x_i A_1 || x_j A_1) H)`` (Eq. 6, 9; Velickovic et al., ICLR 2018).

    The paper does not say which A_k is meant. Here it is A_1, which also maps the messages of the first hop.
    """

    def __init__(self, config: PolicyConfig, inputs: int) -> None:
        super().__init__(config, inputs)
        self.pair = nn.Parameter(torch.empty(2, self.heads, config.features))  # halves of H: receiver's, sender's
        nn.init.normal_(self.pair, std=0.1 / config.features)
        self.folded: nn.Parameter | None = None

    def scores(self, x: Tensor, keys: Tensor) -> Tensor:
        """``(x_i A_1 || x_j A_1) H``; see `ScoredAttention.scores`."""
        receiver, sender = self._projections() if self.folded is None else self.folded
        return (x @ receiver.T)[:, :, None] + (keys @ sender.T).transpose(1, 2)

    def fold(self) -> None:
        """Store ``A_1 H``, one vector for receivers and one for senders."""
        if len(self.taps):  # with K = 1 there is no A_1
            self.double()  # in float32 these sums would depend on the machine's order of adding
            self.folded = nn.Parameter(self._projections().detach(), requires_grad=False)

    def _projections(self) -> Tensor:
        """``A_1 H``: ``[2, P, F]``, for receivers and senders."""
        return torch.einsum("pfg,hpg->hpf", self.taps[0], self.pair)


@layer("GNN", attention=False)
@layer("GNN_baseline", attention=False, plain_cnn=True)
class GraphConvolution(GraphLayer):
    """GNN: all neighbours weigh the same, ``e_ij = 1`` (Eq. 3).

    S is the adjacency divided by the receiver's degree, or the bare adjacency. (The authors' code divides by the
    largest eigenvalue of the whole team's graph, which a robot cannot compute.)
    """

    def __init__(self, config: PolicyConfig, inputs: int) -> None:
        super().__init__(config, inputs)
        self.normalise = config.normalise

    def message(self, x: Tensor, aggregated: Tensor | None) -> Tensor:
        """As `GraphLayer.message`, but without x in later hops: ``[R, F]``."""
        return x if aggregated is None else aggregated.flatten(1)

    def receive(self, x: Tensor, messages: Tensor, present: Tensor) -> Tensor:
        """As `GraphLayer.receive`, but the same for all heads: ``[R, 1, F]``."""
        weights, total = self.attention(x, messages, present)
        mean = (weights[:, :1] @ messages) / total[:, :1]
        high = fp.ACTIVATION_MAX if self.normalise else fp.SUM_MAX
        return fp.snap(mean, fp.EXPONENT_BITS, 0.0, high) if self.exact else mean.clamp_max(high)

    def attention(self, x: Tensor, keys: Tensor, present: Tensor) -> tuple[Tensor, Tensor]:
        """Equal weights for all messages; see `GraphLayer.attention`."""
        weights = present[:, None, :].expand(-1, self.heads, -1).to(x.dtype)
        total = weights.sum(-1, keepdim=True).clamp_min(1.0)
        return weights, total if self.normalise else torch.ones_like(total)
