"""The paper's numbers, and those of the same cases here, side by side."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from magat_evaluation.evaluate import set_name
from magat_evaluation.measures_file import Report, markdown_table, measure_cells
from magat_evaluation.sets import TEST_SETS
from magat_sim.shield import SHIELDS


@dataclass(frozen=True)
class _Measure:
    """One that is compared."""

    name: str
    #: Of a report's `measure_cells`, which one.
    cell: int
    #: Which of many reports is told, as it is the worst.
    worst: Callable[[Sequence[Report]], Report]


_ALPHA = _Measure("alpha", 0, lambda reports: min(reports, key=lambda report: report["alpha"]))
_DELTA_FT = _Measure("delta_FT", 1, lambda reports: max(reports, key=lambda report: report["delta_ft"]))
_P_RG = _Measure("p_rg", 2, lambda reports: min(reports, key=lambda report: report["p_rg"]))


@dataclass(frozen=True)
class _Claim:
    """What the paper says of some policies (or baselines) on some maps."""

    measure: _Measure
    #: What the maps are called together; each, as of `set_name`.
    where: str
    maps: tuple[str, ...]
    #: For each of the policies, what the paper has.
    paper: dict[str, str]


def _maps(name: str, most: int = 10**9) -> tuple[str, ...]:
    """The maps of one of `TEST_SETS`, those with at most so many robots."""
    return tuple(set_name(which.size) for which in TEST_SETS[name] if which.robots <= most)


def _one(measure: _Measure, where: str, paper: dict[str, str]) -> _Claim:
    return _Claim(measure, where, (where,), paper)


_POLICIES = ("MAGAT-F-128", "GNN-F-128", "MAGAT-F-32-P4", "MAGAT-B-32-P4")
_P4 = _POLICIES[2:]
_MAGAT = ("MAGAT-F-128", *_P4)
_DENSITIES = tuple(dict.fromkeys((*_maps("same-density"), *_maps("increasing-density"))))
_SIXTY = "50x50, 10 to 60 robots"
#: At least this alpha with at most this delta_FT where the density is the paper's or another; on large maps this alpha.
AIM_ALPHA, AIM_DELTA_FT, AIM_ALPHA_LARGE = 0.99, 0.08, 0.95
#: From its results; of the policies that are in ``models/``.
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


def beside_paper(reports: Sequence[Report]) -> list[str]:
    """The paragraphs of a chapter, in Markdown; none if nothing can be compared.

    Args:
        reports: of those sets, in any order; some may be there twice.
    """
    rows = [row for claim in _CLAIMS for policy in claim.paper if (row := _claim_row(claim, policy, reports))]
    aims = [row for policy in _POLICIES for shield in SHIELDS if (row := _aim_row(policy, shield, reports))]
    if not rows:
        return []
    heading = ("measure", "maps (robots)", "policy", "the paper", *(f"{shield} shield" for shield in SHIELDS))
    chapter = ["## Beside the paper", _CLAIMS_TEXT, markdown_table(heading, rows)]
    if aims:
        heading = ("policy", "T", "shield", "lowest alpha", "highest delta_FT", "lowest alpha, large", "aim")
        chapter += [_AIMS_TEXT, markdown_table(heading, aims), _POCKETS_TEXT]
    return chapter


_CLAIMS_TEXT = """The paper's numbers, and those of the policies here, from the tables of the test sets below, where the
numbers of cases are. Of several maps the worst is told. The paper's shield is like `idle`. Where a cell is empty, not
all of its maps were measured. The policies of the paper that are not in `models/` have no row: MAGAT-F and GNN-F with
64, 32 and 16 features, MAGAT-B-16, GNN-B-64, GAT-F-128 and GNN_baseline-F-128. GNN-F-128, which weighs nothing that it
hears, does as well here as those that attend, unlike in the paper. HCA and Replan are implementations of our own, and
do better than the paper's did. Times: the paper takes 279.9 s a case for 100x100 (500), 510.1 s for 200x200 (500) and
1286.8 s for 200x200 (1000); what it takes here is in [architecture.md](architecture.md)."""
_AIMS_TEXT = f"""What is aimed at is, at one temperature, alpha of at least {AIM_ALPHA:g} with delta_FT of at most
{AIM_DELTA_FT:g} on each map of the sets same-density and increasing-density, and alpha of at least {AIM_ALPHA_LARGE:g}
on the large ones:"""
_POCKETS_TEXT = """What the shields idle and pibt leave behind are mostly robots that nobody hinders. A policy that
sees 9x9 cells and remembers nothing goes to and fro where the way to its goal leads away from it first, until the
episode ends, and no priority helps who is in nobody's way. Robot 30 below is one of them: all others have arrived, and
no move is blocked any more. `pibt-memory` ([protocol.md](protocol.md)) ranks ways back to where a robot has been behind
the others.

![A robot goes to and fro before its goal](pocket.png)

It is of `magat run --policy MAGAT-B-32-P4 --shield pibt --width 50 --height 50 --robots 60 --crew 20 --first 25549
--episodes 1 --record` and `magat plot BAG --tick 239 --robot robot_30`, and the same case fails in the tables below."""


def _claim_row(claim: _Claim, policy: str, reports: Sequence[Report]) -> tuple[str, ...] | None:
    cells = [_worst(claim.measure, claim.maps, policy, shield, reports) for shield in SHIELDS]
    return (claim.measure.name, claim.where, policy, claim.paper[policy], *cells) if any(cells) else None


def _aim_row(policy: str, shield: str, reports: Sequence[Report]) -> tuple[str, ...] | None:
    asked = (
        (_ALPHA, _DENSITIES, lambda report: report["alpha"] >= AIM_ALPHA),
        (_DELTA_FT, _DENSITIES, lambda report: report["delta_ft"] <= AIM_DELTA_FT),
        (_ALPHA, _maps("large"), lambda report: report["alpha"] >= AIM_ALPHA_LARGE),
    )
    found = _of(policy, shield, reports)
    cells = [_worst(measure, maps, policy, shield, reports) for measure, maps, _ in asked]
    if not any(cells):
        return None
    missed = any(not reaches(found[name]) for _, maps, reaches in asked for name in maps if name in found)
    aim = "missed" if missed else "reached" if all(cells) else ""
    at = next(report["temperature"] for report in found.values())
    return (policy, f"{at:g}", shield, *cells, aim)


def _of(policy: str, shield: str, reports: Sequence[Report]) -> dict[str, Report]:
    """Its reports, by map."""
    return {set_name(r): r for r in reports if (r["policy"], r["shield"]) == (policy, shield)}


def _worst(measure: _Measure, maps: Sequence[str], policy: str, shield: str, reports: Sequence[Report]) -> str:
    """The worst of ``maps``, and where it is; "" if not all of them were measured."""
    found = _of(policy, shield, reports)
    if not found.keys() >= set(maps):
        return ""
    report = measure.worst([found[name] for name in maps])
    cell = measure_cells(report)[measure.cell]
    return cell if len(maps) == 1 else f"{cell}, {set_name(report)}"
