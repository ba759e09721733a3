# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report of ``magat analyze``: printed tables, JSON, CSV files and pictures."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from magat_node.plain import plain
from magat_recording.findings import PERCENTILES, Findings
from magat_sim.measures import SetMeasures, summarise

#: Columns that are printed, and their headings.
EPISODE_COLUMNS = {
    "episode": "no.", "success": "success", "success_strict": "strict", "delta_ft": "delta_FT", "p_rg": "p_rg",
    "makespan": "makespan", "t_max": "T_max", "ticks": "ticks", "moves_blocked": "blocked", "silent": "silent",
    "features_missing": "missing", "bytes_per_tick": "B",
}  # fmt: skip
ROBOT_COLUMNS = {
    "name": "robot", "messages": "messages", "bytes": "bytes", "silent": "silent", "slowest": "slowest",
    "latency_p50": "p50", "latency_p99": "p99", "entropy": "entropy", "attention_received": "attention received",
}  # fmt: skip
ATTENTION_COLUMNS = {
    "distance": "distance", "neighbours": "neighbours", "conflict": "conflict", "relative": "relative attention",
    "effective": "effective neighbours", "half_width": "± (95 %)", "links": "links", "robots": "sample",
}  # fmt: skip
DEADLOCK_COLUMNS = {
    "episode": "episode", "begin": "first tick", "ticks": "ticks", "robots": "robots", "silent": "silent",
}  # fmt: skip
_EPISODE_LEGEND = (
    "strict: all robots on their goals at the same time; blocked: moves; silent: answers that did not come in time; "
    "missing: features in range that were not received; B: bytes that a robot sent in a tick"
)
_ROBOT_LEGEND = (
    "silent: ticks in which the robot did not answer in time; slowest: share of the ticks in which it answered last; "
    "p50, p99: milliseconds to answer; entropy: of its decisions, bits; attention received: sum over all robots that "
    "hear it, mean over ticks"
)
_LOST = ("observations", "features", "preferences", "bundles")


@dataclass(frozen=True)
class RecordingReport:
    """What ``magat analyze --json`` prints. Rows of tables are as documented where the tables are made."""

    #: Names, in the simulator's order.
    robots: list[str]
    #: Name of the policy and SHA-256 of its weights; None if no robot reported them.
    policy: str | None
    digest: str | None
    #: Messages in the recording, and their size.
    messages: int
    bytes: int
    #: Episodes that are ignored because a World message is missing.
    incomplete_episodes: int
    #: Messages that the recording lacks, by kind.
    lost: dict[str, int]
    #: `TeamRecording.episodes`.
    episodes: list[dict[str, Any]]
    #: Of the episodes that ended; None if none did.
    measures: SetMeasures | None
    #: Percentiles of a tick's wall time, seconds.
    tick_seconds: dict[str, float]
    #: `Findings.traffic`.
    traffic: list[dict[str, Any]]
    #: `Findings.attention`.
    attention: dict[str, list[dict[str, Any]]]
    #: Why there is no attention; empty if there is.
    no_attention: str
    #: `magat_recording.deadlocks.deadlocks`.
    deadlocks: list[dict[str, Any]]

    def to_json(self) -> dict[str, Any]:
        """The report as JSON values; values that are not known are None."""
        values: dict[str, Any] = plain(asdict(self))
        return values


def make_report(findings: Findings) -> RecordingReport:
    """The report of ``findings``."""
    recording = findings.recording
    ended = recording.episodes.ended.tolist()
    measures = [episode.log.measures for episode, over in zip(recording.all_episodes, ended, strict=True) if over]
    status = recording.last_status
    return RecordingReport(
        robots=recording.names,
        policy=status and status.policy,
        digest=status and status.digest,
        messages=len(recording.messages),
        bytes=int(recording.messages.bytes.sum()),
        incomplete_episodes=recording.incomplete_episodes,
        lost={name: int(recording.lost[name].sum()) for name in _LOST},
        episodes=recording.episodes.to_dict("records"),
        measures=summarise(measures) if measures else None,
        tick_seconds={name: float(recording.ticks.seconds.quantile(q)) for name, q in PERCENTILES.items()},
        traffic=findings.traffic.to_dict("records"),
        attention={name: table.to_dict("records") for name, table in findings.attention.items()},
        no_attention=findings.no_attention,
        deadlocks=findings.deadlocks.to_dict("records"),
    )


def show(findings: Findings, console: Console) -> None:
    """Print the findings as tables."""
    recording, report = findings.recording, make_report(findings)
    console.print(
        f"[bold]{len(report.robots)} robots[/] with {report.policy} ({(report.digest or '')[:12]}), "
        f"{len(report.episodes)} episodes, {report.messages:,} messages, {report.bytes / 2**20:.1f} MiB",
        highlight=False,
    )
    _show_completeness(findings, report, console)
    console.print(_table(recording.episodes, "Episodes", EPISODE_COLUMNS))
    console.print(f"[dim]{_EPISODE_LEGEND}")
    if report.measures is not None:
        low, high = report.measures.alpha_interval
        console.print(f"alpha {report.measures.alpha:.2f} (95 % interval {low:.2f} to {high:.2f})")
    times = [f"{name} {1e3 * value:.1f}" for name, value in report.tick_seconds.items() if not np.isnan(value)]
    console.print(f"Milliseconds per tick: {', '.join(times)}\n")
    milliseconds = {name: 1e3 * findings.traffic[name] for name in ("latency_p50", "latency_p99")}
    console.print(_table(findings.traffic.assign(**milliseconds), "Robots", ROBOT_COLUMNS))
    console.print(f"[dim]{_ROBOT_LEGEND}")
    for name, table in findings.attention.items():
        console.print(_table(table, f"\nAttention by {name}", ATTENTION_COLUMNS))
    if report.no_attention:
        console.print(f"No attention: {report.no_attention}", markup=False)
    if len(findings.deadlocks):
        console.print(_table(findings.deadlocks, "\nDeadlocks", DEADLOCK_COLUMNS))
    else:
        console.print("No deadlocks")


def _show_completeness(findings: Findings, report: RecordingReport, console: Console) -> None:
    recording = findings.recording
    lost = ", ".join(f"{count} {name}" for name, count in report.lost.items() if count)
    if lost:
        console.print(f"[bold red]The recording lacks {lost}[/], in {len(recording.lost)} ticks")
    else:
        console.print(f"The recording is complete: it has every message of all {len(recording.ticks)} ticks")
    if report.incomplete_episodes:
        console.print(
            f"[bold red]{report.incomplete_episodes} episodes are ignored[/]: some of their World messages are missing"
        )


def _table(values: pd.DataFrame, title: str, columns: Mapping[str, str]) -> Table:
    """The ``columns`` that ``values`` has, with their headings."""
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    present = [name for name in columns if name in values]
    for name in present:
        table.add_column(columns[name], justify="right", overflow="fold")
    for row in values[present].itertuples(index=False):
        table.add_row(*(escape(_text(value)) for value in row))
    return table


def _text(value: Any) -> str:
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return ", ".join(map(str, value))
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def save(findings: Findings, folder: Path, console: Console) -> None:
    """Write the pictures, and each table as CSV, to ``folder``."""
    from magat_recording.charts import save_charts  # matplotlib takes a second to import

    folder.mkdir(parents=True, exist_ok=True)
    recording = findings.recording
    tables = {name: getattr(recording, name) for name in ("episodes", "ticks", "robots", "messages", "lost")}
    with console.status(f"writing to {folder}"):
        for name, table in (tables | {"links": findings.links, "deadlocks": findings.deadlocks}).items():
            table.to_csv(folder / f"{name}.csv", index=False)
        save_charts(findings, folder)
    console.print(f"Pictures and tables are in {folder}", highlight=False)
