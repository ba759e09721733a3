"""Findings for people and for programs: tables, JSON and files."""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from magat_recording.findings import PERCENTILES, Findings
from magat_sim.measures import summarise

#: Columns that are shown, and their headings.
EPISODE_COLUMNS = {
    "episode": "no", "success": "alpha", "success_strict": "strict", "delta_ft": "delta_FT", "p_rg": "p_rg",
    "makespan": "makespan", "t_max": "T_max", "ticks": "ticks", "moves_blocked": "blocked", "silent": "silent",
    "features_missing": "missing", "bytes_per_tick": "B/tick",
}  # fmt: skip
ROBOT_COLUMNS = {
    "name": "robot", "messages": "messages", "bytes": "bytes", "silent": "silent", "slowest": "last",
    "latency_p50": "p50", "latency_p99": "p99", "entropy": "entropy", "attention_received": "heeded",
}  # fmt: skip


def report(findings: Findings) -> dict[str, Any]:
    """The findings as plain JSON values; what is not known is None."""
    recording = findings.recording
    ended = recording.episodes.ended.tolist()
    measures = [
        episode.recording.measures for episode, whole in zip(recording.all_episodes, ended, strict=True) if whole
    ]
    equipment = recording.equipment
    values = {
        "robots": recording.names,
        "policy": equipment and equipment.policy,
        "digest": equipment and equipment.digest,
        "messages": len(recording.messages),
        "bytes": int(recording.messages.bytes.sum()),
        "left_out": recording.left_out,
        "lost": {name: int(recording.lost[name].sum()) for name in _LOST},
        "episodes": recording.episodes.to_dict("records"),
        "measures": dataclasses.asdict(summarise(measures)) if measures else None,
        "tick_seconds": {name: float(recording.ticks.seconds.quantile(q)) for name, q in PERCENTILES.items()},
        "traffic": findings.traffic.to_dict("records"),
        "attention": {name: table.to_dict("records") for name, table in findings.attention.items()},
        "deadlocks": findings.deadlocks.to_dict("records"),
    }
    return _plain(values)


_LOST = ("observations", "features", "preferences", "bundles")


def _plain(value: Any) -> Any:
    """JSON has no NaN."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def show(findings: Findings, console: Console) -> None:
    """The findings for people."""
    recording, said = findings.recording, report(findings)
    console.print(
        f"[bold]{len(recording.names)} robots[/] with {said['policy']} ({(said['digest'] or '')[:12]}), "
        f"{len(recording.episodes)} episodes, {said['messages']:,} messages of {said['bytes'] / 2**20:.1f} MiB",
        highlight=False,
    )
    lost = {name: count for name, count in said["lost"].items() if count}
    if lost:
        lacking = ", ".join(f"{count} {name}" for name, count in lost.items())
        console.print(f"[bold red]The recording lacks {lacking}[/], in {len(recording.lost)} ticks")
    else:
        console.print(f"Every message of each of the {len(recording.ticks)} ticks is there")
    if recording.left_out:
        console.print(
            f"[bold red]{recording.left_out} episodes are left out[/]: their begin, or some of it, is not there"
        )
    console.print(_table(recording.episodes, "Episodes", EPISODE_COLUMNS))
    if said["measures"]:
        low, high = said["measures"]["alpha_interval"]
        console.print(f"alpha {said['measures']['alpha']:.2f} (95 % interval {low:.2f} to {high:.2f})")
    times = ", ".join(f"{name} {1e3 * value:.1f}" for name, value in said["tick_seconds"].items() if value is not None)
    console.print(f"Milliseconds a tick: {times}\n")
    milliseconds = {name: 1e3 * findings.traffic[name] for name in ("latency_p50", "latency_p99")}
    console.print(_table(findings.traffic.assign(**milliseconds), "Robots", ROBOT_COLUMNS))
    console.print("[dim]last: share of the ticks in which it was the last to answer; p50, p99: milliseconds to answer;")
    console.print("[dim]heeded: attention that all who hear it pay to it, in sum")
    for name, table in findings.attention.items():
        console.print(_table(table, f"\nAttention by {name}", {column: column for column in table}))
    if findings.why:
        console.print(f"No attention: {findings.why}", markup=False)
    if len(findings.deadlocks):
        console.print(_table(findings.deadlocks, "Deadlocks", {column: column for column in findings.deadlocks}))
    else:
        console.print("No deadlocks")


def _table(values: pd.DataFrame, title: str, columns: Mapping[str, str]) -> Table:
    """Those of ``columns`` that there are, under their headings."""
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    there = [name for name in columns if name in values]
    for name in there:
        table.add_column(columns[name].replace("_", " "), justify="right", no_wrap=True)
    for row in values[there].itertuples(index=False):
        table.add_row(*(escape(_text(value)) for value in row))
    return table


def _text(value: Any) -> str:
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def save(findings: Findings, folder: Path, console: Console) -> None:
    """Write the pictures, and each table as CSV, to ``folder``."""
    from magat_recording.charts import save_charts  # which takes matplotlib a second to import

    folder.mkdir(parents=True, exist_ok=True)
    recording = findings.recording
    tables = {name: getattr(recording, name) for name in ("episodes", "ticks", "robots", "messages", "lost")}
    with console.status(f"writing to {folder}"):
        for name, table in (tables | {"links": findings.links, "deadlocks": findings.deadlocks}).items():
            table.to_csv(folder / f"{name}.csv", index=False)
        save_charts(findings, folder)
    console.print(f"Pictures and tables are in {folder}", highlight=False)
