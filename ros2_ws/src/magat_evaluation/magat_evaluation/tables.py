# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables of reports, in Markdown and for the terminal."""

import itertools
from collections.abc import Iterable, Sequence

from rich.markup import escape
from rich.table import Table

from magat_evaluation.report import Report

#: Hexadecimal digits of a digest that tables show.
DIGITS = 12


#: Headings of `measure_cells`; delta_FT is by first visit and by last arrival.
MEASURES = ("alpha", "delta_FT, first", "delta_FT, last", "makespan", "p_rg")


def measure_cells(report: Report) -> tuple[str, ...]:
    """The cells of `MEASURES`; alpha and the first delta_FT have their 95 % intervals."""
    low, high = report.alpha_interval
    return (
        f"{report.alpha:.3f} ({low:.3f} to {high:.3f})",
        f"{report.delta_ft:.3f} ± {report.delta_ft_error:.3f}",
        f"{report.delta_ft_strict:.3f}",
        "" if report.makespan is None else f"{report.makespan:.1f}",
        f"{report.p_rg:.4f}",
    )


def markdown_table(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """``rows`` under ``heading``, without a line break at the end."""
    return "\n".join(f"| {' | '.join(line)} |" for line in (heading, ["---"] * len(heading), *rows))


def markdown(reports: Iterable[Report], digest: str) -> str:
    """``reports`` on a policy whose weights have the SHA-256 ``digest``, as a table in Markdown.

    A stale report has a row that says so instead of its measures.
    """
    heading = ("set", "cases", "T", *MEASURES, "alpha, strict")
    rows: list[tuple[str, ...]] = []
    for report in reports:
        stale = report.stale(digest)
        cells = (*measure_cells(report), f"{report.alpha_strict:.3f}")
        measures = (_stale_note(report), *[""] * len(MEASURES)) if stale else cells
        rows.append((report.set_name, str(report.cases), f"{report.temperature:g}", *measures))
    return markdown_table(heading, rows)


def table(entries: Iterable[tuple[str, str, Report]]) -> Table:
    """Reports for the terminal, grouped by set.

    Args:
        entries: name of the policy, digest of its weights, and a report.
    """
    result = Table(box=None, pad_edge=False)
    for heading in ("", "cases", "T", *MEASURES):
        result.add_column(heading, justify="right" if heading else "left", overflow="fold")
    for _, group in itertools.groupby(sorted(entries, key=_set), key=_set):
        for place, (name, digest, report) in enumerate(group):
            if place == 0:
                result.add_row(f"[bold]{report.set_name}[/]")
            measures = (f"[red]{_stale_note(report)}[/]",) if report.stale(digest) else measure_cells(report)
            result.add_row(f"  {escape(name)}", str(report.cases), f"{report.temperature:g}", *measures)
    return result


def _set(entry: tuple[str, str, Report]) -> tuple[float, ...]:
    report = entry[2]
    size = (report.width, report.height, report.robots, report.density, report.expert_w)
    return (*size, report.seed, report.first_case)


def _stale_note(report: Report) -> str:
    return f"stale, of {report.digest[:DIGITS]}"
