"""``magat results``: studies of the policies, measured, drawn and written to one page."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from magat_evaluation.measures_file import Report, markdown_table
from magat_evaluation.paper import beside_paper
from magat_evaluation.points import measured, read_csv, write_csv
from magat_evaluation.sets import TEST_SETS
from magat_evaluation.studies.studies import Study

PAGE = "results.md"


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
    parts, of_paper = [], []
    files = [output / f"{study.name}.csv" for study in studies]
    for study, path in zip(studies, files, strict=True):
        if study.name in wanted:
            reports = measured(study.points, path, console, workers, study.title, files)
        else:
            reports = read_csv(path)
        if not reports:
            continue
        write_csv(reports, path)  # without what is not of the study any more
        parts += [f"## {study.title}", study.text]
        for picture in study.pictures:
            name = f"{study.name}{picture.suffix}.png"
            picture.draw(reports, output / name)
            parts.append(f"![{picture.title}]({name})")
        heading, *rows = study.rows(reports)
        parts.append(markdown_table(heading, rows))
        if study.name in TEST_SETS:
            of_paper += reports
        parts.append(f"All measures, with the digests of the weights: [{study.name}.csv]({study.name}.csv).")
    page = output / PAGE
    page.write_text("\n\n".join([_HEAD, *beside_paper(of_paper), *parts]) + "\n")
    return page


_HEAD = """# Results

This page, its pictures and its tables are written by `make results` (`magat results`), which measures what is not yet
in the files beside them, or was of other weights. Cases are the first of the test split (seed 2021, from number
25500), which no policy was trained or chosen on (but the two numbers of the shield pibt-memory were, on cases 25506 and
25526 of 50x50 with 100 robots); the shield is idle where nothing else is said, and each policy samples
at its own temperature. Intervals are of 95 % (Wilson for rates). For one point alone there is `magat evaluate`.

A study is measured by `magat results --study NAME --policy NAMES`, those of the test sets here with `--cases 200`: the
sets have more, and `make results` alone would measure all of them, of all policies."""


def table(study: Study, reports: Sequence[Report]) -> Table:
    """The reports of ``study``, of as many of its points as there are, for people."""
    heading, *rows = study.rows(reports)
    result = Table(title=study.title, title_justify="left", box=None, pad_edge=False)
    for name in heading:
        result.add_column(name)
    for row in rows:
        result.add_row(*map(escape, row))
    return result
