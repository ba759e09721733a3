# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Chooses a policy's sampling temperature for each shield, on validation cases of small and large maps."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from magat_evaluation.candidates import Candidate, Setting
from magat_evaluation.executor import Workers
from magat_evaluation.points import Point, measure_points
from magat_evaluation.report import Report
from magat_evaluation.sets import CaseSet
from magat_robot.policy.folder import write_temperatures
from magat_sim.simulator import DEFAULT_RULES, Rules

#: Temperatures that are compared.
TEMPERATURES = (0.25, 0.35, 0.5, 0.75, 1.0)
#: Cases that they are compared on.
TUNING_SETS = (CaseSet.square(20, 10, 300, split="valid"), CaseSet.square(65, 100, 50, split="valid"))


def tune(
    name: str,
    folder: Path,
    shields: Sequence[str],
    temperatures: Sequence[float],
    sets: Sequence[CaseSet],
    output: Path,
    console: Console,
    workers: Workers = 1,
) -> dict[str, float]:
    """Choose the temperature with the highest `score` for each shield, and keep it in the policy's folder.

    Args:
        name: of the policy in tables.
        folder: of the policy.
        shields: for which a temperature is chosen.
        temperatures: that are compared; of equal ones the first is chosen.
        sets: validation cases.
        output: CSV file of the reports. Points that it has are not measured again.
        console: shows the progress.
        workers: see `executor`.

    Returns:
        The temperature by shield.

    Raises:
        InvalidCaseError: a set has no cases that can be drawn and solved.
        ModelError: the policy cannot be used, or a temperature is out of range.
    """
    pairs = [(shield, temperature) for shield in shields for temperature in temperatures]
    candidates = [Candidate.of_policy(folder, Setting(at, rules=Rules(shield=shield)), name) for shield, at in pairs]
    points = [Point(candidate, cases) for cases in sets for candidate in candidates]
    reports = measure_points(points, output, console, workers, f"temperatures of {name}")
    scores = {
        pair: score([report for report in reports if (report.shield, report.temperature) == pair]) for pair in pairs
    }
    chosen = {
        shield: max(temperatures, key={at: scores[shield, at] for at in temperatures}.__getitem__) for shield in shields
    }
    write_temperatures(folder, chosen, DEFAULT_RULES.shield)
    return chosen


def score(reports: Sequence[Report]) -> float:
    """alpha - delta_FT by first visit, on average over maps: by this, training also chooses its checkpoint."""
    return sum(report.alpha - report.delta_ft for report in reports) / len(reports)
