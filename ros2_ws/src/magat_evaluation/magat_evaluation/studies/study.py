"""What a study is, and the registry of those on the page of results."""

import importlib
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from magat_evaluation import studies
from magat_evaluation.points import Point, measure_points
from magat_evaluation.report import Report
from magat_evaluation.report_files import write_csv
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

    def with_cases(self, most: int) -> "Study":
        """The same on at most ``most`` cases of each set."""
        few = [replace(point, cases=replace(point.cases, cases=min(point.cases.cases, most))) for point in self.points]
        return replace(self, points=tuple(few))

    def file(self, folder: Path) -> Path:
        """Its CSV file in ``folder``."""
        return folder / f"{self.name}.csv"

    def measure(self, folder: Path, console: Console, workers: int = 1, others: Sequence[Path] = ()) -> list[Report]:
        """Measure what is missing in its file in ``folder``, which then holds its points and nothing else.

        Args:
            folder: of the files.
            console: shows the progress.
            workers: processes.
            others: files that may hold some of the reports.

        Returns:
            The reports, in the order of the points.

        Raises:
            InvalidCaseError: a set has no cases that can be drawn and solved.
            ModelError: a policy cannot be used.
        """
        reports = measure_points(self.points, self.file(folder), console, workers, self.title, others)
        write_csv(reports, self.file(folder))
        return reports

    def draw(self, reports: Sequence[Report], folder: Path) -> None:
        """Draw its pictures of ``reports`` into ``folder``."""
        for picture in self.pictures:
            picture.draw(reports, folder / f"{self.name}{picture.suffix}.png")

    def markdown(self, reports: Sequence[Report]) -> str:
        """Its pictures, the table of ``reports``, and a link to its file."""
        parts = [f"![{picture.title}]({self.name}{picture.suffix}.png)" for picture in self.pictures]
        parts.append(markdown_table(self.heading, map(self.row, reports)))
        parts.append(f"All measures, with the digests of the weights: [{self.name}.csv]({self.name}.csv).")
        return "\n\n".join(parts)

    def table(self, reports: Sequence[Report]) -> Table:
        """``reports`` for the terminal."""
        result = Table(title=self.title, title_justify="left", box=None, pad_edge=False)
        for name in self.heading:
            result.add_column(name)
        for report in reports:
            result.add_row(*map(escape, self.row(report)))
        return result


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
