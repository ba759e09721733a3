# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The results of a run: kept in a file after each episode, and shown as a table."""

import json
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.markup import escape
from rich.table import Table

from magat_bringup.run_folder import RESULTS, RESULTS_SO_FAR
from magat_interfaces.action import RunEpisode
from magat_node.files import write_atomically
from magat_node.plain import plain
from magat_sim.measures import wilson

LEGEND = (
    "B/tick: bytes of the feature message that a robot sends in a tick; blocked: moves that the shield did not allow; "
    "missing: features that did not arrive in time; silent: preferences that did not arrive in time"
)


class RunResults:
    """The results of a run so far. A run that is killed leaves those of the episodes that have ended."""

    def __init__(self, folder: Path, robots: int) -> None:
        """Keep the results of a team of ``robots`` in ``folder``."""
        self._folder, self._robots = folder, robots
        #: The names of the cases and their results. One with an ``error`` was not run.
        self.rows: list[tuple[str, RunEpisode.Result]] = []
        #: What could not be written, and why.
        self.problems: list[str] = []

    @property
    def run(self) -> list[RunEpisode.Result]:
        """The results of the episodes that were run."""
        return [result for _, result in self.rows if not result.error]

    def add(self, case: str, result: RunEpisode.Result) -> None:
        """Take the result of the episode on ``case``, and append it to ``results.jsonl``."""
        self.rows.append((case, result))
        self._write(lambda: self._append(_entry(case, result)))

    def finish(self) -> None:
        """Replace ``results.jsonl`` by ``results.json``, a list."""

        def write() -> None:
            with write_atomically(self._folder / RESULTS) as draft:
                entries = [_entry(case, result) for case, result in self.rows]
                draft.write_text(json.dumps(entries, indent=1, allow_nan=False) + "\n")
            (self._folder / RESULTS_SO_FAR).unlink(missing_ok=True)

        self._write(write)

    def _append(self, entry: dict[str, Any]) -> None:
        with (self._folder / RESULTS_SO_FAR).open("a") as file:
            file.write(json.dumps(entry, allow_nan=False) + "\n")

    def _write(self, write: Any) -> None:
        """A full disk must not end the episodes; the table is printed all the same."""
        try:
            write()
        except OSError as error:
            problem = f"the results in {self._folder} are not complete ({error.strerror})"
            self.problems = [*(one for one in self.problems if one != problem), problem]

    def table(self, title: str) -> Table:
        """One row for each episode, and one for all that were run."""
        results = self.run
        count, complete = len(results), sum(result.success for result in results)
        caption = "no episode was run"
        if results:
            low, high = wilson(complete, count)
            caption = f"alpha {complete / count:.2f} (95 % interval {low:.2f} to {high:.2f}, {count} cases)"
        table = Table(
            title=title,
            caption=caption,
            title_justify="left",
            caption_justify="left",
            box=SIMPLE,
            padding=0,  # ten columns fit into a terminal of 80
        )
        headings = ("delta_FT", "ticks", "T_max", "ticks/s", "B/tick", "blocked", "missing", "silent")
        for heading in ("case", "complete", *headings):
            table.add_column(heading, justify="right", overflow="fold")
        for name, result in self.rows:
            table.add_row(escape(name), *(["not run"] if result.error else self._columns(result)))
        if results:
            table.add_section()
            table.add_row("all", *_sums(results), style="bold")
        return table

    def _columns(self, result: RunEpisode.Result) -> list[str]:
        return [
            "yes" if result.success else f"{round(result.p_rg * self._robots)} of {self._robots}",
            f"{result.delta_ft:.1%}",
            str(result.ticks),
            str(result.t_max),
            f"{result.ticks_per_second:.0f}",
            f"{result.bytes_per_tick:.0f}",
            str(result.moves_blocked),
            str(result.features_missing),
            str(result.silent),
        ]


def _sums(results: list[RunEpisode.Result]) -> list[str]:
    count = len(results)
    ticks = sum(result.ticks for result in results)
    seconds = sum(result.ticks / result.ticks_per_second for result in results if result.ticks)
    return [
        f"{sum(result.success for result in results)} of {count}",
        f"{sum(result.delta_ft for result in results) / count:.1%}",
        str(ticks),
        str(sum(result.t_max for result in results)),
        f"{ticks / seconds:.0f}" if seconds else "",
        f"{sum(result.bytes_per_tick for result in results) / count:.0f}",
        str(sum(result.moves_blocked for result in results)),
        str(sum(result.features_missing for result in results)),
        str(sum(result.silent for result in results)),
    ]


def _entry(case: str, result: RunEpisode.Result) -> dict[str, Any]:
    """A result for JSON: its fields, bytes in hexadecimal, and the name of its case."""
    fields = {name: getattr(result, name) for name in RunEpisode.Result.get_fields_and_field_types()}
    fields["secret"] = bytes(result.secret).hex()
    entry: dict[str, Any] = plain({"case": case} | fields)
    return entry
