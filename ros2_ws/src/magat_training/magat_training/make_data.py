# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat data``: makes and shows data sets, folders of cases with the expert's solutions."""

import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from magat_evaluation.cases import first_cases
from magat_evaluation.executor import Workers, executor
from magat_node import interruption
from magat_node.lock import locked
from magat_node.progress import progress_bars
from magat_training.data import DataSetError, check_data_set, make_data_set


def make(folder: Path, cases: int, seed: int, size: dict[str, Any], console: Console, workers: Workers = 1) -> None:
    """Make a data set of ``cases`` cases in ``folder``, or the rest of one that was interrupted.

    Args:
        folder: of the data set.
        cases: number of cases in all three splits.
        seed: of the cases.
        size: width, height, robots, density, as `draw_case` takes them.
        console: shows the progress and a summary.
        workers: solve the cases; threads of this process if there is one.

    Raises:
        DataSetError: as `make_data_set`; or the folder cannot be written.
        MagatError: another process makes a data set in the folder, or the workers cannot be used.
        InvalidCaseError: this number of cases, or cases of this size, cannot be drawn.
        KeyboardInterrupt: with a message that the command can be resumed.
    """
    splits = first_cases(cases)
    started = time.monotonic()
    with locked(folder), nullcontext() if workers == 1 else executor(workers) as pool, progress_bars(console) as bar:
        task = bar.add_task("cases", total=cases)

        def show_progress(done: int) -> None:
            interruption.check()
            bar.update(task, completed=done)

        try:
            manifest = make_data_set(folder, seed, splits, size, progress=show_progress, executor=pool)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"the same command resumes the data set in {folder}") from None
        except OSError as error:
            raise DataSetError(f"{folder} cannot be written ({error}): choose another folder") from error
    solved = sum(split["solved"] for split in manifest["splits"].values())
    console.print(
        f"{folder}: {solved} of {cases} cases solved, {_megabytes(folder):.1f} MB, {time.monotonic() - started:.1f} s, "
        f"sha256 {manifest['sha256']}",
        highlight=False,
        soft_wrap=True,
    )


def show(folder: Path, console: Console) -> None:
    """Verify the data set in ``folder`` and print its contents to ``console``.

    Raises:
        DataSetError: as `check_data_set`.
    """
    manifest = check_data_set(folder)
    recipe = manifest["recipe"]
    size, expert = recipe["size"], recipe["expert"]
    table = Table(box=None, pad_edge=False)
    for heading in ("split", "numbers", "drawn", "solved", "instants", "shards", "unsolved"):
        table.add_column(heading, justify="left" if heading in ("split", "unsolved") else "right", overflow="fold")
    for name, split in manifest["splits"].items():
        first, end = recipe["splits"][name]
        counts = (split["drawn"], split["solved"], split["instants"], len(split["shards"]))
        unsolved = ", ".join(map(str, split["unsolved"])) or "none"
        table.add_row(name, f"{first} to {end - 1}", *map(str, counts), unsolved)
    lines = (
        f"{folder}, {_megabytes(folder):.1f} MB, verified against its manifest",
        f"cases      {size['width']}x{size['height']} cells, {size['robots']} robots, density {size['density']:g}",
        f"seed       {recipe['seed']}",
        f"expert     w = {expert['w']:g}, at most {expert['node_limit']} expansions",
        f"generator  version {recipe['generator_version']}",
        f"sha256     {manifest['sha256']}",
    )
    for line in lines:
        console.print(line, highlight=False, soft_wrap=True)
    console.print(table)


def _megabytes(folder: Path) -> float:
    return sum(path.stat().st_size for path in folder.iterdir()) / 1e6
