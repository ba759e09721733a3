# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Comparison of policies on the same cases: combinations of means, with bootstrap intervals; trainings are a factor."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

RESAMPLES = 2000
SEED = 2021

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A mean, or a combination of means, with its 95 % interval."""

    value: float
    low: float
    high: float
    #: Cases in common.
    cases: int
    #: The smallest number of trainings of a policy in it.
    trainings: int

    def above(self, bound: float) -> bool | None:
        """Whether it is above ``bound``; None if the interval holds both."""
        return True if self.low > bound else False if self.high < bound else None

    def within(self, margin: float) -> bool | None:
        """Whether it is within ``margin`` of 0; None if the interval holds both."""
        if -margin < self.low and self.high < margin:
            return True
        return False if self.low > margin or self.high < -margin else None


def combine(terms: Sequence[tuple[float, Sequence[Array]]], rate: bool) -> Estimate:
    """The sum of coefficients times the means of policies, over the cases that all of them share.

    The interval is a percentile bootstrap. Cases are drawn once for all policies, so that what makes a case hard or
    easy for everybody cancels. Trainings are drawn for each policy on its own, one fewer than there are, which makes
    the variance of a mean of few unbiased (Rao and Wu, JASA 1988). Of a single training the interval says nothing about
    another one.

    A rate of 0 or 1 would have an interval without width. So for rates one case is added in which the combination has
    the largest value that it can have, and one with the smallest (for a pair: Bonett and Price, 2012).

    Args:
        terms: for each policy its coefficient, and for each of its trainings ``[cases]`` values. Arrays that are longer
            than others begin with the same cases.
        rate: whether the values are 0 or 1.
    """
    cases = min(len(values) for _, trainings in terms for values in trainings)
    coefficients = np.array([coefficient for coefficient, _ in terms])
    stacks = [np.stack([values[:cases] for values in trainings]) for _, trainings in terms]
    value = float(sum(c * stack.mean() for c, stack in zip(coefficients, stacks, strict=True)))
    if rate:
        best = (coefficients > 0).astype(np.float64)
        stacks = [
            np.concatenate([stack, np.full((len(stack), 1), b), np.full((len(stack), 1), 1 - b)], axis=1)
            for stack, b in zip(stacks, best, strict=True)
        ]
    rng = np.random.default_rng(SEED + 1)
    weights = _weights(stacks[0].shape[1])
    drawn = np.zeros(RESAMPLES)
    for coefficient, stack in zip(coefficients, stacks, strict=True):
        means = weights @ stack.T  # [RESAMPLES, trainings]
        trainings = len(stack)
        if trainings > 1:
            draws = rng.integers(trainings, size=(RESAMPLES, trainings - 1))
            means = np.take_along_axis(means, draws, axis=1)
        drawn += coefficient * means.mean(axis=1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return Estimate(value, float(low), float(high), cases, min(map(len, stacks)))


@lru_cache(maxsize=4)
def _weights(cases: int) -> Array:
    """``[RESAMPLES, cases]`` how often each case is drawn, as a share."""
    return np.random.default_rng(SEED).multinomial(cases, np.full(cases, 1 / cases), size=RESAMPLES) / cases
