# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The server of episodes on a team: gather the robots, ask the expert, tick until the end. Free of ROS.

It is a state machine; the states are in `magat_sim.episode_states`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, TypeVar

from magat_node.cdr import PackedFeature
from magat_node.unpredictable import shuffled
from magat_sim.case import Case
from magat_sim.constants import T_MAX_FACTOR
from magat_sim.episode_states import (
    CANCELLED,
    NO_MAKESPAN,
    AwaitingExpert,
    EpisodeEnd,
    EpisodeRequest,
    ExpertPlan,
    Gathering,
    Goal,
    Idle,
    Progress,
    Ticking,
)
from magat_sim.relay import Bundle
from magat_sim.simulator import Rules
from magat_sim.streams import episode_streams
from magat_sim.team import Team
from magat_sim.ticks import DistributedEpisode, Outcome, ReceivedPreference, RobotObservation

#: How long the expert's answer may take beyond the time limit of its search, seconds.
EXPERT_GRACE = 2.0
#: Warnings of one kind are logged at most once in this time, seconds.
_THROTTLE = 5.0

T = TypeVar("T")


class Deadline(Protocol):
    """A timer that is stopped until `reset`; rclpy's Timer is one."""

    timer_period_ns: int

    def reset(self) -> None:
        """Start, or start again from now."""

    def cancel(self) -> None:
        """Stop."""

    def is_canceled(self) -> bool:
        """Whether it is stopped."""


class Log(Protocol):
    """What the server needs of rclpy's logger."""

    def info(self, message: str) -> bool:
        """Log a message."""

    def warning(self, message: str, **options: float) -> bool:
        """Log a warning; ``throttle_duration_sec`` limits how often."""


class Surroundings(Protocol):
    """What an episode needs from the node: the expert and the team's topics."""

    def expert_ready(self) -> bool:
        """The expert can be asked."""

    def deploying(self) -> bool:
        """A deployment is under way, for which the next episode has to wait."""

    def ask_expert(self, case: Case, w: float) -> object:
        """Ask for a solution of bound ``w``; returns the search, whose answer goes to `EpisodeServer.solved`."""

    def abandon(self, search: object) -> None:
        """Wait no longer for the answer of a search."""

    def send_observations(self, episode: int, tick: int, observations: Sequence[tuple[int, RobotObservation]]) -> None:
        """Send observations to robots, by their indices, in this order."""

    def send_bundles(self, episode: int, tick: int, number: int, bundles: Sequence[tuple[int, Bundle]]) -> None:
        """Send the bundles of round ``number`` to robots, by their indices, in this order."""

    def publish_world(self, state: Ticking, outcome: Outcome | None, seconds: float) -> None:
        """Publish the world after a tick that took ``seconds``; without an outcome at the start."""


@dataclass(frozen=True)
class EpisodeLimits:
    """Patience of the server, in seconds."""

    #: For the team and the expert before an episode.
    ready_timeout: float
    #: For the expert's search.
    expert_time_limit: float
    #: For the messages of a tick, in all its rounds, where the simulator relays them.
    relay_deadline: float


@dataclass
class EpisodeServer:
    """Runs one episode at a time for a `Goal`."""

    team: Team
    #: The simulator's radio, ``direct`` or ``relayed``.
    radio: str
    rules: Rules
    limits: EpisodeLimits
    surroundings: Surroundings
    #: Ends the wait for preferences; calls `end_tick`.
    tick_deadline: Deadline
    #: Ends the wait for messages to relay; calls `end_round`.
    relay_deadline: Deadline
    log: Log
    #: The time, seconds; never goes back.
    clock: Callable[[], float]
    state: Idle | Gathering | AwaitingExpert | Ticking = field(default_factory=Idle)

    @property
    def idle(self) -> bool:
        """There is no goal: rules, limits and deadlines may be set."""
        return isinstance(self.state, Idle)

    @property
    def between_episodes(self) -> bool:
        """The team may be given another policy."""
        return isinstance(self.state, Idle | Gathering)

    def begin(self, goal: Goal, request: EpisodeRequest) -> None:
        """Serve ``goal``; the server must be idle."""
        self._gather(Gathering(goal, request, self.clock()))

    def refuse(self, goal: Goal, episode: int, why: str) -> None:
        """Abort a goal that cannot be served because of ``why``."""
        end = EpisodeEnd(episode, why)
        self._log_end(end)
        goal.abort(end)

    def stop(self, why: str) -> bool:
        """Abort the goal, if there is one, because of ``why``; returns whether there was one."""
        match self.state:
            case Gathering(goal, request) | AwaitingExpert(Gathering(goal, request)):
                self._end(goal.abort, EpisodeEnd(request.episode, why))
            case Ticking():
                self._end_episode(self.state, self.state.goal.abort, why)
            case Idle():
                return False
        return True

    def beat(self) -> None:
        """Go on with an episode that waits; to be called several times a second."""
        match self.state:
            case Gathering():
                self._gather(self.state)
            case AwaitingExpert():
                self._await_expert(self.state)

    # --- Before the first tick ---

    def _gather(self, state: Gathering) -> None:
        self.state, now = state, self.clock()
        goal, request = state.goal, state.request
        if goal.cancel_requested:
            self._end(goal.cancel, EpisodeEnd(request.episode, CANCELLED))
            return
        if self.surroundings.deploying():
            self.state = replace(state, begun=now)
            self._feed_back(goal)
            return
        missing = self.team.gather(now)
        expert = self.surroundings.expert_ready() or request.t_max > 0
        if not missing and expert:
            mismatch = self.team.mismatch(self.radio)
            if mismatch is not None:
                self._end(goal.abort, EpisodeEnd(request.episode, mismatch))
            elif self.surroundings.expert_ready():
                search = self.surroundings.ask_expert(request.case, request.expert_w)
                self.state = AwaitingExpert(state, search, self.clock())
            else:
                self._start(state, None, "there is none")
        elif now - state.begun > self.limits.ready_timeout:
            absent = [*missing, *([] if expert else ["the expert"])]
            mismatch = self.team.mismatch(self.radio)  # among those that have reported; it may be the reason
            why = f"; {mismatch}" if mismatch is not None else ""
            error = f"not there after {self.limits.ready_timeout:g} s: {', '.join(absent)}{why}"
            self._end(goal.abort, EpisodeEnd(request.episode, error))
        else:
            self._feed_back(goal)

    def _await_expert(self, state: AwaitingExpert) -> None:
        """Give up a search whose answer is overdue: the expert may have died."""
        goal, request, begun = state.gathered.goal, state.gathered.request, state.gathered.begun
        now, limit = self.clock(), self.limits.expert_time_limit + EXPERT_GRACE
        if not goal.cancel_requested and now - state.asked < limit:
            self._feed_back(goal)
            return
        self.surroundings.abandon(state.search)
        if goal.cancel_requested:
            self._end(goal.cancel, EpisodeEnd(request.episode, CANCELLED))
        elif request.t_max > 0:
            self._start(state.gathered, None, "it did not answer")
        elif now - begun > self.limits.ready_timeout:
            error = f"the expert did not answer within {limit:g} s: is it alive, or busy with others?"
            self._end(goal.abort, EpisodeEnd(request.episode, error))
        else:
            self.log.warning(f"the expert did not answer within {limit:g} s: it is asked again")
            self.state = state.gathered

    def solved(self, search: object, plan: ExpertPlan | None, why: str = "") -> None:
        """Take the expert's answer to a search: a plan, or why there is none."""
        if isinstance(self.state, AwaitingExpert) and search == self.state.search:  # else it was abandoned
            self._start(self.state.gathered, plan, why)

    def _start(self, gathered: Gathering, plan: ExpertPlan | None, why: str) -> None:
        """Begin the first tick, with the expert's plan if there is one."""
        goal, request = gathered.goal, gathered.request
        if plan is None and request.t_max == 0:
            error = f"{NO_MAKESPAN} ({why}): set t_max, or take another case"
            self._end(goal.abort, EpisodeEnd(request.episode, error))
            return
        t_max = request.t_max or (T_MAX_FACTOR * plan.makespan if plan is not None else 0)
        streams = episode_streams(request.seed, request.number, request.case.robots, request.secret)
        episode = DistributedEpisode(request.case, t_max, streams, self.rules)
        # A tick takes no longer with many rounds than with one.
        rounds = self.team.equipment.rounds if self.team.equipment is not None else 1
        self.relay_deadline.timer_period_ns = int(1e9 * self.limits.relay_deadline / max(rounds, 1))
        now = self.clock()
        state = Ticking(goal, request, episode, plan.flowtime if plan is not None else None, now, now)
        self.state = state
        height, width = request.case.obstacles.shape
        self.log.info(
            f"episode {request.episode} begins: {request.case.robots} robots on {width}x{height} cells, T_max {t_max}"
        )
        self.surroundings.publish_world(state, None, 0.0)
        if episode.simulator.done:
            self._end_episode(state, goal.succeed)
        else:
            self._begin_tick(state)

    # --- A tick ---

    def _begin_tick(self, state: Ticking) -> None:
        now = self.clock()
        self.state = state = replace(state, tick_started=now)
        for name in self.team.readmit(now):
            self.log.info(f"{name} is back")
        strangers = self.team.strangers()
        if strangers:
            self.log.warning(
                f"{', '.join(strangers)}: with another policy, encoding or radio than the team's, and takes no part",
                throttle_duration_sec=_THROTTLE,
            )
        joined = [member.joined for member in self.team.members]
        observations = state.episode.look(joined)
        self.surroundings.send_observations(
            state.request.episode, state.episode.simulator.tick, self._in_random_order(observations)
        )
        self.tick_deadline.reset()

    def take_feature(self, feature: PackedFeature) -> None:
        """Take a robot's message that is to be relayed; one of another tick is late and ignored."""
        state = self.state
        if not isinstance(state, Ticking) or not state.at(feature.episode, feature.tick):
            return
        relay = state.episode.relay
        why = relay.receive(feature.round, feature.tag, feature.encoding, feature.payload)
        if why is not None:
            self.log.warning(f"dropped {why}", throttle_duration_sec=_THROTTLE)
        elif relay.complete:
            self.end_round()
        elif self.relay_deadline.is_canceled():
            self.relay_deadline.reset()

    def end_round(self) -> None:
        """Relay what has come in this round: all of it has, or the relay deadline has passed."""
        state = self.state
        if not isinstance(state, Ticking):
            return
        number, bundles = state.episode.relay.round, state.episode.relayed()
        self.surroundings.send_bundles(
            state.request.episode, state.episode.simulator.tick, number, self._in_random_order(bundles)
        )
        self.relay_deadline.cancel()  # until the first message of the next round

    def _in_random_order(self, messages: Sequence[T]) -> list[tuple[int, T]]:
        """Those of ``[N]`` messages whose robots take part, with the robots' indices.

        Robots answer in about the order in which they are sent something, so a fixed order would show in the arrival of
        their features.
        """
        return shuffled((i, messages[i]) for i, member in enumerate(self.team.members) if member.joined)

    def take_preference(self, episode: int, tick: int, tag: int, preference: ReceivedPreference) -> None:
        """Take a robot's preference; one of another tick is late and ignored: it was counted as silence."""
        state = self.state
        if not isinstance(state, Ticking) or not state.at(episode, tick):
            return
        why = state.episode.answer(tag, preference)
        if why is not None:
            self.log.warning(f"dropped {why}", throttle_duration_sec=_THROTTLE)
        elif all(there or not m.joined for there, m in zip(state.episode.answered, self.team.members, strict=True)):
            self.end_tick()

    def end_tick(self) -> None:
        """Move the robots: all preferences have come, or the tick deadline has passed."""
        self.tick_deadline.cancel()
        state = self.state
        if not isinstance(state, Ticking):
            return
        self.relay_deadline.cancel()
        outcome = state.episode.advance()
        for name in self.team.account((~outcome.silent).tolist()):
            self.log.warning(f"{name} is absent: it stays where it is until it answers again")
        self.surroundings.publish_world(state, outcome, self.clock() - state.tick_started)
        self._feed_back(state.goal, state)
        if state.episode.simulator.done:
            self._end_episode(state, state.goal.succeed)
        elif state.goal.cancel_requested:
            self._end_episode(state, state.goal.cancel, CANCELLED)
        else:
            self._begin_tick(state)

    # --- The goal ---

    def _feed_back(self, goal: Goal, ticking: Ticking | None = None) -> None:
        joined = sum(member.joined for member in self.team.members)
        if ticking is None:
            goal.feed_back(Progress(0, 0, 0, 0, joined))
        else:
            simulator = ticking.episode.simulator
            arrived, on_goal = int(simulator.visited.sum()), int(simulator.on_goal.sum())
            goal.feed_back(Progress(simulator.tick, int(simulator.t_max[0]), arrived, on_goal, joined))

    def _end_episode(self, state: Ticking, how: Callable[[EpisodeEnd], None], error: str = "") -> None:
        self._end(how, EpisodeEnd(state.request.episode, error, state, self.clock() - state.started))

    def _end(self, how: Callable[[EpisodeEnd], None], end: EpisodeEnd) -> None:
        self.tick_deadline.cancel()
        self.relay_deadline.cancel()
        self.state = Idle()
        self._log_end(end)
        how(end)

    def _log_end(self, end: EpisodeEnd) -> None:
        after = ""
        if end.last is not None:
            simulator = end.last.episode.simulator
            arrived = f"{int(simulator.visited.sum())} of {end.last.request.case.robots} robots arrived"
            after = f" after {simulator.tick} of {int(simulator.t_max[0])} ticks, {arrived}"
        if end.cancelled:
            self.log.info(f"episode {end.episode} was cancelled{after}")
        elif end.error:
            self.log.warning(f"episode {end.episode} was aborted{after}: {end.error}")
        else:
            self.log.info(f"episode {end.episode} ended{after}")
