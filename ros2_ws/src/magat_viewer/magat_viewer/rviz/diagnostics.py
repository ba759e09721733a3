"""What a team says of itself, as diagnostics."""

# mypy: disable-error-code="import-untyped,import-not-found"

from collections.abc import Sequence
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from magat_interfaces.msg import RobotStatus, World

#: A process whose status has stopped for so long is stale, seconds. While robots run it comes every 2 s.
STALE_AFTER = 5.0
#: Without a tick for so long, no episode runs, seconds.
IDLE_AFTER = 3.0
#: At most so many robots are named in one line.
NAMED = 10


@dataclass
class _Process:
    """What is known of one process of robots."""

    status: RobotStatus
    #: When its last status came, seconds.
    heard: float
    #: Messages dropped and features missing, as of the last report.
    known: tuple[int, int]
    #: What came to these between the last two reports that had a new status.
    more: tuple[int, int] = (0, 0)
    fresh: bool = False


class TeamDiagnostics:
    """Keeps what the team says of itself, and makes diagnostics of it. Times are passed in, seconds."""

    def __init__(self, prefix: str, now: float) -> None:
        """Begin at ``now``; names of diagnostics begin with ``prefix``."""
        self._prefix = prefix
        self._processes: dict[tuple[str, ...], _Process] = {}
        self._world: World | None = None
        self._ticked = self._counted_since = now
        self._ticks = 0

    def reported(self, status: RobotStatus, now: float) -> None:
        """A status came."""
        if not status.robots:
            return  # a mistake, and nobody's
        process = self._processes.get(tuple(status.robots))
        if process is None:
            # What it counted before anybody looked is no news.
            known = (status.messages_dropped, status.features_missing)
            self._processes[tuple(status.robots)] = _Process(status, now, known)
        else:
            process.status, process.heard, process.fresh = status, now, True

    def ticked(self, world: World, now: float) -> None:
        """A world came."""
        self._world, self._ticked = world, now
        self._ticks += world.tick > 0

    def report(self, now: float) -> list[DiagnosticStatus]:
        """The team as a whole, and each process of robots, since the last report."""
        self._forget(now)
        return [
            self._team(now),
            *(self._robots(names, self._processes[names], now) for names in sorted(self._processes)),
        ]

    def _forget(self, now: float) -> None:
        """Drop processes whose robots all run in others now: started anew, in other crews."""
        alive = {name for names, p in self._processes.items() if now - p.heard < STALE_AFTER for name in names}
        self._processes = {
            names: process
            for names, process in self._processes.items()
            if now - process.heard < STALE_AFTER or not alive.issuperset(names)
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
        said = process.status
        if process.fresh:
            counts = (said.messages_dropped, said.features_missing)
            # Counts that fell are those of a process that was started anew.
            process.more = tuple(n - k if n >= k else n for n, k in zip(counts, process.known, strict=True))
            process.known, process.fresh = counts, False
        others = f" and {len(names) - 1} more" if len(names) > 1 else ""
        status = DiagnosticStatus(name=f"{self._prefix}: {names[0]}{others}", hardware_id=names[0])
        silence = now - process.heard
        dropped, missing = process.more
        if silence >= STALE_AFTER:
            status.level, status.message = DiagnosticStatus.STALE, f"no status for {silence:.0f} s"
        elif dropped or missing:
            status.level = DiagnosticStatus.WARN
            status.message = f"{dropped} messages dropped, {missing} features missing since the last report"
        else:
            status.level = DiagnosticStatus.OK
            status.message = "running" if said.state == RobotStatus.RUNNING else "waiting"
        status.values = _values(
            robots=_listed(names),
            state="running" if said.state == RobotStatus.RUNNING else "waiting",
            policy=said.policy,
            digest=said.digest,
            encoding=said.encoding,
            radio=said.radio,
            peers_heard=said.peers_heard,
            ticks=said.ticks,
            features_missing=said.features_missing,
            messages_dropped=said.messages_dropped,
            last_drop=said.last_drop,
        )
        return status


def _listed(names: Sequence[str]) -> str:
    rest = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + rest


def _values(**values: object) -> list[KeyValue]:
    return [KeyValue(key=key, value=str(value)) for key, value in values.items()]
