# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The states of an episode on a team. Each class holds what exists in that state only.

    Idle -> Gathering -> AwaitingExpert -> Ticking -> Idle
               ^   |            |             ^
               +---|------------+             |
                   +--------------------------+

An expert that does not answer is asked again after another round of gathering. If there is no expert and the request
sets T_max, the episode begins without one. Every state but `Idle` can also end in `Idle`: the goal is aborted or
cancelled. `magat_sim.episode_server` makes the transitions.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from magat_sim.case import Case
from magat_sim.measures import Flowtime
from magat_sim.ticks import DistributedEpisode

#: How the error of an episode begins that the expert has no solution for.
NO_MAKESPAN = "the expert gives no makespan"
#: The error of an episode that its client has cancelled.
CANCELLED = "cancelled"


class Progress(NamedTuple):
    """Feedback while a goal is under way; tick and T_max are 0 before the first tick."""

    tick: int
    t_max: int
    #: Robots that have visited their goals, that stand on their goals, and that take part.
    arrived: int
    on_goal: int
    joined: int


class Goal(Protocol):
    """The request of a client that is being served."""

    @property
    def cancel_requested(self) -> bool:
        """The client wants the episode to end."""

    def feed_back(self, progress: Progress) -> None:
        """Tell the client how far the episode is."""

    def succeed(self, end: "EpisodeEnd") -> None:
        """The episode was run to its end."""

    def abort(self, end: "EpisodeEnd") -> None:
        """The episode could not be run; ``end.error`` says why."""

    def cancel(self, end: "EpisodeEnd") -> None:
        """The episode was ended at the client's request."""


class EpisodeRequest(NamedTuple):
    """An episode that a client asks for."""

    #: Random number of the episode, not 0.
    episode: int
    case: Case
    #: Seed and number of the case; with the secret, of the episode's random streams.
    seed: int
    number: int
    #: Steps at most; 0 takes `T_MAX_FACTOR` times the expert's makespan.
    t_max: int
    #: The expert's suboptimality bound.
    expert_w: float
    #: `SECRET_BYTES` bytes that no robot learns.
    secret: bytes


class ExpertPlan(NamedTuple):
    """What the episode takes from the expert's solution."""

    makespan: int
    flowtime: Flowtime


@dataclass(frozen=True)
class Idle:
    """No goal."""


@dataclass(frozen=True)
class Gathering:
    """Waits until the robots and the expert are there, and no deployment is under way."""

    goal: Goal
    request: EpisodeRequest
    #: When waiting began, seconds.
    begun: float


@dataclass(frozen=True)
class AwaitingExpert:
    """The expert searches."""

    gathered: Gathering
    search: object
    #: When the expert was asked, seconds.
    asked: float


@dataclass(frozen=True)
class Ticking:
    """The robots move."""

    goal: Goal
    request: EpisodeRequest
    episode: DistributedEpisode
    #: FT*; None without an expert's solution.
    expert: Flowtime | None
    #: When the first tick and the current tick began, seconds.
    started: float
    tick_started: float

    def at(self, episode: int, tick: int) -> bool:
        """Whether a message of this episode number and tick is one of the current tick."""
        return episode == self.request.episode and tick == self.episode.simulator.tick


@dataclass(frozen=True)
class EpisodeEnd:
    """How a goal ended."""

    episode: int
    error: str = ""
    #: The state at the end; None if there was no tick.
    last: Ticking | None = None
    #: Wall time of all ticks, seconds.
    elapsed: float = 0.0

    @property
    def cancelled(self) -> bool:
        """The client asked for the end."""
        return self.error == CANCELLED
