"""Comparison with the paper: its numbers beside those measured here, and the aims."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from magat_evaluation.report import Report
from magat_evaluation.sets import TEST_SETS
from magat_evaluation.tables import markdown_table, measure_cells
from magat_sim.shield import SHIELDS


@dataclass(frozen=True)
class _Measure:
    """A measure that is compared."""

    name: str
    #: Its index in `measure_cells`.
    cell: int
    #: The worst of several reports.
    worst: Callable[[Sequence[Report]], Report]


_ALPHA = _Measure("alpha", 0, lambda reports: min(reports, key=lambda report: report.alpha))
_DELTA_FT = _Measure("delta_FT", 1, lambda reports: max(reports, key=lambda report: report.delta_ft))
_P_RG = _Measure("p_rg", 2, lambda reports: min(reports, key=lambda report: report.p_rg))


@dataclass(frozen=True)
class _Claim:
    """What the paper reports for some policies or baselines on some maps."""

    measure: _Measure
    #: Common name of the maps, and the name of each, see `CaseSet.name`.
    where: str
    maps: tuple[str, ...]
    #: The paper's number for each policy.
    paper: dict[str, str]


def _maps(name: str, most: int = 10**9) -> tuple[str, ...]:
    """The maps of one of `TEST_SETS` with at most ``most`` robots."""
    return tuple(cases.name for cases in TEST_SETS[name] if cases.robots <= most)


def _one(measure: _Measure, where: str, paper: dict[str, str]) -> _Claim:
    return _Claim(measure, where, (where,), paper)


_POLICIES = ("MAGAT-F-128", "GNN-F-128", "MAGAT-F-32-P4", "MAGAT-B-32-P4")
_P4 = _POLICIES[2:]
_MAGAT = ("MAGAT-F-128", *_P4)
_DENSITIES = tuple(dict.fromkeys((*_maps("same-density"), *_maps("increasing-density"))))
_SIXTY = "50x50, 10 to 60 robots"
#: Aims: at least this alpha and at most this delta_FT on same-density and increasing-density; this alpha on large.
AIM_ALPHA, AIM_DELTA_FT, AIM_ALPHA_LARGE = 0.99, 0.08, 0.95
#: The paper's results for the policies in ``models/`` and for the baselines.
_CLAIMS = (
    _one(_ALPHA, "65x65 (100)", {"MAGAT-F-128": "0.91", "GNN-F-128": "0.83"}),
    _Claim(_ALPHA, _SIXTY, _maps("increasing-density", 60), dict.fromkeys(_MAGAT, "above 0.92 (most MAGAT policies)")),
    _Claim(_DELTA_FT, _SIXTY, _maps("increasing-density", 60), dict.fromkeys(_MAGAT, "below 0.10 (most)")),
    _one(_ALPHA, "50x50 (100)", dict.fromkeys(_P4, "0.95")),
    _Claim(_DELTA_FT, "same-density", _maps("same-density"), dict.fromkeys(_P4, "below 0.065")),
    _one(_ALPHA, "200x200 (1000)", {"MAGAT-B-32-P4": "above 0.80"}),
    _Claim(_P_RG, "large", _maps("large"), dict.fromkeys(_POLICIES, "at least 0.986")),
    _one(_P_RG, "100x100 (500)", dict.fromkeys(_MAGAT, "at least 0.996") | {"GNN-F-128": "0.986"}),
    _Claim(_ALPHA, "50x50, 10 to 30 robots", _maps("increasing-density", 30), {"HCA": "good"}),
    _one(_ALPHA, "50x50 (100)", {"HCA": "0 (dropping from 40 robots on)"}),
    _Claim(_ALPHA, "same-density", _maps("same-density"), {"Replan": "generally below the learned policies"}),
    _Claim(_DELTA_FT, "same-density", _maps("same-density"), {"Replan": "above the learned policies"}),
)


def claims_table(reports: Sequence[Report]) -> str:
    """The paper's numbers beside those of ``reports``, in Markdown; "" if nothing can be compared.

    Args:
        reports: of the paper's test sets, in any order; some may occur twice.
    """
    rows = [row for claim in _CLAIMS for policy in claim.paper if (row := _claim_row(claim, policy, reports))]
    heading = ("measure", "maps (robots)", "policy", "the paper", *(f"{shield} shield" for shield in SHIELDS))
    return markdown_table(heading, rows) if rows else ""


def aims_table(reports: Sequence[Report]) -> str:
    """Which policies reach the aims, in Markdown; "" if nothing was measured."""
    rows = [row for policy in _POLICIES for shield in SHIELDS if (row := _aim_row(policy, shield, reports))]
    heading = ("policy", "T", "shield", "lowest alpha", "highest delta_FT", "lowest alpha, large", "aim")
    return markdown_table(heading, rows) if rows else ""


def _claim_row(claim: _Claim, policy: str, reports: Sequence[Report]) -> tuple[str, ...] | None:
    cells = [_worst(claim.measure, claim.maps, policy, shield, reports) for shield in SHIELDS]
    return (claim.measure.name, claim.where, policy, claim.paper[policy], *cells) if any(cells) else None


def _aim_row(policy: str, shield: str, reports: Sequence[Report]) -> tuple[str, ...] | None:
    asked = (
        (_ALPHA, _DENSITIES, lambda report: report.alpha >= AIM_ALPHA),
        (_DELTA_FT, _DENSITIES, lambda report: report.delta_ft <= AIM_DELTA_FT),
        (_ALPHA, _maps("large"), lambda report: report.alpha >= AIM_ALPHA_LARGE),
    )
    found = _of(policy, shield, reports)
    cells = [_worst(measure, maps, policy, shield, reports) for measure, maps, _ in asked]
    if not any(cells):
        return None
    missed = any(not reaches(found[name]) for _, maps, reaches in asked for name in maps if name in found)
    aim = "missed" if missed else "reached" if all(cells) else ""
    at = next(report.temperature for report in found.values())
    return (policy, f"{at:g}", shield, *cells, aim)


def _of(policy: str, shield: str, reports: Sequence[Report]) -> dict[str, Report]:
    """The reports of ``policy`` under ``shield``, by map."""
    return {r.set_name: r for r in reports if (r.policy, r.shield) == (policy, shield)}


def _worst(measure: _Measure, maps: Sequence[str], policy: str, shield: str, reports: Sequence[Report]) -> str:
    """The worst value on ``maps``, and on which map; "" if not all of them were measured."""
    found = _of(policy, shield, reports)
    if not found.keys() >= set(maps):
        return ""
    report = measure.worst([found[name] for name in maps])
    cell = measure_cells(report)[measure.cell]
    return cell if len(maps) == 1 else f"{cell}, {report.set_name}"
