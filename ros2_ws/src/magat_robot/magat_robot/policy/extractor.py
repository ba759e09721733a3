# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The CNN of a policy: extracts 128 features from a robot's field of view (MAGAT paper, Sec. V-B, V-C)."""

from typing import NamedTuple

from torch import Tensor, nn
from torch.nn.functional import linear
from torch.nn.utils import fuse_conv_bn_eval

from magat_robot.policy import fixed_point as fp
from magat_robot.policy.config import OBSERVATION_SHAPE

#: Features that the CNN extracts, before they are reduced to Num_features.
CNN_FEATURES = 128


class ConvNorm(nn.Module):
    """Convolution, then batch normalisation, which is folded into the convolution for fixed point."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int = 1, padded: bool = True) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, kernel, stride, padding=kernel // 2 if padded else 0, bias=False)
        self.norm: nn.Module = nn.BatchNorm2d(outputs)

    def forward(self, x: Tensor) -> Tensor:
        """``[R, inputs, H, W]`` to ``[R, outputs, H', W']``."""
        return self.norm(self.conv(x))

    def fold(self) -> None:
        """Fold the normalisation and its running statistics into the convolution."""
        assert isinstance(self.norm, nn.BatchNorm2d)
        self.conv = fuse_conv_bn_eval(self.conv.eval(), self.norm.eval())
        self.norm = nn.Identity()


class WholeConvNorm(ConvNorm):
    """A `ConvNorm` whose kernel covers the whole map of ``side x side`` cells, so that the output is one cell."""

    def __init__(self, inputs: int, outputs: int, side: int) -> None:
        super().__init__(inputs, outputs, side, padded=False)

    def forward(self, x: Tensor) -> Tensor:
        """``[R, inputs, side, side]`` to ``[R, outputs, 1, 1]``."""
        # A matrix product is four times faster than torch's convolution, forward and backward. Channels come last, as
        # they do in memory while training.
        rows, weights = (tensor.permute(0, 2, 3, 1).flatten(1) for tensor in (x, self.conv.weight))
        return self.norm(linear(rows, weights, self.conv.bias)[:, :, None, None])


class ResidualBlock(fp.Exactable):
    """``sigma(conv(sigma(conv(x))) + skip(x))``, the skip a strided 1x1 convolution."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.first = ConvNorm(inputs, outputs, 3, stride)
        self.second = ConvNorm(outputs, outputs, 3)
        self.skip = ConvNorm(inputs, outputs, 1)
        self.stride = stride

    def forward(self, x: Tensor) -> Tensor:
        """``[R, inputs, H, W]`` to ``[R, outputs, ceil(H / stride), ceil(W / stride)]``."""
        inner = fp.rectified(self.first(x), self.exact)
        # Slicing before the 1x1 convolution makes the backward pass several times faster than a strided convolution.
        return fp.rectified(self.second(inner) + self.skip(x[:, :, :: self.stride, :: self.stride]), self.exact)


class WholeBlock(fp.Exactable):
    """A residual block whose first convolution and skip cover the whole map, so that the output is one cell."""

    def __init__(self, inputs: int, outputs: int, side: int) -> None:
        super().__init__()
        self.first = WholeConvNorm(inputs, outputs, side)
        self.second = WholeConvNorm(outputs, outputs, 1)
        self.skip = WholeConvNorm(inputs, outputs, side)

    def forward(self, x: Tensor) -> Tensor:
        """``[R, inputs, side, side]`` to ``[R, outputs, 1, 1]``."""
        inner = fp.rectified(self.first(x), self.exact)
        return fp.rectified(self.second(inner) + self.skip(x), self.exact)


class PlainBlock(fp.Exactable):
    """Convolution-normalisation-sigma-MaxPool; unless it is the last block, then convolution-normalisation-sigma."""

    def __init__(self, inputs: int, outputs: int, last: bool = False) -> None:
        super().__init__()
        self.first = ConvNorm(inputs, outputs, 3)
        self.pool = nn.MaxPool2d(2)
        self.second = None if last else ConvNorm(outputs, outputs, 3)

    def forward(self, x: Tensor) -> Tensor:
        """``[R, inputs, H, W]`` to ``[R, outputs, H // 2, W // 2]``."""
        x = self.pool(fp.rectified(self.first(x), self.exact))
        return x if self.second is None else fp.rectified(self.second(x), self.exact)


class Sum(NamedTuple):
    """Convolutions whose outputs are added up, and the range of their inputs; see `fixed_point.weight_bits`."""

    convs: tuple[ConvNorm, ...]
    #: The inputs are multiples of ``2**-input_bits``, at most ``input_max`` in magnitude.
    input_bits: int
    input_max: float


class FeatureExtractor(fp.Exactable):
    """The CNN: a convolution (the stem), three residual blocks, and a linear layer; 11x11 cells to 128 features.

    The maps after the stem and the blocks are 11, 6, 3 and 3 cells wide. In the centred form they are 5, 3, 3 and 1
    cells wide, with the robot in the middle of each. The plain form, of GNN_baseline, has no stem, and the blocks of
    Li et al., IROS 2020.
    """

    def __init__(self, channels: tuple[int, int, int], plain: bool, centred: bool) -> None:
        """Create the weights.

        Args:
            channels: output channels of the three blocks.
            plain: plain blocks without a stem, instead of residual ones.
            centred: the centred form; ignored if ``plain``.
        """
        super().__init__()
        first, second, third = channels
        self.stem: ConvNorm | None = None
        cells = 1  # of the last map
        if plain:
            blocks: list[PlainBlock | ResidualBlock | WholeBlock] = [
                PlainBlock(OBSERVATION_SHAPE[0], first),
                PlainBlock(first, second),
                PlainBlock(second, third, last=True),
            ]
        elif centred:
            self.stem = ConvNorm(OBSERVATION_SHAPE[0], first, 3, stride=2, padded=False)
            blocks = [ResidualBlock(first, first, 2), ResidualBlock(first, second, 1), WholeBlock(second, third, 3)]
        else:
            self.stem = ConvNorm(OBSERVATION_SHAPE[0], first, 3)
            blocks = [ResidualBlock(first, first, 2), ResidualBlock(first, second, 2), ResidualBlock(second, third, 1)]
            cells = 9
        self.blocks = nn.Sequential(*blocks)
        self.linear = nn.Linear(third * cells, CNN_FEATURES)

    def forward(self, field_of_view: Tensor) -> Tensor:
        """``[R, 3, 11, 11]`` float32 to ``[R, 128]``."""
        x = field_of_view if self.stem is None else fp.rectified(self.stem(field_of_view), self.exact)
        x = self.blocks(x).flatten(1)
        return fp.rectified(self.linear(x.to(self.linear.weight.dtype)), self.exact)

    def sums(self) -> list[Sum]:
        """All convolutions, grouped by the sums that they contribute to."""
        zeros_and_ones, activations = (0, 1.0), (fp.ACTIVATION_BITS, fp.ACTIVATION_MAX)
        result = [] if self.stem is None else [Sum((self.stem,), *zeros_and_ones)]
        for block in self.blocks:
            assert isinstance(block, ResidualBlock | WholeBlock | PlainBlock)
            result.append(Sum((block.first,), *(activations if result else zeros_and_ones)))
            if not isinstance(block, PlainBlock):
                result.append(Sum((block.second, block.skip), *activations))
            elif block.second is not None:
                result.append(Sum((block.second,), *activations))
        return result
