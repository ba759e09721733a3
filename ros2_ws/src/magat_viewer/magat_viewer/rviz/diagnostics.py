# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""RobotStatus and World messages as diagnostics."""

# mypy: disable-error-code="import-untyped,import-not-found"

from collections.abc import Sequence
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from magat_interfaces.msg import RobotStatus, World

#: A process without a status for this long is stale, seconds. Running robots send one every 2 s.
STALE_AFTER = 5.0
#: Without a tick for this long, no episode runs, seconds.
IDLE_AFTER = 3.0
#: Most robots that are named in one line.
NAMED = 10


@dataclass
class _Process:
    """The last status of one process of robots."""

    status: RobotStatus
    #: Time of its last status, seconds.
    received: float
    #: Messages dropped and features missing, as of the last report.
    known: tuple[int, int]
    #: How much these grew between the last two reports with a new status.
    more: tuple[int, int] = (0, 0)
    fresh: bool = False


class TeamDiagnostics:
    """Collects statuses and worlds, and reports diagnostics. All times are passed in, seconds."""

    def __init__(self, prefix: str, now: float) -> None:
        """Start at ``now``; ``prefix`` is put before the names of diagnostics."""
        self._prefix = prefix
        self._processes: dict[tuple[str, ...], _Process] = {}
        self._world: World | None = None
        self._ticked = self._counted_since = now
        self._ticks = 0

    def reported(self, status: RobotStatus, now: float) -> None:
        """Take a RobotStatus."""
        if not status.robots:
            return  # an invalid status, which belongs to no process
        process = self._processes.get(tuple(status.robots))
        if process is None:
            # Counts from before this node started are not reported.
            known = (status.messages_dropped, status.features_missing)
            self._processes[tuple(status.robots)] = _Process(status, now, known)
        else:
            process.status, process.received, process.fresh = status, now, True

    def ticked(self, world: World, now: float) -> None:
        """Take a World message."""
        self._world, self._ticked = world, now
        self._ticks += world.tick > 0

    def report(self, now: float) -> list[DiagnosticStatus]:
        """The status of the team and of each process, since the last report."""
        self._forget(now)
        return [
            self._team(now),
            *(self._robots(names, self._processes[names], now) for names in sorted(self._processes)),
        ]

    def _forget(self, now: float) -> None:
        """Drop stale processes whose robots all run in other processes now, after a restart with other crews."""
        alive = {name for names, p in self._processes.items() if now - p.received < STALE_AFTER for name in names}
        self._processes = {
            names: process
            for names, process in self._processes.items()
            if now - process.received < STALE_AFTER or not alive.issuperset(names)
        }

    def _team(self, now: float) -> DiagnosticStatus:
        status = DiagnosticStatus(name=f"{self._prefix}: team", level=DiagnosticStatus.OK)
        speed = self._ticks / (now - self._counted_since) if now > self._counted_since else 0.0
        self._ticks, self._counted_since = 0, now
        world = self._world
        if world is None:
            status.message = "no episode yet"
            return status
        silent = [name for name, is_silent in zip(world.robots, world.silent, strict=True) if is_silent]
        if now - self._ticked >= IDLE_AFTER:
            status.message = f"no episode: the last tick was {now - self._ticked:.0f} s ago"
        elif silent:
            status.level = DiagnosticStatus.WARN
            status.message = f"{len(silent)} of {len(world.robots)} robots are silent: {_listed(silent)}"
        else:
            status.message = f"{speed:.1f} ticks/s"
        status.values = _values(
            episode=world.episode,
            tick=world.tick,
            ticks_per_second=f"{speed:.1f}",
            robots=len(world.robots),
            visited=sum(world.visited),
            silent=len(silent),
            silent_robots=_listed(silent),
            links=world.links,
        )
        return status

    def _robots(self, names: tuple[str, ...], process: _Process, now: float) -> DiagnosticStatus:
        known = process.status
        if process.fresh:
            counts = (known.messages_dropped, known.features_missing)
            # Counts fall only if the process has started again.
            process.more = tuple(n - k if n >= k else n for n, k in zip(counts, process.known, strict=True))
            process.known, process.fresh = counts, False
        others = f" and {len(names) - 1} more" if len(names) > 1 else ""
        status = DiagnosticStatus(name=f"{self._prefix}: {names[0]}{others}", hardware_id=names[0])
        silence = now - process.received
        dropped, missing = process.more
        if silence >= STALE_AFTER:
            status.level, status.message = DiagnosticStatus.STALE, f"no status for {silence:.0f} s"
        elif dropped or missing:
            status.level = DiagnosticStatus.WARN
            status.message = f"{dropped} messages dropped, {missing} features missing since the last report"
        else:
            status.level = DiagnosticStatus.OK
            status.message = "running" if known.state == RobotStatus.RUNNING else "waiting"
        status.values = _values(
            robots=_listed(names),
            state="running" if known.state == RobotStatus.RUNNING else "waiting",
            policy=known.policy,
            digest=known.digest,
            encoding=known.encoding,
            radio=known.radio,
            peers_heard=known.peers_heard,
            ticks=known.ticks,
            features_missing=known.features_missing,
            messages_dropped=known.messages_dropped,
            last_drop=known.last_drop,
        )
        return status


def _listed(names: Sequence[str]) -> str:
    rest = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + rest


def _values(**values: object) -> list[KeyValue]:
    return [KeyValue(key=key, value=str(value)) for key, value in values.items()]
