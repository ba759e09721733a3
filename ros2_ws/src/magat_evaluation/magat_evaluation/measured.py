# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What was measured of the paper's test sets, by policy, map and condition, with all trainings of a policy."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from magat_evaluation.comparison import Array, Estimate, combine
from magat_evaluation.report import Report

#: What a folder's name adds to the policy's for a training with another seed, e.g. MAGAT-F-128-S1.
_SEED = re.compile(r"-S\d+$")
#: Measures that are 0 or 1 in each case.
RATES = ("alpha", "alpha_strict")


def family(name: str) -> str:
    """The name that all trainings of a policy share: ``name`` without the seed at its end."""
    return _SEED.sub("", name)


@dataclass(frozen=True)
class Condition:
    """How a policy was run."""

    shield: str = "idle"
    mute: bool = False


IDLE = Condition()


class Measured:
    """Reports of the paper's test sets."""

    def __init__(self, reports: Sequence[Report]) -> None:
        """Index ``reports``, in any order; of two of one policy in one place, that of more cases counts."""
        latest = {(r.policy, *_key(r)): r for r in sorted(reports, key=lambda report: report.cases)}
        self.reports = sorted(latest.values(), key=lambda report: report.policy)
        self._trainings: dict[tuple[str, str, Condition], list[Report]] = {}
        for report in self.reports:
            self._trainings.setdefault(_key(report), []).append(report)

    def report(self, policy: str, place: str, condition: Condition = IDLE) -> Report | None:
        """The report of ``policy``, of one training; None if there is none."""
        return next((r for r in self.trainings(policy, place, condition) if r.policy == policy), None)

    def trainings(self, policy: str, place: str, condition: Condition = IDLE) -> list[Report]:
        """The reports of all trainings of ``policy``, by name."""
        return self._trainings.get((policy, place, condition), [])

    def estimate(
        self,
        measure: str,
        coefficients: Mapping[tuple[str, Condition], float],
        places: Sequence[str],
    ) -> Estimate | None:
        """The sum of coefficients times the means of policies over all cases of ``places``; None if one is missing.

        Args:
            measure: see `Outcomes.values`.
            coefficients: by policy and condition.
            places: names of sets; a case of each counts alike.
        """
        terms = []
        for (policy, condition), coefficient in coefficients.items():
            found = [[r for r in self.trainings(policy, place, condition) if r.outcomes] for place in places]
            names = set.intersection(*({report.policy for report in reports} for reports in found))
            if not names:
                return None
            terms.append((coefficient, [[_values(r, measure) for r in rs if r.policy in names] for rs in found]))
        # For each place as many cases as all policies have there, and then all places one after the other.
        counts = [min(len(values) for _, found in terms for values in found[place]) for place in range(len(places))]
        joined = [
            (coefficient, [np.concatenate([values[:count] for values, count in zip(training, counts, strict=True)])
                           for training in zip(*found, strict=True)])
            for coefficient, found in terms
        ]  # fmt: skip
        return combine(joined, measure in RATES)

    def level(self, measure: str, policy: str, place: str, condition: Condition = IDLE) -> Estimate | None:
        """The mean of ``policy`` on one map; None if it is missing. A rate of one training has Wilson's interval."""
        found = self.trainings(policy, place, condition)
        if measure == "alpha" and len(found) == 1:
            return Estimate(found[0].alpha, *found[0].alpha_interval, cases=found[0].cases, trainings=1)
        return self.estimate(measure, {(policy, condition): 1.0}, [place])


def _key(report: Report) -> tuple[str, str, Condition]:
    return family(report.policy), report.set_name, Condition(report.shield, report.mute)


def _values(report: Report, measure: str) -> Array:
    assert report.outcomes is not None
    return report.outcomes.values(measure, report.robots)
