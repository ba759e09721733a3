# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fixed-point arithmetic, whose results do not depend on batch size, order of messages or number of threads.

A robot computes alone, and a simulator computes thousands of robots at once. Floating-point sums depend on the order
of their terms, and so on the batch. Such a difference would sometimes change a decision, and two runs of one episode
would then diverge. Therefore weights and activations of a policy in fixed point are multiples of powers of two (the
grid), chosen so that every sum of products is exact: it stays below 2**24 units in float32 and below 2**53 units in
float64. Exact sums do not depend on their order. All other operations round a single number once or read a table.
"""

import functools
import math
from typing import Any

import torch
from torch import Tensor, nn

from magat_robot.policy.grids import (
    ACTIVATION_BITS,
    ACTIVATION_MAX,
    EXP_TABLE_BITS,
    EXPONENT_BITS,
    SIGNED_MAX,
    SUM_MAX,
    exp_table,
)

__all__ = ["ACTIVATION_BITS", "ACTIVATION_MAX", "EXPONENT_BITS", "EXP_TABLE_BITS", "SIGNED_MAX", "SUM_MAX"]

#: Weights of layers computed in float64 are multiples of 2**-FLOAT64_WEIGHT_BITS, and their magnitudes add up to at
#: most FLOAT64_WEIGHT_SUM. With inputs up to SUM_MAX in multiples of 2**-8, sums stay below 2**53 units.
FLOAT64_WEIGHT_BITS = 16
FLOAT64_WEIGHT_SUM = 2.0**16
_FLOAT32_UNITS = 2.0**24
_MAX_WEIGHT_BITS = 14


def snap(x: Tensor, bits: int, low: float, high: float) -> Tensor:
    """``x`` rounded to multiples of ``2**-bits`` (half to even), then clamped to ``[low, high]``; same shape, dtype."""
    return (x * 2.0**bits).round_().mul_(2.0**-bits).clamp_(low, high)


class _Capped(torch.autograd.Function):
    """clamp(0, ACTIVATION_MAX) with a gradient that takes one pass over memory and keeps the input's layout.

    The gradient of torch's own clamp takes four passes or changes the layout, a fifth of all training time.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        ctx.save_for_backward(x)
        return x.clamp(0.0, ACTIVATION_MAX)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        (x,) = ctx.saved_tensors
        result = torch.empty_like(x)
        return torch.ops.aten.hardtanh_backward.grad_input(gradient, x, 0.0, ACTIVATION_MAX, grad_input=result)


def rectified(x: Tensor, exact: bool) -> Tensor:
    """sigma: ReLU, capped at `ACTIVATION_MAX`; rounded to multiples of ``2**-ACTIVATION_BITS`` if ``exact``."""
    return snap(x, ACTIVATION_BITS, 0.0, ACTIVATION_MAX) if exact else _Capped.apply(x)


class Exactable(nn.Module):
    """A module that computes in fixed point if ``exact`` is set, as `to_fixed_point` does."""

    exact = False


def weight_bits(weights: list[Tensor], biases: list[Tensor], input_bits: int, input_max: float) -> Tensor:
    """The resolution of each output channel's weights at which its float32 sum stays exact.

    Args:
        weights: tensors ``[C, ...]`` whose products are added up in output channel c.
        biases: tensors ``[C]``, added to them.
        input_bits: the inputs are multiples of ``2**-input_bits`` ...
        input_max: ... of at most this magnitude.

    Returns:
        ``[C]`` the largest k, at most 14, for which the sum of magnitudes, in units of ``2**-(k + input_bits)``, stays
        below 2**24, with a margin for the rounding of the weights themselves.

    Raises:
        ValueError: the weights are too large for any k from 0.
    """
    terms = sum(w[0].numel() for w in weights)
    # In float64, because float32 would round these sums.
    magnitude = torch.stack([w.double().abs().flatten(1).sum(1) for w in weights]).sum(0)
    bias = torch.stack([b.double().abs() for b in biases]).sum(0)
    # Rounding changes each of the `terms` weights by at most half a unit, and the bias by less than one.
    room = _FLOAT32_UNITS * 2.0**-input_bits / input_max - 0.5 * terms - 1.0
    bits = torch.floor(torch.log2(room / (magnitude + bias / input_max).clamp_min(1e-9)))
    if (bits < 0).any():
        raise ValueError(f"weights of magnitude {float(magnitude.max()):.3g} per output are too large for exact sums")
    return bits.clamp_max(_MAX_WEIGHT_BITS).float()


def snap_rows(tensor: Tensor, bits: Tensor) -> Tensor:
    """``tensor`` ``[C, ...]`` with row c rounded to multiples of ``2**-bits[c]``."""
    unit = torch.exp2(-bits).view(-1, *[1] * (tensor.dim() - 1))
    return (tensor / unit).round() * unit


def snap_float64(weights: Tensor, name: str) -> Tensor:
    """``weights`` of a layer computed in float64, rounded to multiples of ``2**-FLOAT64_WEIGHT_BITS``.

    Args:
        weights: any shape, float64.
        name: of the weights, for the error.

    Raises:
        ValueError: the weights are too large.
    """
    if weights.abs().sum() > FLOAT64_WEIGHT_SUM:
        raise ValueError(f"weights {name} of magnitude {float(weights.abs().max()):.3g} are too large for exact sums")
    return (weights * 2.0**FLOAT64_WEIGHT_BITS).round() * 2.0**-FLOAT64_WEIGHT_BITS


def exp_weights(exponents: Tensor, present: Tensor | None = None) -> Tensor:
    """Unnormalised softmax over the last dimension, as whole numbers.

    Args:
        exponents: ``[..., M]`` float64, multiples of ``2**-EXPONENT_BITS``.
        present: ``[..., M]`` bool, which entries take part; all if None.

    Returns:
        ``[..., M]`` float64 integers, ``round(2**24 * exp(exponent - the largest one))``, 0 where not present.
    """
    if exponents.shape[-1] == 0:
        return exponents.clone()
    if present is not None:
        exponents = exponents.masked_fill(~present, -math.inf)
    below = exponents.amax(dim=-1, keepdim=True) - exponents
    table = _exp_table()
    # Without any entry present a row is inf - inf = nan, and gets the weights of -inf, which are 0.
    steps = (
        (below * 2.0**EXPONENT_BITS).nan_to_num(len(table) - 1.0, posinf=len(table) - 1.0).clamp_max(len(table) - 1.0)
    )
    return table[steps.long()]


@functools.cache
def _exp_table() -> Tensor:
    """`exp_table` as ``[n]`` float64."""
    return torch.tensor(exp_table(), dtype=torch.float64)
