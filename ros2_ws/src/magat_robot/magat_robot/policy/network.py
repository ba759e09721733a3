"""The network of a policy: CNN, feature reduction, graph attention, action MLP (MAGAT paper, Sec. IV and V-C).

One definition, two ways to compute: as built it is trained in float32; `deploy` turns a copy of it into the fixed-point
form that robots and simulators run (see `fixed_point`).
"""

import copy

import torch
from torch import Tensor, nn
from torch.nn.utils import fuse_conv_bn_eval

from magat_robot.policy import fixed_point as fp
from magat_robot.policy.config import PolicyConfig

#: Shape of an observation: obstacles, robots, goal; the 9 x 9 field of view and the ring around it.
OBSERVATION_SHAPE = (3, 11, 11)
#: Features extracted by the CNN, before their reduction to Num_features.
CNN_FEATURES = 128
#: idle, up, down, left, right.
PRIMITIVES = 5
#: Slope of the LeakyReLU in Eq. 6 (the value of the GAT paper).
LEAKY_SLOPE = 0.2


class _Exactable(nn.Module):
    """A module that computes on the grids of `fixed_point` once it is deployed."""

    exact = False


class ConvNorm(nn.Module):
    """Convolution, then batch normalisation; the latter is folded into the former on deployment."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, kernel, stride, padding=kernel // 2, bias=False)
        self.norm: nn.Module = nn.BatchNorm2d(outputs)

    def forward(self, x: Tensor) -> Tensor:
        """``[R, inputs, H, W]`` to ``[R, outputs, H', W']``."""
        return self.norm(self.conv(x))

    def fold(self) -> None:
        """Fold the normalisation, with its running statistics, into the convolution."""
        assert isinstance(self.norm, nn.BatchNorm2d)
        self.conv = fuse_conv_bn_eval(self.conv.eval(), self.norm.eval())
        self.norm = nn.Identity()


class ResidualBlock(_Exactable):
    """``sigma(conv(sigma(conv(x))) + skip(x))``, the skip a strided 1x1 convolution."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.first = ConvNorm(inputs, outputs, 3, stride)
        self.second = ConvNorm(outputs, outputs, 3, 1)
        self.skip = ConvNorm(inputs, outputs, 1, stride)

    def forward(self, x: Tensor) -> Tensor:
        """``[R, inputs, H, W]`` to ``[R, outputs, ceil(H / stride), ceil(W / stride)]``."""
        inner = fp.rectified(self.first(x), self.exact)
        return fp.rectified(self.second(inner) + self.skip(x), self.exact)


class FeatureExtractor(_Exactable):
    """A convolution and three residual blocks, then 128 features: the CNN-based perception."""

    def __init__(self, channels: tuple[int, int, int]) -> None:
        super().__init__()
        first, second, third = channels
        self.stem = ConvNorm(OBSERVATION_SHAPE[0], first, 3, 1)
        self.blocks = nn.Sequential(
            ResidualBlock(first, first, 2), ResidualBlock(first, second, 2), ResidualBlock(second, third, 1)
        )
        self.flatten = nn.Flatten()
        self.linear = nn.Linear(third * 9, CNN_FEATURES)

    def forward(self, view: Tensor) -> Tensor:
        """``[R, 3, 11, 11]`` float32 to ``[R, 128]``."""
        x = self.blocks(fp.rectified(self.stem(view), self.exact))
        return fp.rectified(self.linear(self.flatten(x).to(self.linear.weight.dtype)), self.exact)


class GraphAttention(_Exactable):
    """One layer, K = 2: ``y_i = sigma(x_i A_0 + sum_j e_ij x_j A_1)`` per head, heads concatenated (Eq. 5 to 8).

    ``e_ij`` is the softmax over the receiver's neighbours j of ``LeakyReLU(x_i W x_j^T)``.
    """

    def __init__(self, inputs: int, outputs: int, heads: int) -> None:
        super().__init__()
        self.query = nn.Linear(inputs, heads * inputs, bias=False)  # x -> x W, head by head
        self.own = nn.Linear(inputs, heads * outputs, bias=False)  # A_0
        self.heard = nn.Parameter(torch.empty(heads, inputs, outputs))  # A_1
        self.heads = heads
        # Scores start near zero, so that attention starts near the plain mean.
        nn.init.normal_(self.query.weight, std=0.1 / inputs)
        nn.init.kaiming_uniform_(self.own.weight, nonlinearity="relu")
        for matrix in self.heard.data:
            nn.init.kaiming_uniform_(matrix.T, nonlinearity="relu")

    def attention(self, x: Tensor, messages: Tensor, present: Tensor) -> tuple[Tensor, Tensor]:
        """Attention of R receivers to their messages.

        Args:
            x: ``[R, F]`` the receivers' own features.
            messages: ``[R, M, F]`` what each heard, in any order.
            present: ``[R, M]`` bool, which of the M places hold a message.

        Returns:
            Weights ``[R, P, M]``, 0 where there is no message, and their sums ``[R, P, 1]``; e_ij is their quotient.
        """
        query = self.query(x).unflatten(1, (self.heads, -1))
        if self.exact:
            query = fp.snap(query, fp.ACTIVATION_BITS, -fp.SIGNED_MAX, fp.SIGNED_MAX)
        score = nn.functional.leaky_relu(query @ messages.transpose(1, 2), LEAKY_SLOPE)
        present = present[:, None, :].expand_as(score)
        if self.exact:
            weights = fp.exp_weights(fp.snap(score, fp.EXPONENT_BITS, -1e6, 1e6), present)
            return weights, weights.sum(-1, keepdim=True).clamp_min(1.0)
        weights = score.masked_fill(~present, -1e9).softmax(-1) * present
        return weights, weights.new_ones(*weights.shape[:2], 1)

    def forward(self, x: Tensor, messages: Tensor, present: Tensor) -> Tensor:
        """``[R, F]``, ``[R, M, F]`` and ``[R, M]`` (see `attention`) to ``[R, P * G]``. M may be 0."""
        weights, total = self.attention(x, messages, present)
        mean = (weights @ messages) / total
        if self.exact:
            mean = fp.snap(mean, fp.EXPONENT_BITS, 0.0, fp.ACTIVATION_MAX)
        fused = torch.einsum("rpf,pfg->rpg", mean, self.heard).flatten(1)
        return fp.rectified(self.own(x) + fused, self.exact)


class PolicyNetwork(_Exactable):
    """CNN -> MLP -> graph attention -> MLP -> five logits."""

    def __init__(self, config: PolicyConfig) -> None:
        super().__init__()
        self.config = config
        self.extractor = FeatureExtractor(config.channels)
        self.reduction = nn.Linear(CNN_FEATURES, config.features)
        self.graph = GraphAttention(config.features, config.features, config.heads)
        fused = config.heads * config.features + (CNN_FEATURES if config.bottleneck else 0)
        self.hidden = nn.Linear(fused, config.hidden)
        self.action = nn.Linear(config.hidden, PRIMITIVES)

    def encode(self, view: Tensor) -> tuple[Tensor, Tensor]:
        """Before the exchange: ``[R, 3, 11, 11]`` to the CNN's features ``[R, 128]`` and the message x ``[R, F]``."""
        features = self.extractor(view)
        return features, fp.rectified(self.reduction(features), self.exact)

    def fuse(self, features: Tensor, x: Tensor, messages: Tensor, present: Tensor) -> Tensor:
        """After the exchange: own features and x, messages ``[R, M, F]`` and ``[R, M]`` to logits ``[R, 5]``."""
        y = self.graph(x, messages, present)
        if self.config.bottleneck:
            y = torch.cat([features, y], dim=1)
        logits = self.action(fp.rectified(self.hidden(y), self.exact))
        return fp.snap(logits, fp.EXPONENT_BITS, -fp.SIGNED_MAX, fp.SIGNED_MAX) if self.exact else logits

    def forward(self, view: Tensor, heard: Tensor) -> Tensor:
        """Both halves, the exchange in between.

        Args:
            view: ``[R, 3, 11, 11]``.
            heard: ``[R, M]`` int64, rows that each robot hears, filled up with -1.

        Returns:
            ``[R, 5]`` logits.
        """
        features, x = self.encode(view)
        return self.fuse(features, x, x[heard.clamp_min(0)], heard >= 0)


def deploy(network: PolicyNetwork) -> PolicyNetwork:
    """A copy of ``network`` in fixed point: normalisation folded, weights on their grids, exact sums.

    Convolutions stay in float32, everything after them is computed in float64.

    Raises:
        ValueError: the weights are not finite (or a variance is negative), or too large for exact sums.
    """
    deployed = copy.deepcopy(network).eval().requires_grad_(False)
    _check_finite(deployed)
    for module in list(deployed.modules()):
        if isinstance(module, ConvNorm):
            module.fold()
    deployed.requires_grad_(False)
    _check_finite(deployed)  # again: a negative variance becomes NaN
    extractor = deployed.extractor
    _snap_convs([extractor.stem], input_bits=0, input_max=1.0)
    for block in extractor.blocks:
        assert isinstance(block, ResidualBlock)
        _snap_convs([block.first], fp.ACTIVATION_BITS, fp.ACTIVATION_MAX)
        # Their outputs are added up, so they share one sum, and one bound.
        _snap_convs([block.second, block.skip], fp.ACTIVATION_BITS, fp.ACTIVATION_MAX)
    for head in (extractor.linear, deployed.reduction, deployed.graph, deployed.hidden, deployed.action):
        head.double()
    for name, parameter in deployed.named_parameters():
        if parameter.dtype == torch.float64:
            parameter.copy_(fp.snap_float64(parameter, name))
    for module in deployed.modules():
        if isinstance(module, _Exactable):
            module.exact = True
    return deployed


def _check_finite(network: PolicyNetwork) -> None:
    for name, tensor in network.state_dict().items():
        if not tensor.isfinite().all():
            raise ValueError(f"weights {name} hold NaN or infinity: the file is damaged or training diverged")


def _snap_convs(layers: list[ConvNorm], input_bits: int, input_max: float) -> None:
    convs = [layer.conv for layer in layers]
    biases = [conv.bias for conv in convs if conv.bias is not None]
    bits = fp.weight_bits([conv.weight for conv in convs], biases, input_bits, input_max)
    for conv in convs:
        conv.weight.copy_(fp.snap_rows(conv.weight, bits))
    for bias in biases:
        bias.copy_(fp.snap_rows(bias, bits + input_bits))
