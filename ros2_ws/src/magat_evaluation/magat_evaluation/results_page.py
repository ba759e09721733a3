# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of results: measures the studies, draws their pictures, and fills in the page's template."""

import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from string import Template

from rich.console import Console

from magat_evaluation.executor import Workers
from magat_evaluation.measured import Measured
from magat_evaluation.paper import claims_table, findings, panels_table, verdicts_line
from magat_evaluation.points import Point
from magat_evaluation.policies_table import policies_table
from magat_evaluation.report import Report
from magat_evaluation.report_files import read_csv
from magat_evaluation.sets import TEST_SETS
from magat_evaluation.splits import FIRST_RESULT, SET_SEED
from magat_evaluation.studies.figure import draw_figure
from magat_evaluation.studies.study import Study
from magat_evaluation.summaries import aims_table, best_policy, mute_table, trainings_table
from magat_evaluation.times import TIMES, read_times, times_table

PAGE, FIGURE = "results.md", "figure.png"
TEMPLATE = "results_template.md"


class _Page(Template):
    """A text with placeholders such as ``$link_loss`` and ``${same-density}``."""

    idpattern = r"(?a:[_a-z][_a-z0-9-]*)"


def write_results(
    studies: Sequence[Study],
    policies: Mapping[str, Path],
    asked: Mapping[str, Sequence[Point]],
    output: Path,
    console: Console,
    workers: Workers = 1,
) -> Path:
    """Measure what is missing, and write the page with its pictures.

    Args:
        studies: those of the page, with all policies.
        policies: folder of each, by its name.
        asked: for the studies to measure, by name, their points to measure. Of the others, and of other points, the
            page shows what was measured before and still holds, see `Study.current`.
        output: folder for the page, pictures and files.
        console: shows the progress.
        workers: see `executor`.

    Returns:
        The page.

    Raises:
        InvalidCaseError: a set has no cases that can be drawn and solved.
        ModelError: a policy cannot be used.
        ReportFileError: a file of reports cannot be read.
    """
    output.mkdir(parents=True, exist_ok=True)
    all_files = [study.file(output) for study in studies]
    shown: dict[str, str] = {}
    of_paper: list[Report] = []
    for study in studies:
        if study.name in asked:
            study.measure(output, console, workers, all_files, asked[study.name])
        reports = study.current(read_csv(study.file(output)))
        shown[study.name] = study.markdown(reports) if reports else ""
        if reports:
            study.draw(reports, output)
        if study.name in TEST_SETS:
            of_paper += reports
    shown |= _of_paper(of_paper, policies, output)
    page = output / PAGE
    page.write_text(_fill_in(files("magat_evaluation").joinpath(TEMPLATE).read_text(), studies, shown))
    return page


def _of_paper(reports: Sequence[Report], policies: Mapping[str, Path], output: Path) -> dict[str, str]:
    """What the page says of the paper's test sets as a whole, by placeholder; the figure is drawn."""
    measured = Measured(reports)
    found = findings(measured)
    if reports:
        draw_figure(measured, output / FIGURE)
    return {
        "claims": claims_table(found) if reports else "",
        "verdicts": verdicts_line(found),
        "panels": panels_table(found) if reports else "",
        "aims": aims_table(measured),
        "mute": mute_table(measured),
        "best": best_policy(measured) or "",
        "trainings": trainings_table(measured),
        "policies": policies_table(policies),
        "times": times_table(read_times(output / TIMES)),
    }


def _fill_in(template: str, studies: Sequence[Study], shown: Mapping[str, str]) -> str:
    """The page: sections of ``template`` that have something to show, then those of studies that it does not have."""
    values = {"seed": str(SET_SEED), "first_case": str(FIRST_RESULT), **shown}
    sections = []
    for section in re.split(r"^(?=#)", template, flags=re.MULTILINE)[1:]:
        names = _Page(section).get_identifiers()
        if all(values.get(name) for name in names):
            sections.append(_Page(section).substitute(values).strip())
    described = _Page(template).get_identifiers()
    sections += [f"## {study.title}\n\n{shown[study.name]}" for study in studies
                 if study.name not in described and shown[study.name]]  # fmt: skip
    return "\n\n".join(sections) + "\n"
