# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The health of a team's processes, from their RobotStatus messages. Free of ROS."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ProcessHealth:
    """One process of robots."""

    #: Numbers of its robots.
    robots: list[int]
    #: Seconds since its last status.
    age: float
    restarts: int
    #: False while it waits for an episode.
    running: bool
    # As in RobotStatus.
    policy: str
    digest: str
    encoding: str
    radio: str
    features_missing: int
    messages_dropped: int
    last_drop: str


@dataclass(frozen=True)
class HealthReport:
    """The health of a team. The browser gets it as JSON, with the same names."""

    #: Times that a robot was silent in this episode, by its number; without robots that never were.
    late: dict[int, int]
    processes: list[ProcessHealth]


@dataclass(frozen=True)
class _Process:
    """The last status of a process, when it came (seconds), and how often the process was restarted."""

    status: Any
    received: float
    restarts: int


class TeamHealth:
    """Keeps the last status of each process. All times are passed in, seconds."""

    def __init__(self) -> None:
        """Start without any status."""
        self._process_of: dict[str, _Process] = {}

    def add_status(self, status: Any, now: float) -> None:
        """Take a `RobotStatus`."""
        known = self._process_of.get(status.robots[0]) if status.robots else None
        restarts = 0
        if known is not None and list(known.status.robots) == list(status.robots):
            # The number of ticks falls only if the process has started again.
            restarts = known.restarts + (status.ticks < known.status.ticks)
        process = _Process(status, now, restarts)
        self._process_of.update(dict.fromkeys(status.robots, process))

    def status_of(self, robot: str) -> Any:
        """The last status of the process of ``robot``; None if there is none."""
        process = self._process_of.get(robot)
        return process and process.status

    def report(self, robots: Sequence[str], silences: Sequence[int], now: float) -> HealthReport:
        """The health of the team.

        Args:
            robots: names, in the order of their numbers.
            silences: how often each was silent in this episode.
            now: seconds.
        """
        number_of = {name: number for number, name in enumerate(robots)}
        processes = {id(p): p for name in robots if (p := self._process_of.get(name)) is not None}
        return HealthReport(
            late={number: int(times) for number, times in enumerate(silences) if times},
            processes=[
                ProcessHealth(
                    robots=[number_of[name] for name in process.status.robots if name in number_of],
                    age=round(now - process.received, 1),
                    restarts=process.restarts,
                    running=bool(process.status.state),
                    **{name: getattr(process.status, name) for name in _STATUS_FIELDS},
                )
                for process in processes.values()
            ],
        )


_STATUS_FIELDS = ("policy", "digest", "encoding", "radio", "features_missing", "messages_dropped", "last_drop")
