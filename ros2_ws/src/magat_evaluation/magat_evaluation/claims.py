# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a claim of the paper is, how it is tested on what was measured, and its verdict."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

from magat_evaluation.comparison import Estimate
from magat_evaluation.measured import IDLE, Measured

#: Two success rates that differ by less are called comparable.
COMPARABLE = 0.05


class Verdict(StrEnum):
    """What the measures say of a claim."""

    REPRODUCED = "reproduced"
    #: The interval holds values for which the claim is true, and values for which it is false.
    NOT_SHOWN = "not shown"
    NOT_REPRODUCED = "not reproduced"
    NOT_COMPARABLE = "not comparable"
    NOT_MEASURED = "not yet measured"


@dataclass(frozen=True)
class Finding:
    """A verdict, and the numbers or the reason behind it."""

    verdict: Verdict
    text: str = ""


Test = Callable[[Measured], Finding]


@dataclass(frozen=True)
class Claim:
    """Something that the paper says of its results."""

    #: Section, figure or table.
    source: str
    text: str
    test: Test
    #: Letters of the panels of the paper's figure of results, from a, row by row, that show it.
    panels: str = ""
    #: What else there is to say.
    remark: str = ""


def shown(estimate: Estimate, signed: bool = False) -> str:
    """The value of ``estimate`` with its interval."""
    sign = "+" if signed else ""
    return f"{estimate.value:{sign}.3f} ({estimate.low:{sign}.3f} to {estimate.high:{sign}.3f})"


def level(measure: str, policy: str, maps: Sequence[str], bound: float, at_most: bool = False) -> Test:
    """``policy`` reaches at least, or at most, ``bound`` on each of ``maps``."""

    def test(measured: Measured) -> Finding:
        found = {place: measured.level(measure, policy, place) for place in maps}
        known = {place: estimate for place, estimate in found.items() if estimate is not None}
        above = [estimate.above(bound) for estimate in known.values()]
        verdict = _all([None if one is None else one != at_most for one in above])
        if not known or (len(known) < len(maps) and verdict != Verdict.NOT_REPRODUCED):
            return Finding(Verdict.NOT_MEASURED)
        pick = max if at_most else min
        worst = pick(known, key=lambda place: known[place].value)
        return Finding(verdict, shown(known[worst]) + (f", {worst}" if len(maps) > 1 else ""))

    return test


def difference(
    measure: str, coefficients: Mapping[str, float], maps: Sequence[str], margin: float = 0.0, lower: bool = False
) -> Test:
    """The sum of coefficients times the means of policies over ``maps`` is above ``margin``; below -margin if lower."""

    def test(measured: Measured) -> Finding:
        weights = {(policy, IDLE): coefficient for policy, coefficient in coefficients.items()}
        estimate = measured.estimate(measure, weights, maps)
        if estimate is None:
            return Finding(Verdict.NOT_MEASURED)
        above = estimate.above(-margin if lower else margin)
        return Finding(_all([None if above is None else above != lower]), _numbers(estimate))

    return test


def ordered(measure: str, policies: Sequence[str], maps: Sequence[str]) -> Test:
    """Each of ``policies`` has a higher mean than the next."""
    pairs = list(pairwise(policies))

    def test(measured: Measured) -> Finding:
        found = [measured.estimate(measure, {(a, IDLE): 1.0, (b, IDLE): -1.0}, maps) for a, b in pairs]
        known = [estimate for estimate in found if estimate is not None]
        if len(known) < len(pairs):
            return Finding(Verdict.NOT_MEASURED)
        return Finding(_all([one.above(0.0) for one in known]), "; ".join(shown(one, signed=True) for one in known))

    return test


def alike(measure: str, one: str, other: str, maps: Sequence[str]) -> Test:
    """The means of two policies differ by less than `COMPARABLE`."""

    def test(measured: Measured) -> Finding:
        estimate = measured.estimate(measure, {(one, IDLE): 1.0, (other, IDLE): -1.0}, maps)
        if estimate is None:
            return Finding(Verdict.NOT_MEASURED)
        return Finding(_all([estimate.within(COMPARABLE)]), _numbers(estimate))

    return test


def most(tests: Sequence[Test]) -> Test:
    """More than half of ``tests`` are passed; those that were not measured count as not passed."""

    def test(measured: Measured) -> Finding:
        verdicts = [one(measured).verdict for one in tests]
        count = {verdict: verdicts.count(verdict) for verdict in Verdict}
        text = ", ".join(f"{number} {verdict}" for verdict, number in count.items() if number)
        half = len(tests) / 2
        if count[Verdict.NOT_MEASURED] == len(tests):
            return Finding(Verdict.NOT_MEASURED)
        if count[Verdict.REPRODUCED] > half:
            return Finding(Verdict.REPRODUCED, text)
        if count[Verdict.NOT_REPRODUCED] >= half:
            return Finding(Verdict.NOT_REPRODUCED, text)
        return Finding(Verdict.NOT_MEASURED if count[Verdict.NOT_MEASURED] >= half else Verdict.NOT_SHOWN, text)

    return test


def incomparable(reason: str) -> Test:
    """No measure here can be compared with the claim."""
    return lambda _: Finding(Verdict.NOT_COMPARABLE, reason)


def _all(passed: Sequence[bool | None]) -> Verdict:
    """The verdict on a claim that holds where all of ``passed`` are True; None is undecided."""
    if False in passed:
        return Verdict.NOT_REPRODUCED
    return Verdict.NOT_SHOWN if None in passed else Verdict.REPRODUCED


def _numbers(estimate: Estimate) -> str:
    trainings = "" if estimate.trainings == 1 else f", {estimate.trainings} trainings"
    return f"{shown(estimate, signed=True)}, {estimate.cases} cases{trainings}"
