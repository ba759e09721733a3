"""``magat measure``: the standard sets, and what was measured on them, kept in a policy's folder as ``measures.json``.

The file holds a list of reports as `evaluation.evaluate_policy` returns them. Each names the weights it was measured of
by their digest: once a folder has other weights, its reports are stale, and are shown as such.
"""

import itertools
import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import track
from rich.table import Table

from magat_evaluation.evaluate import Setting, evaluate_policy, set_name
from magat_evaluation.sets import StandardSet
from magat_evaluation.splits import SET_SEED, SPLITS
from magat_robot.policy.config import ModelError

MEASURES = "measures.json"
#: Hexadecimal digits of a digest that people are shown.
DIGITS = 12

Report = dict[str, Any]


# What makes two reports ones of the same thing, and the order in which they are kept.
_SET = ("width", "height", "robots", "density", "seed", "first_case")
_IDENTITY = (*_SET, "shield", "temperature")
_KINDS: dict[str, tuple[type, ...]] = {
    **dict.fromkeys(("policy", "digest", "shield"), (str,)),
    **dict.fromkeys(("width", "height", "robots", "seed", "first_case", "cases"), (int,)),
    **dict.fromkeys(("temperature", "density", "alpha", "alpha_strict", "delta_ft", "delta_ft_half_width",
                     "delta_ft_strict", "p_rg"), (int, float)),
    **dict.fromkeys(("alpha_interval", "alpha_strict_interval"), (list, tuple)),
}  # fmt: skip


def measure(
    folder: Path, sets: Sequence[StandardSet], console: Console, temperature: float | None = None
) -> list[Report]:
    """Score the policy in ``folder`` on ``sets``, and keep each report as soon as it is there, see `keep`.

    Args:
        folder: of the policy.
        sets: e.g. `STANDARD_SETS`, which take a minute and a half.
        console: shows the progress.
        temperature: for sampling; the policy's own if None.

    Returns:
        The new reports, in the order of ``sets``.

    Raises:
        InvalidCaseError: a set has no cases that can be drawn and solved.
        ModelError: the policy, or its ``measures.json``, cannot be used.
    """
    read(folder)  # a damaged file is better found before the work than after it
    reports = []
    for which in track(sets, "sets", console=console, transient=True):
        numbers = SPLITS["test"][: which.cases]
        reports.append(evaluate_policy(folder, numbers, SET_SEED, Setting(temperature), which.size, console))
        keep(folder, reports[-1])
    return reports


def keep(folder: Path, report: Report) -> None:
    """Add ``report`` to the ``measures.json`` in ``folder``.

    It replaces an older one of the same set, shield and temperature, of whatever weights and however many cases. The
    file is there as a whole at any time, with or without the report.

    Raises:
        ModelError: the file that is there cannot be used.
    """
    others = [old for old in read(folder) if _values(old, _IDENTITY) != _values(report, _IDENTITY)]
    reports = sorted([*others, report], key=lambda kept: _values(kept, _IDENTITY))
    draft = folder / f"{MEASURES}.draft"
    draft.write_text(json.dumps(reports, indent=2) + "\n")
    draft.replace(folder / MEASURES)


def read(folder: Path) -> list[Report]:
    """The reports in the ``measures.json`` in ``folder``, smaller maps first; none if there is no such file.

    Which weights they are of is theirs to say: see `stale`.

    Raises:
        ModelError: the file is damaged.
    """
    file = folder / MEASURES
    advice = "delete it, and run `magat measure` again"
    try:
        reports = json.loads(file.read_text())
    except FileNotFoundError:
        return []
    except (OSError, ValueError) as error:
        raise ModelError(f"{file} cannot be read ({error}): {advice}") from error
    if not isinstance(reports, list) or not all(isinstance(report, dict) for report in reports):
        raise ModelError(f"{file} is damaged, it holds no list of reports: {advice}")
    for number, report in enumerate(reports, 1):
        for name, kinds in _KINDS.items():
            if type(report.get(name)) not in kinds or (list in kinds and not _is_interval(report[name])):
                raise ModelError(f"{file} is damaged, {name} of report {number} is {report.get(name)!r}: {advice}")
    return sorted(reports, key=lambda report: _values(report, _IDENTITY))


def stale(report: Report, digest: str) -> bool:
    """``report`` is of other weights than those whose SHA-256 is ``digest``."""
    return report["digest"] != digest


def markdown(reports: Iterable[Report], digest: str) -> str:
    """``reports`` on the weights ``digest`` as a table in Markdown, without a line break at its end.

    A report of other weights has a row that says so instead of its measures.
    """
    heading = ("set", "cases", "T", "alpha (95 % interval)", "delta_FT", "p_rg", "alpha, strict", "delta_FT, strict")
    rows: list[tuple[str, ...]] = []
    for report in reports:
        strict = (f"{report['alpha_strict']:.3f}", f"{report['delta_ft_strict']:.3f}")
        measures = (_stale_note(report), *[""] * 4) if stale(report, digest) else (*measure_cells(report), *strict)
        rows.append((set_name(report), str(report["cases"]), f"{report['temperature']:g}", *measures))
    return markdown_table(heading, rows)


def markdown_table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """``rows`` under ``heading``, without a line break at the end."""
    return "\n".join(f"| {' | '.join(line)} |" for line in (heading, ["---"] * len(heading), *rows))


def table(entries: Iterable[tuple[str, str, Report]]) -> Table:
    """Reports for people, those of one set together.

    Args:
        entries: name of the policy, digest of its weights, and a report.
    """
    result = Table(box=None, pad_edge=False)
    for heading in ("", "cases", "T", "alpha (95 % interval)", "delta_FT", "p_rg"):
        result.add_column(heading, justify="right" if heading else "left")
    by_set = sorted(entries, key=lambda entry: _values(entry[2], _SET))
    for _, group in itertools.groupby(by_set, key=lambda entry: _values(entry[2], _SET)):
        for place, (name, digest, report) in enumerate(group):
            if place == 0:
                result.add_row(f"[bold]{set_name(report)}[/]")
            measures = (f"[red]{_stale_note(report)}[/]",) if stale(report, digest) else measure_cells(report)
            result.add_row(f"  {escape(name)}", str(report["cases"]), f"{report['temperature']:g}", *measures)
    return result


def _stale_note(report: Report) -> str:
    return f"stale, of {report['digest'][:DIGITS]}"


def measure_cells(report: Report) -> tuple[str, ...]:
    """alpha, delta_FT and p_rg with their intervals, for a table."""
    low, high = report["alpha_interval"]
    return (
        f"{report['alpha']:.3f} ({low:.3f} to {high:.3f})",
        f"{report['delta_ft']:.3f} ± {half_width(report):.3f}",
        f"{report['p_rg']:.4f}",
    )


def half_width(point: Report) -> float:
    """Of delta_FT's interval; 0 where one case gives none."""
    return 0.0 if math.isnan(point["delta_ft_half_width"]) else point["delta_ft_half_width"]


def _values(report: Report, names: Sequence[str]) -> tuple[Any, ...]:
    return tuple(report[name] for name in names)


def _is_interval(value: Sequence[Any]) -> bool:
    return len(value) == 2 and all(type(end) in (int, float) for end in value)
