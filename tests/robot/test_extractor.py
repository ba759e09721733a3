# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The CNN against a plain Python computation: residual blocks, and the plain blocks of GNN_baseline."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from magat_robot.policy.extractor import ConvNorm

Planes = list[list[list[float]]]  # [channel][row][column]

CAP = 8.0


def sigma(x: Planes) -> Planes:
    return [[[min(max(value, 0.0), CAP) for value in row] for row in plane] for plane in x]


def plus(x: Planes, y: Planes) -> Planes:
    return [
        [[a + b for a, b in zip(*rows, strict=True)] for rows in zip(*planes, strict=True)]
        for planes in zip(x, y, strict=True)
    ]


def convolved(x: Planes, layer: ConvNorm, stride: int = 1, padded: bool = True) -> Planes:
    """Strided convolution, with zero padding or without, then normalisation with the running statistics."""
    weight, norm = layer.conv.weight.tolist(), layer.norm
    height, width, kernel_size = len(x[0]), len(x[0][0]), len(weight[0][0])
    around = kernel_size // 2 if padded else 0
    rows, columns = (range(0, side + 2 * around - kernel_size + 1, stride) for side in (height, width))
    result = []
    for o, kernels in enumerate(weight):
        mean, variance, gain, bias = (
            values.tolist()[o] for values in (norm.running_mean, norm.running_var, norm.weight, norm.bias)
        )
        plane = []
        for i in rows:
            row = []
            for j in columns:
                value = 0.0
                for kernel, channel in zip(kernels, x, strict=True):
                    for a, weights in enumerate(kernel):
                        for b, w in enumerate(weights):
                            m, n = i + a - around, j + b - around
                            if 0 <= m < height and 0 <= n < width:
                                value += w * channel[m][n]
                row.append((value - mean) / (variance + norm.eps) ** 0.5 * gain + bias)
            plane.append(row)
        result.append(plane)
    return result


def pooled(x: Planes) -> Planes:
    """Max pooling over 2 x 2 cells; an odd last row or column is ignored."""
    return [
        [
            [max(plane[i][j], plane[i][j + 1], plane[i + 1][j], plane[i + 1][j + 1]) for j in range(0, width - 1, 2)]
            for i in range(0, height - 1, 2)
        ]
        for plane, height, width in ((plane, len(plane), len(plane[0])) for plane in x)
    ]


def shape(x: Planes) -> tuple[int, int, int]:
    return len(x), len(x[0]), len(x[0][0])


def features(x: Planes, linear: torch.nn.Linear) -> list[float]:
    flat = [value for plane in x for row in plane for value in row]
    weight, bias = linear.weight.tolist(), linear.bias.tolist()
    sums = [sum(w * v for w, v in zip(weight[o], flat, strict=True)) + bias[o] for o in range(128)]
    return sigma([[sums]])[0][0]


@pytest.fixture(scope="module")
def fields_of_view() -> torch.Tensor:
    return (torch.rand(2, 3, 11, 11, generator=torch.Generator().manual_seed(2)) < 0.25).double()


def test_the_extractor_is_a_stem_and_three_residual_blocks(
    random_network: Callable, fields_of_view: torch.Tensor
) -> None:
    extractor = random_network(channels=(3, 4, 5)).double().extractor
    expected = []
    for field_of_view in fields_of_view.tolist():
        x = sigma(convolved(field_of_view, extractor.stem))
        shapes = [shape(x)]
        for block, stride in zip(extractor.blocks, (2, 2, 1), strict=True):
            inner = convolved(sigma(convolved(x, block.first, stride)), block.second)
            x = sigma(plus(inner, convolved(x, block.skip, stride)))
            shapes.append(shape(x))
        assert shapes == [(3, 11, 11), (3, 6, 6), (4, 3, 3), (5, 3, 3)]
        expected.append(features(x, extractor.linear))
    assert extractor(fields_of_view).detach().numpy() == pytest.approx(np.array(expected), abs=1e-10)


def test_the_maps_of_a_centred_one_have_the_robot_in_their_middle(
    random_network: Callable, fields_of_view: torch.Tensor
) -> None:
    extractor = random_network(channels=(3, 4, 5), cnn="centred").double().extractor
    expected = []
    for view in fields_of_view.tolist():
        x = sigma(convolved(view, extractor.stem, 2, padded=False))
        shapes = [shape(x)]
        for block, stride in zip(extractor.blocks[:2], (2, 1), strict=True):
            inner = convolved(sigma(convolved(x, block.first, stride)), block.second)
            x = sigma(plus(inner, convolved(x, block.skip, stride)))
            shapes.append(shape(x))
        last = extractor.blocks[2]
        inner = convolved(sigma(convolved(x, last.first, padded=False)), last.second)
        x = sigma(plus(inner, convolved(x, last.skip, padded=False)))
        assert [*shapes, shape(x)] == [(3, 5, 5), (3, 3, 3), (4, 3, 3), (5, 1, 1)]
        expected.append(features(x, extractor.linear))
    assert extractor(fields_of_view).detach().numpy() == pytest.approx(np.array(expected), abs=1e-10)


@pytest.mark.parametrize("layout", [torch.contiguous_format, torch.channels_last])
def test_a_convolution_over_the_whole_map_is_torchs_backwards_too(
    random_network: Callable, layout: torch.memory_format
) -> None:
    layer = random_network(channels=(4, 6, 10), cnn="centred").double().extractor.blocks[2].first
    layer = layer.to(memory_format=layout)
    generator = torch.Generator().manual_seed(3)
    x = torch.rand(5, 6, 3, 3, generator=generator).double().contiguous(memory_format=layout).requires_grad_()
    expected, actual = layer.norm(layer.conv(x)), layer(x)
    assert torch.allclose(actual, expected, atol=1e-12)
    towards = torch.randn(expected.shape, generator=generator).double()
    inputs = (x, *layer.parameters())
    for ours, theirs in zip(
        torch.autograd.grad(actual, inputs, towards), torch.autograd.grad(expected, inputs, towards), strict=True
    ):
        assert torch.allclose(ours, theirs, atol=1e-10)
        assert ours.any()


def test_that_of_gnn_baseline_stacks_convolutions_and_pools_after_every_other(
    random_network: Callable, fields_of_view: torch.Tensor
) -> None:
    extractor = random_network("GNN_baseline-F-16", channels=(3, 4, 5)).double().extractor
    expected = []
    for field_of_view in fields_of_view.tolist():
        x, shapes = field_of_view, []
        for block in extractor.blocks:
            x = pooled(sigma(convolved(x, block.first)))
            shapes.append(shape(x))
            if len(shapes) < 3:
                x = sigma(convolved(x, block.second))
                assert shape(x) == shapes[-1]
        assert shapes == [(3, 5, 5), (4, 2, 2), (5, 1, 1)]
        assert extractor.blocks[2].second is None
        expected.append(features(x, extractor.linear))
    assert extractor(fields_of_view).detach().numpy() == pytest.approx(np.array(expected), abs=1e-10)


@pytest.mark.parametrize("side", [11, 6])
def test_a_skip_is_a_strided_convolution_backwards_too(random_network: Callable, side: int) -> None:
    block = random_network(channels=(4, 6, 10)).double().extractor.blocks[1]
    generator = torch.Generator().manual_seed(3)
    x = torch.rand(2, 4, side, side, generator=generator).double().requires_grad_()
    inner = torch.nn.functional.conv2d(x, block.first.conv.weight, stride=2, padding=1)
    inner = block.second(block.first.norm(inner).clamp(0, CAP))
    skip = block.skip.norm(torch.nn.functional.conv2d(x, block.skip.conv.weight, stride=2))
    expected, actual = (inner + skip).clamp(0, CAP), block(x)
    assert torch.allclose(actual, expected, atol=1e-12)
    towards = torch.randn(expected.shape, generator=generator).double()
    inputs = (x, *block.parameters())
    for ours, theirs in zip(
        torch.autograd.grad(actual, inputs, towards), torch.autograd.grad(expected, inputs, towards), strict=True
    ):
        assert torch.allclose(ours, theirs, atol=1e-10)
        assert ours.any()


@pytest.mark.parametrize(
    ("name", "cnn"), [("MAGAT-F-16", "padded"), ("MAGAT-F-16", "centred"), ("GNN_baseline-F-16", "padded")]
)
def test_each_convolution_is_normalised_and_belongs_to_one_of_the_sums(
    random_network: Callable, name: str, cnn: str
) -> None:
    extractor = random_network(name, cnn=cnn).extractor
    convolutions = [module for module in extractor.modules() if isinstance(module, torch.nn.Conv2d)]
    assert len(convolutions) == (5 if "baseline" in name else 10)
    in_sums = [layer.conv for added in extractor.sums() for layer in added.convs]
    assert sorted(map(id, in_sums)) == sorted(map(id, convolutions))
    # Only the first convolution gets zeros and ones as inputs.
    assert [added.input_max for added in extractor.sums()] == [1.0, *[8.0] * (len(extractor.sums()) - 1)]
    assert extractor.sums()[0].convs[0].conv.in_channels == 3
