"""Studies of the policies: which points are measured for the page of results, and how they are shown there."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from magat_evaluation.baselines import BASELINES
from magat_evaluation.evaluate import DEFAULT_SETTING, Setting, set_name
from magat_evaluation.measures_file import Report, measure_cells
from magat_evaluation.points import Point
from magat_evaluation.sets import TEST_SETS, StandardSet
from magat_evaluation.studies.curves import ALPHA, DELTA_FT, P_RG, Across, draw_arrivals, draw_curves
from magat_robot.policy.config import ENCODINGS
from magat_sim.shield import SHIELDS
from magat_sim.simulator import Rules

#: Shares of the radio links that are lost.
LOSSES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
#: What curves are measured on.
CURVE_SETS = (StandardSet(20, 10, 400), StandardSet(50, 60, 200))


@dataclass(frozen=True)
class Picture:
    """A picture of a study's reports."""

    title: str
    #: What its file's name adds to that of the study.
    suffix: str
    #: Draws the reports into a PNG file.
    draw: Callable[[Sequence[Report], Path], None]


@dataclass(frozen=True)
class Study:
    """Some points, and how they are shown."""

    #: Of its files: ``[name].csv``, and ``[name][suffix].png`` of each picture.
    name: str
    title: str
    #: What was measured, and on what.
    text: str
    points: tuple[Point, ...]
    #: Heading and rows, in Markdown, of the points' reports.
    rows: Callable[[Sequence[Report]], list[tuple[str, ...]]]
    pictures: tuple[Picture, ...] = ()


def with_cases(study: Study, most: int) -> Study:
    """``study`` on at most ``most`` cases of each set."""
    few = [replace(point, cases=replace(point.cases, cases=min(point.cases.cases, most))) for point in study.points]
    return replace(study, points=tuple(few))


_MEASURES = ("cases", "alpha", "delta_FT", "p_rg")


# --- Lost links ---


def link_loss(policies: Mapping[str, Path]) -> Study:
    """Success and flowtime where links are lost."""
    return Study(
        "link_loss",
        "Lost links",
        "In each tick a share of the directed radio links is lost: the receiver does not hear that sender in that "
        "tick, and does not wait for it. Where all are lost, nobody hears anybody. No policy was trained with losses.",
        tuple(
            Point(name, folder, Setting(rules=Rules(loss)), which)
            for which in CURVE_SETS
            for name, folder in policies.items()
            for loss in (*LOSSES, 1.0)
        ),
        _loss_rows,
        (Picture("Lost links", "", _draw_losses),),
    )


def _loss_rows(reports: Sequence[Report]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("map (robots)", "policy", "lost", *_MEASURES)]
    for report in reports:
        named = (set_name(report), report["policy"], f"{report['link_loss']:g}", str(report["cases"]))
        rows.append((*named, *measure_cells(report)))
    return rows


def _draw_losses(reports: Sequence[Report], path: Path) -> None:
    shown = [report for report in reports if report["link_loss"] <= max(LOSSES)]
    across = Across("share of the radio links that are lost", lambda report: report["link_loss"])
    draw_curves(shown, _set_and_cases, across, [ALPHA, DELTA_FT], path)


def _set_and_cases(report: Report) -> str:
    return f"{set_name(report)}, {report['cases']} cases"


# --- Encodings ---


def encodings(policies: Mapping[str, Path]) -> Study:
    """Success against the bytes that a robot sends."""
    return Study(
        "encodings",
        "Encodings of messages",
        "What a robot sends in a step, headers included, and what comes of it. float16 holds every number of a message "
        "exactly (see [protocol.md](protocol.md)), and so gives the paths of float32.",
        tuple(
            Point(name, folder, Setting(encoding=encoding), which)
            for which in CURVE_SETS
            for name, folder in policies.items()
            for encoding in ENCODINGS
        ),
        _encoding_rows,
        (Picture("Encodings of messages", "", _draw_encodings),),
    )


def _encoding_rows(reports: Sequence[Report]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("map (robots)", "policy", "encoding", "bytes a step", *_MEASURES)]
    for report in reports:
        sent = str(report["bytes_per_step"])
        named = (set_name(report), report["policy"], report["encoding"], sent, str(report["cases"]))
        rows.append((*named, *measure_cells(report)))
    return rows


def _draw_encodings(reports: Sequence[Report], path: Path) -> None:
    across = Across("bytes that a robot sends in a step", lambda report: report["bytes_per_step"], log=True)
    draw_curves(reports, _set_and_cases, across, [ALPHA, DELTA_FT], path)


# --- The paper's test sets ---


def test_set(name: str, policies: Mapping[str, Path], settings: Sequence[Setting], baselines: Sequence[str]) -> Study:
    """One of the paper's test sets.

    Args:
        name: one of `TEST_SETS`.
        policies: folder of each, by its name.
        settings: in which each policy is run.
        baselines: of `BASELINES`.
    """
    planners = [
        *((policy, folder, setting) for policy, folder in policies.items() for setting in settings),
        *((baseline, None, DEFAULT_SETTING) for baseline in baselines),
    ]
    pictures = [Picture(f"Test set: {name}", "", _draw_set)]
    if name == "large":
        pictures.append(Picture("Robots that reached their goals", "-arrivals", draw_arrivals))
    return Study(
        name,
        f"Test set: {name}",
        _SET_TEXTS[name],
        tuple(Point(*planner, which) for which in TEST_SETS[name] for planner in planners),
        _set_rows,
        tuple(pictures),
    )


_SET_TEXTS = {
    "same-density": "Maps grow with the team.",
    "increasing-density": "More and more robots on one map.",
    "large": "Large maps and teams, against an expert of w = 5.",
}


def _set_rows(reports: Sequence[Report]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("map (robots)", "policy", "shield", *_MEASURES)]
    for report in reports:
        named = (set_name(report), report["policy"], report["shield"], str(report["cases"]))
        rows.append((*named, *measure_cells(report)))
    return rows


def _draw_set(reports: Sequence[Report], path: Path) -> None:
    names = list(dict.fromkeys(map(set_name, reports)))
    policies = list(dict.fromkeys(report["policy"] for report in reports))

    def place(report: Report) -> float:
        """Policies side by side, or their intervals would hide one another."""
        return names.index(set_name(report)) + 0.5 * ((policies.index(report["policy"]) + 0.5) / len(policies) - 0.5)

    across = Across("map (robots)", place, names=names)
    draw_curves(reports, lambda report: f"{report['shield']} shield", across, [ALPHA, DELTA_FT, P_RG], path)


_SHIELDED = [Setting(rules=Rules(shield=shield)) for shield in SHIELDS]


def _same_density(policies: Mapping[str, Path]) -> Study:
    return test_set("same-density", policies, _SHIELDED, list(BASELINES))


def _increasing_density(policies: Mapping[str, Path]) -> Study:
    return test_set("increasing-density", policies, _SHIELDED, list(BASELINES))


def _large(policies: Mapping[str, Path]) -> Study:
    return test_set("large", policies, _SHIELDED, ["PIBT"])  # the others plan too long for such teams


#: What is on the page, in its order, by name.
STUDIES: Mapping[str, Callable[[Mapping[str, Path]], Study]] = {
    "link_loss": link_loss,
    "encodings": encodings,
    "same-density": _same_density,
    "increasing-density": _increasing_density,
    "large": _large,
}
