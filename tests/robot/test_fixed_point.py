# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fixed-point arithmetic: rounding, bounds of exact sums, and the table of exponentials."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_robot.policy import fixed_point as fp


def test_snap_rounds_half_to_even_and_clamps_without_touching_its_input() -> None:
    x = torch.tensor([0.124, 0.125, 0.375, -0.125, -0.3, 9.0, -9.0])
    before = x.clone()
    assert fp.snap(x, 2, -1.0, 2.0).tolist() == [0.0, 0.0, 0.5, 0.0, -0.25, 2.0, -1.0]
    assert torch.equal(x, before)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_rectified_cuts_both_ends_and_is_on_the_grid_only_if_exact(dtype: torch.dtype) -> None:
    x = torch.tensor([-3.0, 0.3, 7.996, 8.3], dtype=dtype)
    assert fp.rectified(x, exact=False).tolist() == pytest.approx([0.0, 0.3, 7.996, 8.0])
    exact = fp.rectified(x, exact=True)
    assert exact.tolist() == [0.0, 19 / 64, 8.0, 8.0]
    assert exact.dtype == dtype


def test_the_gradient_of_sigma_is_that_of_the_numbers() -> None:
    x = torch.tensor([-9.0, -1e-3, 1e-3, 0.3, 4.0, 7.999, 8.001, 30.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x: fp.rectified(x, exact=False), x, eps=1e-6)
    (gradient,) = torch.autograd.grad(fp.rectified(x, exact=False).sum(), x)
    assert gradient.tolist() == [0, 0, 1, 1, 1, 1, 0, 0]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("incoming", ["alike", "in another layout", "one number for all"])
@pytest.mark.parametrize("layout", [torch.contiguous_format, torch.channels_last])
def test_the_gradient_of_sigma_is_that_of_torch_and_keeps_the_layout(
    dtype: torch.dtype, incoming: str, layout: torch.memory_format
) -> None:
    generator = torch.Generator().manual_seed(0)
    values = torch.randn(3, 4, 5, 6, generator=generator, dtype=dtype) * 8
    x = values.contiguous(memory_format=layout).requires_grad_()
    towards = torch.randn(3, 4, 5, 6, generator=generator, dtype=dtype).contiguous(memory_format=layout)
    if incoming == "in another layout":
        towards = towards.transpose(0, 2).contiguous().transpose(0, 2)
    elif incoming == "one number for all":
        towards = torch.ones(1, dtype=dtype).expand(3, 4, 5, 6)
    ours, theirs = fp.rectified(x, exact=False), x.clamp(0.0, 8.0)
    assert torch.equal(ours, theirs)
    assert ours.is_contiguous(memory_format=layout)
    (gradient,) = torch.autograd.grad(ours, x, towards)
    assert torch.equal(gradient, *torch.autograd.grad(theirs, x, towards))
    assert gradient.is_contiguous(memory_format=layout)
    assert gradient.dtype == dtype


def test_nothing_flows_back_through_a_sigma_whose_input_is_zero() -> None:
    # As with a ReLU. Exact zeros are frequent: sums whose inputs are all zero.
    x = torch.zeros(3, requires_grad=True)
    (gradient,) = torch.autograd.grad(fp.rectified(x, exact=False).sum(), x)
    assert not gradient.any()


@st.composite
def summed_layers(draw: st.DrawFn) -> tuple[list[torch.Tensor], torch.Tensor, int, float]:
    """Weights, bias and input range of one or two convolutions that are added up, chosen as bad cases of rounding."""
    generator = torch.Generator().manual_seed(draw(st.integers(0, 2**32 - 1)))
    channels = draw(st.integers(1, 3))
    input_bits, input_max = draw(st.sampled_from([(0, 1.0), (6, 8.0)]))
    terms = draw(st.lists(st.sampled_from([1, 27, 288, 1152]), min_size=1, max_size=2))
    magnitude = 2.0 ** draw(st.integers(-4, 14)) / input_max / 2**input_bits
    kind = draw(st.sampled_from(["random", "equal", "half a unit", "one large"]))
    nudge = 1 + draw(st.integers(-8, 8)) * 2.0**-24
    weights = []
    for count in terms:
        w = torch.rand(channels, count, generator=generator)
        if kind == "equal":
            w = torch.ones(channels, count)
        elif kind == "half a unit":
            # Just above half a unit: each weight is rounded up by half a unit.
            w = (torch.randint(0, 40, (channels, count), generator=generator) + 0.5001) * 2.0 ** -draw(
                st.integers(0, 14)
            )
        elif kind == "one large":
            w = torch.full((channels, count), 1e-4)
            w[:, 0] = 1.0
        sign = torch.randint(0, 2, w.shape, generator=generator) * 2 - 1
        weights.append(w * sign)
    if kind != "half a unit":
        # Scaled so that the sum is at the bound of a power of two.
        total = sum(w.abs().sum(1, keepdim=True) for w in weights)
        weights = [w / total * magnitude * 1024 * nudge for w in weights]
    bias = torch.rand(channels, generator=generator) * draw(st.sampled_from([0.0, 1.0, 100.0]))
    return weights, bias, input_bits, input_max


@settings(max_examples=400)
@given(summed_layers())
def test_weight_bits_keep_every_sum_below_two_to_the_24_units(
    layers: tuple[list[torch.Tensor], torch.Tensor, int, float],
) -> None:
    weights, bias, input_bits, input_max = layers
    try:
        bits = fp.weight_bits(weights, [bias], input_bits, input_max)
    except ValueError:
        # Refused: even whole numbers exceed the bound, or nearly so.
        assert units(weights, bias, torch.zeros(len(bias)), input_bits, input_max).max() > 0.9 * 2**24
        return
    assert ((bits >= 0) & (bits <= 14) & (bits == bits.round())).all()
    stored = [fp.snap_rows(w, bits) for w in weights]
    most = units(stored, fp.snap_rows(bias, bits + input_bits), bits, input_bits, input_max)
    assert (most < 2**24).all()
    # One bit more would exceed the bound: no bits are wasted.
    finer = units(weights, bias, bits + 1, input_bits, input_max)
    assert ((finer > 0.9 * 2**24) | (bits == 14)).all()


def units(
    weights: list[torch.Tensor], bias: torch.Tensor, bits: torch.Tensor, input_bits: int, input_max: float
) -> torch.Tensor:
    """The largest possible magnitude of each sum in its units, exact in float64."""
    magnitude = sum(w.double().abs().sum(1) for w in weights) * input_max + bias.double().abs()
    return magnitude * torch.exp2(bits.double() + input_bits)


def test_weight_bits_are_counted_channel_by_channel() -> None:
    weights = torch.tensor([[1.0, 1.0], [1000.0, 1.0], [0.0, 0.0]])
    bits = fp.weight_bits([weights], [torch.zeros(3)], 6, 8.0)
    # The bound is 2**24 / 2**6 / 8 = 2**15; the magnitudes of the rows are 2, 1001 and 0.
    assert bits.tolist() == [13, 5, 14]


def test_weights_too_large_for_any_grid_are_refused() -> None:
    with pytest.raises(ValueError, match="too large for exact sums"):
        fp.weight_bits([torch.full((1, 9), 4000.0)], [torch.zeros(1)], 6, 8.0)


def test_weights_in_float64_are_rounded_and_refused_by_name_where_they_add_up_to_more_than_two_to_the_16() -> None:
    weights = torch.tensor([[1.0, -3.3e-5], [-(2.0**15), 2.0**15 - 2]], dtype=torch.float64)
    snapped = fp.snap_float64(weights, "some.weight")
    assert snapped.tolist() == [[1.0, -2 * 2.0**-16], [-(2.0**15), 2.0**15 - 2]]
    weights[0, 0] = 3.0
    with pytest.raises(ValueError, match=r"some\.weight .*too large for exact sums"):
        fp.snap_float64(weights, "some.weight")


@given(st.integers(0, 2**32 - 1))
def test_snap_rows_rounds_each_row_to_the_nearest_of_its_own_grid(seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    bits = torch.randint(0, 15, (5,), generator=generator).float()
    tensor = torch.randn(5, 2, 3, generator=generator) * 10
    snapped = fp.snap_rows(tensor, bits)
    for row in range(5):
        unit = 2.0 ** -int(bits[row])
        steps = snapped[row].double() / unit
        assert torch.equal(steps, steps.round())
        assert (snapped[row].double() - tensor[row].double()).abs().max() <= unit / 2


def test_exponentials_are_those_of_the_mathematics_library_rounded_once() -> None:
    steps = torch.arange(0, 6000)
    weights = fp.exp_weights(torch.stack([torch.zeros(6000), -steps / 256], dim=1).double())
    assert (weights[:, 0] == 2**24).all()
    expected = [round(2**24 * math.exp(-step / 256)) for step in steps.tolist()]
    assert weights[:, 1].tolist() == expected
    assert expected[-1] == 0 < expected[4000]


@given(st.lists(st.integers(-3000, 3000), min_size=1, max_size=9), st.integers(-2000, 2000))
def test_exponents_count_relative_to_the_largest(steps: list[int], shift: int) -> None:
    exponents = torch.tensor(steps, dtype=torch.float64) / 256
    weights = fp.exp_weights(exponents)
    assert weights.max() == 2**24
    assert torch.equal(weights, fp.exp_weights(exponents + shift / 256))
    largest = max(steps)
    assert weights.tolist() == [round(2**24 * math.exp((step - largest) / 256)) for step in steps]


def test_entries_that_are_absent_weigh_nothing_and_change_nothing() -> None:
    exponents = torch.tensor([[3.0, 9.0, 2.0], [1.0, 2.0, 3.0]], dtype=torch.float64)
    present = torch.tensor([[True, False, True], [False, False, False]])
    weights = fp.exp_weights(exponents, present)
    assert weights.tolist() == [[2**24, 0, round(2**24 / math.e)], [0, 0, 0]]
    assert exponents[0, 1] == 9.0
    assert fp.exp_weights(torch.zeros(4, 2, 0).double(), torch.zeros(4, 2, 0, dtype=torch.bool)).shape == (
        4,
        2,
        0,
    )


def test_exponents_far_below_weigh_nothing_however_far() -> None:
    assert fp.exp_weights(torch.tensor([0.0, -30.0, -1e6, -math.inf]).double()).tolist() == [2**24, 0, 0, 0]
