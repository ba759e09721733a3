# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The interface between the server and a team, live or recorded."""

from collections.abc import Collection
from typing import Protocol

from magat_viewer.detail import RobotDetail
from magat_viewer.health import HealthReport
from magat_viewer.watched_episode import EpisodeResult, Scene


class Source(Protocol):
    """A team to be shown. Its episodes are numbered from 0.

    All methods are called in one thread, and none of them blocks.
    """

    #: Whether the team runs now. Then only the newest episode can be shown.
    live: bool
    #: One line about the team.
    title: str

    def poll(self, chosen: Collection[int]) -> None:
        """Take the messages that have arrived; ``chosen`` are the numbers of the robots that browsers look at."""

    @property
    def newest(self) -> int:
        """Number of the newest episode; -1 before the first one."""

    def results(self) -> list[EpisodeResult]:
        """The results of the episodes, in their order."""

    def scene(self, episode: int) -> Scene:
        """What does not change during an episode."""

    def frames(self, episode: int, after: int) -> tuple[int, bytes]:
        """The last tick of an episode, and its frames after the tick ``after`` (all if -1), possibly none."""

    def health(self, episode: int) -> HealthReport:
        """The health of the team's processes."""

    def detail(self, episode: int, tick: int, robot: int) -> RobotDetail | None:
        """The detail of a robot at ``tick``, or of a live team at its newest complete tick; None if it is not known."""
