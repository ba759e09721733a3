"""The page of results: measures the studies, draws their pictures, and fills in the page's template."""

import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from string import Template

from rich.console import Console

from magat_evaluation.paper import AIM_ALPHA, AIM_ALPHA_LARGE, AIM_DELTA_FT, aims_table, claims_table
from magat_evaluation.report import Report
from magat_evaluation.report_files import read_csv
from magat_evaluation.sets import TEST_SETS
from magat_evaluation.splits import SET_SEED, SPLITS
from magat_evaluation.studies.study import Study

PAGE = "results.md"
TEMPLATE = "results_template.md"


class _Page(Template):
    """A text with placeholders such as ``$link_loss`` and ``${same-density}``."""

    idpattern = r"(?a:[_a-z][_a-z0-9-]*)"


def write_results(
    studies: Sequence[Study], names: Sequence[str], output: Path, console: Console, workers: int = 1
) -> Path:
    """Measure what is missing, and write the page with its pictures.

    Args:
        studies: those of the page.
        names: of the studies to measure; of the others, the page shows what was measured before.
        output: folder for the page, pictures and files.
        console: shows the progress.
        workers: processes.

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
        if study.name in names:
            study.measure(output, console, workers, all_files)
        reports = read_csv(study.file(output))
        shown[study.name] = study.markdown(reports) if reports else ""
        if reports:
            study.draw(reports, output)
        if study.name in TEST_SETS:
            of_paper += reports
    page = output / PAGE
    page.write_text(_fill_in(files("magat_evaluation").joinpath(TEMPLATE).read_text(), studies, shown, of_paper))
    return page


def _fill_in(template: str, studies: Sequence[Study], shown: dict[str, str], of_paper: Sequence[Report]) -> str:
    """The page: sections of ``template`` that have something to show, then those of studies that it does not have."""
    values = {
        "seed": str(SET_SEED),
        "first_case": str(SPLITS["test"].start),
        "aim_alpha": f"{AIM_ALPHA:g}",
        "aim_delta_ft": f"{AIM_DELTA_FT:g}",
        "aim_alpha_large": f"{AIM_ALPHA_LARGE:g}",
        "claims": claims_table(of_paper),
        "aims": aims_table(of_paper),
        **shown,
    }
    sections = []
    for section in re.split(r"^(?=#)", template, flags=re.MULTILINE)[1:]:
        names = _Page(section).get_identifiers()
        if all(values.get(name) for name in names):
            sections.append(_Page(section).substitute(values).strip())
    described = _Page(template).get_identifiers()
    sections += [f"## {study.title}\n\n{shown[study.name]}" for study in studies
                 if study.name not in described and shown[study.name]]  # fmt: skip
    return "\n\n".join(sections) + "\n"
