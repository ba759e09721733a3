# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The paper's test sets, with the baselines and the controls."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from magat_evaluation.baselines import BASELINES
from magat_evaluation.candidates import Candidate, Setting
from magat_evaluation.family import REPEATED
from magat_evaluation.measured import family
from magat_evaluation.points import Point
from magat_evaluation.report import Report
from magat_evaluation.sets import FULL_CASES, FULL_MAPS, TEST_SETS, CaseSet
from magat_evaluation.studies.curves import ALPHA, DELTA_FT, P_RG, Across, draw_arrivals, draw_curves
from magat_evaluation.studies.study import Picture, Study, register
from magat_evaluation.tables import MEASURES, measure_cells
from magat_robot.policy.folder import read_folder
from magat_sim.shield import SHIELDS
from magat_sim.simulator import Rules

#: HCA and Replan plan too long for the teams of the set large.
SLOW_BASELINES = ("HCA", "Replan")
#: The paper's shield.
HEADLINE = "idle"


def test_set(name: str, points: Sequence[Point]) -> Study:
    """One of the paper's test sets, of ``points``."""
    pictures = [Picture(f"Test set: {name}", "", draw)]
    if name == "large":
        pictures.append(Picture("Robots that reached their goals", "-arrivals", draw_arrivals))
    return Study(
        name,
        f"Test set: {name}",
        tuple(points),
        ("map (robots)", "policy", "T", "cases", *MEASURES),
        row,
        tuple(pictures),
        lambda report: f"### {name}: shield {report.shield}",
    )


def set_points(name: str, candidates: Sequence[Candidate]) -> list[Point]:
    """``candidates`` on each map of a test set; those of `REPEATED` on more cases of `FULL_MAPS`."""
    return [Point(one, _cases(one, cases)) for cases in TEST_SETS[name] for one in candidates]


def full_test_set(name: str, policies: Mapping[str, Path]) -> Study:
    """One of the paper's test sets, of ``policies`` and the control mute under each shield, and of the baselines."""
    baselines = [baseline for baseline in BASELINES if name != "large" or baseline not in SLOW_BASELINES]
    points: list[Point] = []
    for shield in sorted(SHIELDS, key=lambda shield: shield != HEADLINE):
        controls = [Candidate.of_baseline(one, shield) for one in baselines if shield in BASELINES[one].shields]
        talking = [_policy(folder, shield, 0.0, policy) for policy, folder in policies.items()]
        points += set_points(name, [*controls, *talking, *_mute(policies, shield)])
    return test_set(name, points)


for _name in TEST_SETS:
    register(_name)(partial(full_test_set, _name))


def _policy(folder: Path, shield: str, link_loss: float, name: str) -> Candidate:
    return Candidate.of_policy(folder, Setting(rules=Rules(link_loss, shield)), name)


def _mute(policies: Mapping[str, Path], shield: str) -> Iterator[Candidate]:
    """The policies with all links lost, those apart that never communicate."""
    for name, folder in policies.items():
        if read_folder(folder)[0].communicates:
            yield _policy(folder, shield, 1.0, name)


def _is_full(candidate: Candidate) -> bool:
    mute = candidate.rules.link_loss == 1.0
    return family(candidate.name) in REPEATED and candidate.rules.shield == HEADLINE and not mute


def _cases(candidate: Candidate, cases: CaseSet) -> CaseSet:
    return replace(cases, cases=FULL_CASES) if _is_full(candidate) and cases.name in FULL_MAPS else cases


def row(report: Report) -> tuple[str, ...]:
    """The row of a report."""
    at = f"{report.temperature:g}" if report.digest else ""
    return (report.set_name, report.label, at, str(report.cases), *measure_cells(report))


def draw(reports: Sequence[Report], path: Path) -> None:
    """Draw alpha, delta_FT and p_rg by map into a PNG file, a picture a shield; without the rows that are mute."""
    reports = [report for report in reports if not report.mute]
    names = list(dict.fromkeys(report.set_name for report in reports))
    policies = list(dict.fromkeys(report.policy for report in reports))

    def place(report: Report) -> float:
        """Policies side by side: their intervals must not cover each other."""
        return names.index(report.set_name) + 0.5 * ((policies.index(report.policy) + 0.5) / len(policies) - 0.5)

    across = Across("map (robots)", place, names=names)
    draw_curves(reports, lambda report: f"{report.shield} shield", across, [ALPHA, DELTA_FT, P_RG], path)
