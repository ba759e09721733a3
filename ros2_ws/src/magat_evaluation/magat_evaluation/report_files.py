"""Reports of evaluations in CSV files, a row each."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from magat_evaluation.measures_file import Report

_COLUMNS = (
    *("policy", "temperature", "encoding", "link_loss", "alpha", "alpha_low", "alpha_high"),
    *("delta_ft", "delta_ft_half_width", "p_rg", "alpha_strict", "delta_ft_strict", "cases", "unsolved_by_expert"),
    *("width", "height", "robots", "density", "seed", "first_case", "shield", "digest"),
    *("bytes_per_step", "makespan", "moves_blocked", "stranded"),
)
# Columns that are texts; all others are numbers.
_TEXTS = ("policy", "encoding", "shield", "digest")


# What makes two reports ones of the same thing, besides the number of cases.
_IDENTITY = (
    *("policy", "digest", "temperature", "encoding", "link_loss", "shield"),
    *("width", "height", "robots", "density", "seed", "first_case"),
)


def identity(report: Mapping[str, Any]) -> tuple[Any, ...]:
    """What two reports of the same thing have in common: policy, setting, and the cases that were asked for."""
    return (*(report[name] for name in _IDENTITY), report["cases"] + report.get("unsolved_by_expert", 0))


def write_csv(reports: Sequence[Report], path: Path) -> None:
    """Write one row a report to ``path``, with a heading, those of one policy together.

    alpha's interval has two columns; ``stranded`` is written as in 0:47 2:3, 47 cases by 0 and 3 by 2 robots. The file
    is there as a whole at any time, with or without the reports.
    """
    policies = list(dict.fromkeys(report["policy"] for report in reports))
    draft = path.with_suffix(".draft")
    with draft.open("w", newline="") as file:
        writer = csv.DictWriter(file, _COLUMNS, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        for report in sorted(reports, key=lambda report: policies.index(report["policy"])):
            low, high = report["alpha_interval"]
            stranded = " ".join(f"{robots}:{cases}" for robots, cases in report["stranded"].items())
            writer.writerow({**report, "alpha_low": low, "alpha_high": high, "stranded": stranded})
    draft.replace(path)


def read_csv(path: Path) -> list[Report]:
    """The rows that `write_csv` wrote; none if there is no such file.

    Where a measure was not yet kept when a row was written, it is NaN, and ``stranded`` is empty.
    """
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        return [_report(row) for row in csv.DictReader(file)]


def _report(row: Mapping[str, str]) -> Report:
    numbers = set(_COLUMNS).difference(_TEXTS, ("stranded",))
    report: Report = {name: row[name] for name in _TEXTS} | {name: _number(row.get(name)) for name in numbers}
    report["alpha_interval"] = (report.pop("alpha_low"), report.pop("alpha_high"))
    pairs = (entry.split(":") for entry in (row.get("stranded") or "").split())
    return report | {"stranded": {int(robots): int(cases) for robots, cases in pairs}}


def _number(text: str | None) -> float:
    return int(text) if text and text.isdigit() else float(text or "nan")
