"""What the server asks of a team, whether it runs or was recorded."""

from collections.abc import Collection
from typing import Any, Protocol


class Source(Protocol):
    """A team to be shown. Episodes are numbered from 0 as they were seen; JSON values are as in `state` and `detail`.

    All methods are called in one thread, and none waits.
    """

    #: Whether it runs now: then there is one episode to be seen, the newest.
    live: bool
    #: A line about it.
    title: str

    def poll(self, chosen: Collection[int]) -> None:
        """Take what has come; ``chosen`` are the robots that people look at, by number."""

    @property
    def newest(self) -> int:
        """Number of the newest episode; -1 before the first one."""

    def results(self) -> list[dict[str, Any]]:
        """One `WatchedEpisode.result` an episode."""

    def scene(self, episode: int) -> dict[str, Any]:
        """What stays of it."""

    def frames(self, episode: int, after: int) -> tuple[int, bytes]:
        """What is new after tick ``after`` (-1: nothing is known): its last tick, and frames, which may be none."""

    def health(self, episode: int) -> dict[str, Any]:
        """How the processes of the team are, see `Health.report`."""

    def detail(self, episode: int, tick: int, robot: int) -> dict[str, Any] | None:
        """What is known of a robot at ``tick``, of a live team at its newest complete tick; None if it is nothing."""
