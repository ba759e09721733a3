"""``magat results``: studies of the policies, measured, drawn and written to one page.

A study is a list of points, each a policy in a setting on a set of cases. What was measured is kept in a file beside
the page, one row a point, and a point that is there is not measured again, as long as the weights are the same.
"""

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from magat_bringup.evaluation import DEFAULT_SETTING, Setting, evaluate_baseline, evaluate_policy, set_name
from magat_bringup.frontier import DASHES, MARKERS, write_csv
from magat_bringup.measured import Report, half_width, measure_cells
from magat_bringup.record import INK, robot_colour, tint
from magat_bringup.sets import TEST_SETS, StandardSet
from magat_node import cdr
from magat_robot.policy.config import ENCODINGS
from magat_robot.policy.folder import read_folder
from magat_robot.policy.payload import encoded_bytes
from magat_sim.shield import SHIELDS
from magat_sim.simulator import Rules
from magat_training.baselines import BASELINES
from magat_training.cases import SET_SEED, SPLITS

PAGE = "results.md"
#: Shares of the radio links that are lost.
LOSSES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)

#: What curves are measured on.
CURVE_SETS = (StandardSet(20, 10, 400), StandardSet(50, 60, 200))
#: What the paper says of alpha, by policy and set.
PAPER: Mapping[tuple[str, str], str] = {
    **{
        (f"{kind}-F-{features}", "65x65 (100)"): f"{alpha:.2f}"
        for kind, alphas in (("MAGAT", (0.91, 0.85, 0.81, 0.78)), ("GNN", (0.83, 0.78, 0.82, 0.77)))
        for features, alpha in zip((128, 64, 32, 16), alphas, strict=True)
    },
    ("MAGAT-F-32-P4", "50x50 (100)"): "0.95",
    ("MAGAT-B-32-P4", "50x50 (100)"): "0.95",
    ("MAGAT-B-32-P4", "200x200 (1000)"): "> 0.80",
}

# Columns that are texts; all others are numbers.
_TEXTS = ("policy", "encoding", "shield", "digest")
# What makes two points the same one.
_IDENTITY = (
    *("policy", "digest", "temperature", "encoding", "link_loss", "shield"),
    *("width", "height", "robots", "density", "seed", "first_case", "cases_asked"),
)


@dataclass(frozen=True)
class Point:
    """One evaluation."""

    #: Name of the policy, which names it in tables and pictures, too; or one of `BASELINES`.
    policy: str
    #: Of the policy; None for a baseline.
    folder: Path | None
    #: How a policy is run.
    setting: Setting
    #: The first cases of the test split.
    cases: StandardSet

    def identity(self) -> tuple[Any, ...]:
        """What it has in common with every row of the same point, see `_identity`."""
        known = {
            "policy": self.policy,
            "link_loss": self.setting.rules.link_loss,
            **self._carried(),
            **self.cases.size,
            "seed": SET_SEED,
            "first_case": SPLITS["test"].start,
            "cases_asked": self.cases.cases,
        }
        return tuple(known[name] for name in _IDENTITY)

    def _carried(self) -> dict[str, Any]:
        if self.folder is None:
            return {"digest": "", "temperature": 0.0, "encoding": "", "shield": BASELINES[self.policy][1]}
        config, digest, _ = read_folder(self.folder)
        temperature, encoding = self.setting.temperature, self.setting.encoding
        return {
            "digest": digest,
            "temperature": config.temperature if temperature is None else temperature,
            "encoding": encoding or config.encoding,
            "shield": self.setting.rules.shield,
        }

    def measure(self, console: Console, workers: int) -> Report:
        """Its report, as of `evaluation.evaluate_policy`."""
        numbers, size = SPLITS["test"][: self.cases.cases], self.cases.size
        if self.folder is None:
            return evaluate_baseline(self.policy, numbers, SET_SEED, size, console, workers)
        report = evaluate_policy(self.folder, numbers, SET_SEED, self.setting, size, console, workers)
        return report | {"policy": self.policy}


@dataclass(frozen=True)
class Study:
    """Some points, and how they are shown."""

    #: Of its files: ``[name].csv`` and, where it has a picture, ``[name].png``.
    name: str
    title: str
    #: What was measured, and on what.
    text: str
    points: tuple[Point, ...]
    #: Heading and rows, in Markdown, of the points' reports.
    rows: Callable[[Sequence[Report]], list[tuple[str, ...]]]
    #: Draws the reports into a file, if there is a picture.
    draw: Callable[[Sequence[Report], Path], None] | None = None


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
        _draw_losses,
    )


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
        lambda reports: _encoding_rows(policies, reports),
        lambda reports, path: _draw_encodings(policies, reports, path),
    )


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
    return Study(
        name,
        f"Test set: {name}",
        _SET_TEXTS[name],
        tuple(Point(*planner, which) for which in TEST_SETS[name] for planner in planners),
        _set_rows,
    )


_SET_TEXTS = {
    "same-density": "Maps grow with the team. The paper: delta_FT of MAGAT-F-32-P4 and MAGAT-B-32-P4 is below 0.065.",
    "increasing-density": "More and more robots on one map. The paper: most MAGAT policies have alpha above 0.92 and "
    "delta_FT below 0.10 with 10 to 60 robots; HCA drops from 40 robots on.",
    "large": "Large maps and teams, against an expert of w = 5. The paper: p_rg is at least 0.986 everywhere, and at "
    "least 0.996 for MAGAT on 100x100 (500).",
}


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


def with_cases(study: Study, most: int) -> Study:
    """``study`` on at most ``most`` cases of each set."""
    few = [replace(point, cases=replace(point.cases, cases=min(point.cases.cases, most))) for point in study.points]
    return replace(study, points=tuple(few))


def results(studies: Sequence[Study], wanted: Sequence[str], output: Path, console: Console, workers: int = 1) -> Path:
    """Measure what is missing, and write the page.

    Args:
        studies: in the order of the page.
        wanted: names of those to be measured; of the others, the page has what was measured before.
        output: folder for the page, pictures and files.
        console: shows the progress.
        workers: processes.

    Returns:
        The page.

    Raises:
        InvalidCaseError: a set has no cases that can be drawn and solved.
        ModelError: a policy cannot be used.
    """
    output.mkdir(parents=True, exist_ok=True)
    parts = [_HEAD]
    files = [output / f"{study.name}.csv" for study in studies]
    for study, path in zip(studies, files, strict=True):
        reports = measured(study, path, console, workers, files) if study.name in wanted else read_csv(path)
        if not reports:
            continue
        _write(reports, path)  # without what is not of the study any more
        parts += [f"## {study.title}", study.text]
        if study.draw is not None:
            study.draw(reports, output / f"{study.name}.png")
            parts.append(f"![{study.title}]({study.name}.png)")
        heading, *rows = study.rows(reports)
        lines = [heading, ("---",) * len(heading), *rows]
        parts.append("\n".join(f"| {' | '.join(line)} |" for line in lines))
        parts.append(f"All measures, with the digests of the weights: [{study.name}.csv]({study.name}.csv).")
    page = output / PAGE
    page.write_text("\n\n".join(parts) + "\n")
    return page


_HEAD = """# Results

This page, its pictures and its tables are written by `make results` (`magat results`), which measures what is not yet
in the files beside them, or was of other weights. Cases are the first of the test split (seed 2021, from number
25500), which no policy was trained or chosen on; the shield is idle where nothing else is said, and each policy samples
at its own temperature. Intervals are of 95 % (Wilson for rates). For one point alone there is `magat evaluate`."""


def measured(study: Study, path: Path, console: Console, workers: int = 1, others: Sequence[Path] = ()) -> list[Report]:
    """The reports of the study's points, in order, out of ``path`` or ``others`` or measured; then in ``path``, too."""
    path.parent.mkdir(parents=True, exist_ok=True)
    known = {_identity(row): row for row in read_csv(path)}
    elsewhere = {_identity(row): row for other in others for row in read_csv(other)}
    identities = [point.identity() for point in study.points]
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_interactive) as progress:
        task = progress.add_task(study.title, total=len(study.points))
        for point, identity in zip(study.points, identities, strict=True):
            if identity not in known:
                what = f"{study.title}: {escape(point.policy)}, {set_name(point.cases.size)}"
                progress.update(task, description=what)
                known[identity] = elsewhere.get(identity) or point.measure(console, workers)
                _write(list(known.values()), path)  # at once: it may be interrupted before the next one
            progress.advance(task)
    kept = {_identity(row): row for row in read_csv(path)}
    return [kept[identity] for identity in identities]


def read_csv(path: Path) -> list[Report]:
    """The rows that `frontier.write_csv` wrote; none if there is no such file."""
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    reports = []
    for row in rows:
        report: Report = {name: value if name in _TEXTS else _number(value) for name, value in row.items()}
        reports.append(report | {"alpha_interval": (report.pop("alpha_low"), report.pop("alpha_high"))})
    return reports


def _number(text: str) -> float:
    return int(text) if text.isdigit() else float(text)


def _write(reports: Sequence[Report], path: Path) -> None:
    draft = path.with_suffix(".draft")
    policies = dict.fromkeys(report["policy"] for report in reports)
    write_csv({name: [report for report in reports if report["policy"] == name] for name in policies}, draft)
    draft.replace(path)


def _identity(report: Report) -> tuple[Any, ...]:
    known = report | {"cases_asked": report["cases"] + report["unsolved_by_expert"]}
    return tuple(known[name] for name in _IDENTITY)


def table(study: Study, reports: Sequence[Report]) -> Table:
    """The reports of ``study``, of as many of its points as there are, for people."""
    heading, *rows = study.rows(reports)
    result = Table(title=study.title, title_justify="left", box=None, pad_edge=False)
    for name in heading:
        result.add_column(name)
    for row in rows:
        result.add_row(*map(escape, row))
    return result


def bytes_per_step(folder: Path, encoding: str) -> int:
    """Bytes of the feature messages that a robot with the policy in ``folder`` sends in a step, all rounds together."""
    config, _, _ = read_folder(folder)
    return cdr.feature_bytes(encoded_bytes(size, encoding) for size in config.message_sizes)


# --- Tables and pictures ---


_MEASURES = ("cases", "alpha", "delta_FT", "p_rg")


def _loss_rows(reports: Sequence[Report]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("map (robots)", "policy", "lost", *_MEASURES)]
    for report in reports:
        named = (set_name(report), report["policy"], f"{report['link_loss']:g}", str(report["cases"]))
        rows.append((*named, *measure_cells(report)))
    return rows


def _encoding_rows(policies: Mapping[str, Path], reports: Sequence[Report]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("map (robots)", "policy", "encoding", "bytes a step", *_MEASURES)]
    for report in reports:
        size = bytes_per_step(policies[report["policy"]], report["encoding"])
        named = (set_name(report), report["policy"], report["encoding"], str(size), str(report["cases"]))
        rows.append((*named, *measure_cells(report)))
    return rows


def _set_rows(reports: Sequence[Report]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("map (robots)", "policy", "shield", *_MEASURES, "alpha in the paper")]
    for report in reports:
        named = (set_name(report), report["policy"], report["shield"], str(report["cases"]))
        paper = PAPER.get((report["policy"], set_name(report)), "") if report["shield"] == "idle" else ""
        rows.append((*named, *measure_cells(report), paper))
    return rows


def _draw_losses(reports: Sequence[Report], path: Path) -> None:
    shown = [report for report in reports if report["link_loss"] <= max(LOSSES)]
    _draw(shown, lambda report: report["link_loss"], "share of the radio links that are lost", path)


def _draw_encodings(policies: Mapping[str, Path], reports: Sequence[Report], path: Path) -> None:
    def sent(report: Report) -> float:
        return bytes_per_step(policies[report["policy"]], report["encoding"])

    _draw(reports, sent, "bytes that a robot sends in a step", path)


def _draw(reports: Sequence[Report], across: Callable[[Report], float], label: str, path: Path) -> None:
    """Alpha and delta_FT over ``across``, called ``label``: a column of pictures a set, a line a policy."""
    sets = list(dict.fromkeys(map(set_name, reports)))
    policies = list(dict.fromkeys(report["policy"] for report in reports))
    figure = Figure(figsize=(4.6 * len(sets), 6.4), facecolor="white", layout="constrained")
    grid = figure.subplots(2, len(sets), sharex=True, sharey="row", squeeze=False)
    for column, name in enumerate(sets):
        success, flowtime = grid[:, column]
        for number, policy in enumerate(policies):
            points = sorted((r for r in reports if (set_name(r), r["policy"]) == (name, policy)), key=across)
            where, alpha = [across(r) for r in points], [r["alpha"] for r in points]
            ends = [r["alpha_interval"] for r in points]
            errors = [[max(0.0, a - low) for a, (low, _) in zip(alpha, ends, strict=True)],
                      [max(0.0, high - a) for a, (_, high) in zip(alpha, ends, strict=True)]]  # fmt: skip
            _line(success, number, policy, where, alpha, errors)
            half = [half_width(r) for r in points]
            _line(flowtime, number, policy, where, [r["delta_ft"] for r in points], [half, half])
        first = next(report for report in reports if set_name(report) == name)
        success.set_title(f"{name}, {first['cases']} cases", loc="left", fontsize=10)
        flowtime.set_xlabel(label)
    grid[0, 0].set_ylabel(r"$\alpha$")
    grid[1, 0].set_ylabel(r"$\delta_{FT}$")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    figure.savefig(path, format="png", dpi=120)


def _line(
    axes: Axes, number: int, name: str, where: list[float], values: list[float], errors: list[list[float]]
) -> None:
    colour = robot_colour(number)
    axes.errorbar(
        where, values, yerr=errors, color=colour, ecolor=tint(colour, 0.45), elinewidth=0.9, capsize=2.0, linewidth=1.4,
        markersize=6.0, linestyle=DASHES[number % len(DASHES)], marker=MARKERS[number % len(MARKERS)],
        label=name.replace("$", r"\$"),
    )  # fmt: skip
    axes.grid(color=tint(INK, 0.1), linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
