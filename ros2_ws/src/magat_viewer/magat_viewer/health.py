"""How the processes of a team are, from what they say of themselves. Free of ROS."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass
class _Process:
    """What is known of one process of robots."""

    status: Any
    #: When its last status came, seconds.
    heard: float
    restarts: int = 0


class Health:
    """Keeps the last status of each process. Times are passed in, seconds."""

    def __init__(self) -> None:
        """Nothing has been said yet."""
        self._process_of: dict[str, _Process] = {}

    def reported(self, status: Any, now: float) -> None:
        """A `RobotStatus` came."""
        known = self._process_of.get(status.robots[0]) if status.robots else None
        restarts = 0
        if known is not None and list(known.status.robots) == list(status.robots):
            # Who has answered less often than before has begun anew.
            restarts = known.restarts + (status.ticks < known.status.ticks)
        process = _Process(status, now, restarts)
        self._process_of.update(dict.fromkeys(status.robots, process))

    def status_of(self, robot: str) -> Any:
        """What the process of ``robot`` said last; None if it said nothing."""
        process = self._process_of.get(robot)
        return process and process.status

    def report(self, robots: Sequence[str], silences: Sequence[int], now: float) -> dict[str, Any]:
        """How all are, as JSON values.

        Args:
            robots: names; in the report they go by their numbers.
            silences: how often each was silent in this episode.
            now: seconds.

        Returns:
            ``late``: by robot, how often it was silent, where that is more than never; ``processes``: one entry each,
            with its ``robots``, ``age`` (seconds since its last status), ``restarts`` and what it said.
        """
        number_of = {name: number for number, name in enumerate(robots)}
        processes = {id(p): p for name in robots if (p := self._process_of.get(name)) is not None}
        return {
            "kind": "health",
            "late": {str(number): int(times) for number, times in enumerate(silences) if times},
            "processes": [
                {
                    "robots": [number_of[name] for name in process.status.robots if name in number_of],
                    "age": round(now - process.heard, 1),
                    "restarts": process.restarts,
                    "running": bool(process.status.state),
                    **{name: getattr(process.status, name) for name in _SAID},
                }
                for process in processes.values()
            ],
        }


_SAID = ("policy", "digest", "encoding", "radio", "features_missing", "messages_dropped", "last_drop")
