# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A running team as a source for the page: subscribes to its topics, and publishes nothing."""

import threading
import time
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from magat_interfaces.msg import Observation, Preference, RobotStatus, World
from magat_node import cdr
from magat_node.errors import UnusableMessageError
from magat_node.intake import Intake, PolledSubscription
from magat_node.status_check import status_fault
from magat_node.topics import FEATURE, HEARD, OBSERVATION, PREFERENCE, ROBOT_STATUS, WORLD, Topic
from magat_recording.world_check import fault
from magat_robot.policy.backends import load_computed
from magat_robot.policy.computed import ComputedPolicy
from magat_robot.policy.config import OBSERVATION_SHAPE, ModelError
from magat_viewer.detail import RobotDetail, RobotTick, TeamSnapshot, TickOutcome, robot_detail
from magat_viewer.health import HealthReport, TeamHealth
from magat_viewer.watched_episode import EpisodeResult, Scene, WatchedEpisode

#: Why a policy is not known yet; both last a moment.
_NO_STATUS, _LOADING = "no robot has reported its policy yet", "the policy is being loaded"
#: Episodes whose results are kept.
_RESULTS = 50
#: Ticks whose messages are kept while a robot is chosen: more than pass between two looks at it.
_TICKS = 32
#: Frames that are kept for browsers: those of 1/30 s (`magat_viewer.server.PERIOD`) at 480 ticks/s.
_FRAMES = 16
#: Messages that the middleware queues between two polls: those of 1/30 s of any team that one machine runs.
_DEPTH, _SHARED_DEPTH = 100, 2000


@dataclass
class _ChosenRobot:
    """The topics of a robot that browsers look at."""

    #: Of its observations and, if the radio is relayed and they are needed, its bundles.
    subscriptions: list[PolledSubscription]
    #: The newest messages; bundles are serialised.
    observations: deque[Observation] = field(default_factory=lambda: deque(maxlen=_TICKS))
    bundles: deque[bytes] = field(default_factory=lambda: deque(maxlen=_TICKS))


class LiveTeam:
    """The team of a namespace as a `magat_viewer.source.Source`.

    It always subscribes to worlds and statuses, to the observations of chosen robots, and to features and preferences
    only while the world alone does not tell what these robots received (see `magat_viewer.detail`).
    """

    live = True

    def __init__(
        self, context: Context, find_policy: Callable[[str], Path | None], namespace: str | None = None
    ) -> None:
        """Subscribe to the team.

        Args:
            context: of ROS.
            find_policy: returns the folder of the policy with a given digest; None if there is none.
            namespace: of the team; that of the command line if None.
        """
        # No executor spins this node: `poll` takes the messages, at half the cost of a callback for each.
        self.node: Node = rclpy.create_node(
            "viewer", context=context, namespace=namespace, start_parameter_services=False
        )
        self._find_policy = find_policy
        self.title = f"team {self.node.get_namespace()}, live"
        self._world = self._subscribe(WORLD, _DEPTH)
        self._status = self._subscribe(ROBOT_STATUS, _SHARED_DEPTH)
        #: Preferences and, if the radio is direct, features; empty while they are not needed.
        self._shared: list[PolledSubscription] = []
        #: Whether features and preferences are needed to know what the chosen robots received.
        self._needs_messages = False
        self._chosen: dict[str, _ChosenRobot] = {}
        self._preferences: deque[bytes] = deque()
        self._preference_intake = Intake(self.node, Preference, PREFERENCE.name())
        self._features: deque[bytes] = deque()
        self._worlds: deque[World] = deque(maxlen=_TICKS)
        self._frames: deque[tuple[int, bytes]] = deque(maxlen=_FRAMES)
        self._episode: WatchedEpisode | None = None
        self._results: list[EpisodeResult] = []
        self._health = TeamHealth()
        self._policies: dict[str, ComputedPolicy | str] = {}

    def _subscribe(self, topic: Topic, depth: int, robot: str = "") -> PolledSubscription:
        return topic.polled(self.node, robot, depth)

    def destroy(self) -> None:
        """End all subscriptions."""
        self.node.destroy_node()

    # --- Source ---

    def poll(self, chosen: Collection[int]) -> None:
        """Take the messages that have arrived."""
        now = time.monotonic()
        # Worlds first: the messages that led to a world have arrived before it.
        self._world.take(self._add_world)
        self._status.take(lambda status: self._add_status(status, now))
        if self._episode is not None:
            robots = self._episode.robots
            self._update_subscriptions(robots, {robots[number] for number in chosen if number < len(robots)})
        for subscription, kept in zip(self._shared, (self._preferences, self._features), strict=False):
            kept.extend(subscription.take_serialized())
        for robot in self._chosen.values():
            observations, *bundles = robot.subscriptions
            observations.take(robot.observations.append)
            for subscription in bundles:
                robot.bundles.extend(subscription.take_serialized())

    @property
    def newest(self) -> int:
        """Number of the newest episode; -1 before the first one."""
        return -1 if self._episode is None else self._episode.number

    def results(self) -> list[EpisodeResult]:
        """The results of the last episodes, including the running one."""
        return self._results

    def scene(self, episode: int) -> Scene:
        """What does not change during the newest episode."""
        assert self._episode is not None
        return self._episode.scene()

    def frames(self, episode: int, after: int) -> tuple[int, bytes]:
        """The newest frames only: a browser that is slower than the ticks skips some, and never falls behind."""
        assert self._episode is not None
        return self._episode.tick, b"".join(frame for tick, frame in self._frames if tick > after)

    def health(self, episode: int) -> HealthReport:
        """The health of the team's processes now."""
        assert self._episode is not None
        return self._health.report(self._episode.robots, self._episode.silences.tolist(), time.monotonic())

    def detail(self, episode: int, tick: int, robot: int) -> RobotDetail | None:
        """The detail of a chosen robot at the newest tick that is over and whose messages are known; else None."""
        watched = self._episode
        if watched is None or robot >= len(watched.robots) or (name := watched.robots[robot]) not in self._chosen:
            return None
        worlds = {world.tick: world for world in self._worlds}
        for observation in reversed(self._chosen[name].observations):
            at = observation.tick
            if observation.episode != watched.id or not {at, at + 1} <= worlds.keys() or not _valid(observation):
                continue
            world, after = worlds[at], worlds[at + 1]
            positions = np.stack([world.x, world.y], axis=1).astype(np.int64)
            snapshot = TeamSnapshot(at, positions, watched.goals, watched.obstacles)
            outcome = TickOutcome(after.silent[robot], after.missing[robot], after.action[robot])
            found = robot_detail(robot, snapshot, self._robot_tick(name, observation, outcome), self._policy(name))
            temporary = found.no_attention in (_NO_STATUS, _LOADING)
            self._needs_messages |= found.probabilities is None and not outcome.silent and not temporary
            return found
        return None

    # --- Topics ---

    def _add_status(self, status: RobotStatus, now: float) -> None:
        wrong = status_fault(status)
        if wrong is not None:
            raise UnusableMessageError(f"a status in which {wrong}")
        self._health.add_status(status, now)

    def _add_world(self, world: World) -> None:
        wrong = fault(world)
        if wrong is not None:
            raise UnusableMessageError(f"a world in which {wrong}")
        if self._episode is None or not self._episode.holds(world):
            # Without a map, messages were needed. The new episode has one.
            self._needs_messages &= self._episode is not None and self._episode.obstacles is not None
            self._episode = WatchedEpisode(self.newest + 1, world)
            self._worlds.clear()
            self._frames.clear()
            self._results = [*self._results[-_RESULTS:], self._episode.result()]
        else:
            self._episode.step(world)
        self._worlds.append(world)
        self._frames.append((self._episode.tick, self._episode.frame()))
        if self._episode.ended:
            self._results = [*self._results[:-1], self._episode.result()]

    def _update_subscriptions(self, robots: list[str], chosen: set[str]) -> None:
        """Subscribe to the observations of ``chosen`` and, if needed, to the features and preferences of ``robots``."""
        status = self._health.status_of(robots[0])
        relayed = status is not None and status.radio == "relayed"
        self._needs_messages &= bool(chosen)
        for name in self._chosen.keys() - chosen:
            self._unsubscribe(self._chosen.pop(name).subscriptions)
        for name in chosen - self._chosen.keys():
            self._chosen[name] = _ChosenRobot([self._subscribe(OBSERVATION, _DEPTH, name)])
        if self._needs_messages and relayed:
            for name, robot in self._chosen.items():
                if len(robot.subscriptions) == 1:
                    robot.subscriptions.append(self._subscribe(HEARD, _DEPTH, name))
        if self._needs_messages and not self._shared:
            most = _TICKS * len(robots)
            self._preferences, self._features = deque(maxlen=most), deque(maxlen=most)
            self._shared = [self._subscribe(PREFERENCE, _SHARED_DEPTH)]
            if not relayed:
                self._shared.append(self._subscribe(FEATURE, _SHARED_DEPTH))
        elif not self._needs_messages and self._shared:
            bundles = [robot.subscriptions.pop() for robot in self._chosen.values() if len(robot.subscriptions) > 1]
            self._unsubscribe([*self._shared, *bundles])
            self._shared = []

    def _unsubscribe(self, subscriptions: list[PolledSubscription]) -> None:
        for polled in subscriptions:
            self.node.destroy_subscription(polled.subscription)

    def _robot_tick(self, name: str, observation: Observation, outcome: TickOutcome) -> RobotTick:
        """The messages to and from a chosen robot in the first round of a tick, as far as they are known."""
        key, audible = (observation.episode, observation.tick, 0), set(observation.audible_tags)
        by_tag = {
            feature.tag: feature.payload
            for feature in map(cdr.unpack_feature, self._features)
            if feature is not None and feature[:3] == key and feature.tag in audible
        }
        payloads = list(by_tag.values())
        for bundle in map(cdr.unpack_bundle, self._chosen[name].bundles):
            if bundle is not None and bundle[:3] == key and bundle.messages:
                payloads = bundle.split()
        preference = self._preference(observation)
        complete = preference is not None and len(payloads) >= preference.heard
        status = self._health.status_of(name)
        return RobotTick(
            field_of_view=np.frombuffer(observation.field_of_view, dtype=np.uint8).reshape(OBSERVATION_SHAPE),
            audible=len(audible),
            stream=observation.stream,
            payloads=payloads if complete else None,
            encoding=status.encoding if status else "",
            preference=preference,
            outcome=outcome,
        )

    def _preference(self, observation: Observation) -> Preference | None:
        """The preference with the tag of an observation; only messages that contain its bytes are deserialised."""
        tag = observation.own_tag.to_bytes(8, "little")
        for data in self._preferences:
            if tag in data:
                found = self._preference_intake.read(data)
                if found is not None and (found.episode, found.tick, found.tag) == (
                    observation.episode,
                    observation.tick,
                    observation.own_tag,
                ):
                    return found
        return None

    # --- Policies ---

    def _policy(self, robot: str) -> ComputedPolicy | str:
        """The policy of ``robot``, or the reason why it is not known (yet)."""
        status = self._health.status_of(robot)
        if status is None:
            return _NO_STATUS
        if status.digest not in self._policies:
            self._policies[status.digest] = _LOADING
            # Loading takes a while, seconds where torch has to be imported. The page goes on meanwhile.
            threading.Thread(target=self._load, args=(status,), daemon=True).start()
        return self._policies[status.digest]

    def _load(self, status: RobotStatus) -> None:
        folder = self._find_policy(status.digest)
        try:
            self._policies[status.digest] = (
                f"there is no policy {status.policy} ({status.digest[:12]}) in the folders of models"
                if folder is None
                else load_computed(folder)
            )
        except ModelError as error:
            self._policies[status.digest] = str(error)


def _valid(observation: Observation) -> bool:
    """Whether it is a robot's observation in a tick: neither a hello nor damaged."""
    view = np.frombuffer(observation.field_of_view, dtype=np.uint8)
    return observation.tick != Observation.HELLO and view.size == np.prod(OBSERVATION_SHAPE) and bool((view <= 1).all())
