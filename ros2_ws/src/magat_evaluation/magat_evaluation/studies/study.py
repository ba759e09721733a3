# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a study is, and the registry of those on the page of results."""

import importlib
import pkgutil
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from magat_evaluation import studies
from magat_evaluation.executor import Workers
from magat_evaluation.points import Point, measure_points
from magat_evaluation.report import EvaluationKey, Report
from magat_evaluation.report_files import outcomes_file, read_csv, write_csv
from magat_evaluation.tables import markdown_table


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
    """Some points, and how their reports are shown."""

    #: Of its files: ``[name].csv``, and ``[name][suffix].png`` for each picture.
    name: str
    title: str
    points: tuple[Point, ...]
    #: Headings of the table of reports.
    heading: tuple[str, ...]
    #: The row of a report in that table.
    row: Callable[[Report], tuple[str, ...]]
    pictures: tuple[Picture, ...] = ()
    #: Heading of the table that has the row of a report; all reports are in one table if it is "".
    group: Callable[[Report], str] = lambda _: ""

    def select(
        self, policies: Collection[str], shields: Collection[str] | None = None, most: int | None = None
    ) -> list[Point]:
        """Some of its points: those of the baselines and of ``policies``.

        Args:
            policies: their names.
            shields: only these; all if None.
            most: cases of a point at most; no limit if None.
        """
        chosen = [
            point
            for point in self.points
            if (point.candidate.name in policies or not point.candidate.digest)
            and (shields is None or point.candidate.rules.shield in shields)
        ]
        if most is None:
            return chosen
        return [replace(point, cases=replace(point.cases, cases=min(point.cases.cases, most))) for point in chosen]

    def file(self, folder: Path) -> Path:
        """Its CSV file in ``folder``."""
        return folder / f"{self.name}.csv"

    def measure(
        self,
        folder: Path,
        console: Console,
        workers: Workers = 1,
        others: Sequence[Path] = (),
        only: Sequence[Point] | None = None,
    ) -> list[Report]:
        """Measure what is missing in its file in ``folder``.

        Args:
            folder: of the files.
            console: shows the progress.
            workers: see `executor`.
            others: files that may hold some of the reports.
            only: what to measure; the file keeps its other reports that are `current`. If None, all points are
                measured, and the file then holds them and nothing else.

        Returns:
            The reports, in the order of the points.

        Raises:
            InvalidCaseError: a set has no cases that can be drawn and solved.
            ModelError: a policy cannot be used.
        """
        path = self.file(folder)
        points = self.points if only is None else only
        reports = measure_points(points, path, console, workers, self.title, others)
        if only is not None:
            replaced = {report.place for report in reports}
            reports = self.current([*(one for one in read_csv(path) if one.place not in replaced), *reports])
        write_csv(reports, path)
        return reports

    def current(self, reports: Sequence[Report]) -> list[Report]:
        """Those of ``reports`` that hold for its policies as they are now, in the order of its points.

        Reports of policies that it does not have, such as further trainings, follow; they hold if their shield and
        their cases do.
        """
        keys = {point.key.place: point.key for point in self.points}
        order = {place: index for index, place in enumerate(keys)}
        names = {key.policy for key in keys.values()}

        def holds(report: Report) -> bool:
            key = keys.get(report.place)
            if key is None:
                return report.policy not in names and not report.outdated
            return _version(report) == _version(key) and not report.outdated

        return sorted(filter(holds, reports), key=lambda report: order.get(report.place, len(order)))

    def draw(self, reports: Sequence[Report], folder: Path) -> None:
        """Draw its pictures of ``reports`` into ``folder``."""
        for picture in self.pictures:
            picture.draw(reports, folder / f"{self.name}{picture.suffix}.png")

    def markdown(self, reports: Sequence[Report]) -> str:
        """Its pictures, the tables of ``reports``, and a link to its file."""
        parts = [f"![{picture.title}]({self.name}{picture.suffix}.png)" for picture in self.pictures]
        for group in dict.fromkeys(map(self.group, reports)):
            rows = [self.row(report) for report in reports if self.group(report) == group]
            parts += [*filter(None, (group,)), markdown_table(self.heading, rows)]
        file, cases = self.file(Path()), outcomes_file(self.file(Path()))
        parts.append(
            f"All measures, with the digests of the weights: [{file}]({file}); of each case: [{cases}]({cases})."
        )
        return "\n\n".join(parts)

    def table(self, reports: Sequence[Report]) -> Table:
        """``reports`` for the terminal."""
        result = Table(title=self.title, title_justify="left", box=None, pad_edge=False)
        for name in self.heading:
            result.add_column(name, overflow="fold")
        for report in reports:
            result.add_row(*map(escape, self.row(report)))
        return result


def _version(key: EvaluationKey) -> tuple[str, float, int]:
    return key.digest, key.temperature, key.first_case


#: Makes a study of policies, given by their names and folders.
MakeStudy = Callable[[Mapping[str, Path]], Study]
_REGISTERED: dict[str, MakeStudy] = {}


def register(name: str) -> Callable[[MakeStudy], MakeStudy]:
    """Decorator: put the study ``name`` on the page of results."""

    def add(make: MakeStudy) -> MakeStudy:
        _REGISTERED[name] = make
        return make

    return add


def all_studies() -> Mapping[str, MakeStudy]:
    """The registered studies, by name."""
    for module in pkgutil.iter_modules(studies.__path__):
        importlib.import_module(f"{studies.__name__}.{module.name}")
    return _REGISTERED
