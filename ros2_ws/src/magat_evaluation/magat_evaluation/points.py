"""Points: policies and baselines in a setting, each on a set of cases; what was measured of them, kept in CSV files.

A file has a row a point, and a point that is there is not measured again, as long as the weights are the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from magat_evaluation.baselines import BASELINES
from magat_evaluation.evaluate import Setting, evaluate_baseline, evaluate_policy, set_name
from magat_evaluation.measures_file import Report
from magat_evaluation.report_files import identity, read_csv, write_csv
from magat_evaluation.sets import StandardSet
from magat_evaluation.splits import SET_SEED, SPLITS
from magat_node import cdr
from magat_robot.policy.folder import read_folder
from magat_robot.policy.payload import encoded_bytes


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
        """What it has in common with every report of the same point, see `report_files.identity`."""
        known = {
            "policy": self.policy,
            "link_loss": self.setting.rules.link_loss,
            **self._carried(),
            **self.cases.size,
            "seed": SET_SEED,
            "first_case": SPLITS["test"].start,
            "cases": self.cases.cases,
        }
        return identity(known)

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
        """Its report, as of `evaluation.evaluate_policy`, and the bytes that a robot sends in a step."""
        numbers, size = SPLITS["test"][: self.cases.cases], self.cases.size
        if self.folder is None:
            report = evaluate_baseline(self.policy, numbers, SET_SEED, size, console, workers)
            return report | {"bytes_per_step": 0}
        report = evaluate_policy(self.folder, numbers, SET_SEED, self.setting, size, console, workers)
        return report | {"policy": self.policy, "bytes_per_step": bytes_per_step(self.folder, report["encoding"])}


def bytes_per_step(folder: Path, encoding: str) -> int:
    """Bytes of the feature messages that a robot with the policy in ``folder`` sends in a step, all rounds together."""
    config, _, _ = read_folder(folder)
    return cdr.feature_bytes(encoded_bytes(size, encoding) for size in config.message_sizes)


def measured(
    points: Sequence[Point],
    path: Path,
    console: Console,
    workers: int = 1,
    title: str = "points",
    others: Sequence[Path] = (),
) -> list[Report]:
    """The reports of ``points``, in order, out of ``path`` or ``others`` or measured; then in ``path``, too.

    Args:
        points: what to measure.
        path: file that keeps what was measured.
        console: shows the progress.
        workers: processes.
        title: of the progress.
        others: files that may have some of the points, too.

    Raises:
        InvalidCaseError: a set has no cases that can be drawn and solved.
        ModelError: a policy cannot be used.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    known = {identity(row): row for row in read_csv(path)}
    elsewhere = {identity(row): row for other in others for row in read_csv(other)}
    asked = [point.identity() for point in points]
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_interactive) as progress:
        task = progress.add_task(title, total=len(points))
        for point, which in zip(points, asked, strict=True):
            if which not in known:
                what = f"{title}: {escape(point.policy)}, {set_name(point.cases.size)}"
                progress.update(task, description=what)
                known[which] = elsewhere.get(which) or point.measure(console, workers)
                write_csv(list(known.values()), path)  # at once: it may be interrupted before the next one
            progress.advance(task)
    kept = {identity(row): row for row in read_csv(path)}
    return [kept[which] for which in asked]
