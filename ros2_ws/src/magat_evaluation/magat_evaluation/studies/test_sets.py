"""The paper's test sets, with the baselines."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from magat_evaluation.candidates import Candidate, Setting
from magat_evaluation.points import Point
from magat_evaluation.report import Report
from magat_evaluation.sets import TEST_SETS
from magat_evaluation.studies.curves import ALPHA, DELTA_FT, P_RG, Across, draw_arrivals, draw_curves
from magat_evaluation.studies.study import Picture, Study, register
from magat_evaluation.tables import measure_cells
from magat_sim.shield import SHIELDS
from magat_sim.simulator import Rules

#: Baselines of the sets. HCA and Replan plan too long for the teams of the set large.
SET_BASELINES, LARGE_BASELINES = ("HCA", "Replan", "PIBT"), ("PIBT",)


def test_set(name: str, candidates: Sequence[Candidate]) -> Study:
    """One of the paper's test sets.

    Args:
        name: one of `TEST_SETS`.
        candidates: what is evaluated.
    """
    pictures = [Picture(f"Test set: {name}", "", draw)]
    if name == "large":
        pictures.append(Picture("Robots that reached their goals", "-arrivals", draw_arrivals))
    return Study(
        name,
        f"Test set: {name}",
        tuple(Point(candidate, cases) for cases in TEST_SETS[name] for candidate in candidates),
        ("map (robots)", "policy", "shield", "cases", "alpha", "delta_FT", "p_rg"),
        row,
        tuple(pictures),
    )


def full_test_set(name: str, policies: Mapping[str, Path]) -> Study:
    """One of the paper's test sets, of ``policies`` under each shield, and of the baselines."""
    baselines = LARGE_BASELINES if name == "large" else SET_BASELINES
    settings = [Setting(rules=Rules(shield=shield)) for shield in SHIELDS]
    return test_set(
        name,
        [
            *(Candidate.of_policy(folder, one, policy) for policy, folder in policies.items() for one in settings),
            *map(Candidate.of_baseline, baselines),
        ],
    )


for _name in TEST_SETS:
    register(_name)(partial(full_test_set, _name))


def row(report: Report) -> tuple[str, ...]:
    """The row of a report."""
    return (report.set_name, report.policy, report.shield, str(report.cases), *measure_cells(report))


def draw(reports: Sequence[Report], path: Path) -> None:
    """Draw alpha, delta_FT and p_rg by map into a PNG file, a picture a shield."""
    names = list(dict.fromkeys(report.set_name for report in reports))
    policies = list(dict.fromkeys(report.policy for report in reports))

    def place(report: Report) -> float:
        """Policies side by side: their intervals must not cover each other."""
        return names.index(report.set_name) + 0.5 * ((policies.index(report.policy) + 0.5) / len(policies) - 0.5)

    across = Across("map (robots)", place, names=names)
    draw_curves(reports, lambda report: f"{report.shield} shield", across, [ALPHA, DELTA_FT, P_RG], path)
