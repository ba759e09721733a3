"""A team that runs, from its topics: one that any tool may listen to, and says nothing itself."""

import threading
import time
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from magat_interfaces.msg import Feature, FeatureBundle, Observation, Preference, RobotStatus, World
from magat_node import cdr, qos
from magat_robot.policy.config import OBSERVATION_SHAPE, ModelError
from magat_viewer.detail import RobotTick, TeamSnapshot, TickOutcome, detail
from magat_viewer.health import Health
from magat_viewer.watched_episode import WatchedEpisode
from magat_viewer.world_check import fault

if TYPE_CHECKING:
    from magat_robot.policy.policy import Policy

#: Why a policy is not known yet, but will be in a moment.
_UNSAID, _LOADING = "no robot has said yet which policy it carries", "the policy is being loaded"
#: Episodes whose results are kept.
_RESULTS = 50
#: Ticks of which is kept what was said, while a robot is looked at: more than pass between two looks.
_TICKS = 32
#: Frames that are kept for browsers: those of a thirtieth of a second of a team that makes 480 ticks in one.
_FRAMES = 16
#: Messages that the middleware keeps until the next look: a thirtieth of a second of any team that one machine runs.
_DEPTH, _SHARED_DEPTH = 100, 2000


@dataclass
class _Ear:
    """What is heard of one robot that people look at."""

    subscriptions: list[Subscription]
    #: The newest, as they came.
    observations: deque[bytes] = field(default_factory=lambda: deque(maxlen=_TICKS))
    bundles: deque[bytes] = field(default_factory=lambda: deque(maxlen=_TICKS))


class LiveTeam:
    """The team of a namespace, a `Source`. No robot and no simulator notices whether anybody looks.

    Worlds and statuses are heard always; what robots are told, only while people look at them; and what robots say and
    answer, only while that is needed to know what those state (see `magat_viewer.detail`).
    """

    live = True

    def __init__(
        self, context: Context, find_policy: Callable[[str], Path | None], namespace: str | None = None
    ) -> None:
        """Listen.

        Args:
            context: of ROS.
            find_policy: the folder of the policy whose weights have a digest; None if there is none.
            namespace: of the team; that of the command line if None.
        """
        # Messages are taken when they are needed: an executor would call back for each, at twice the cost.
        self.node: Node = rclpy.create_node(
            "viewer", context=context, namespace=namespace, start_parameter_services=False
        )
        self._find_policy = find_policy
        self.title = f"team {self.node.get_namespace()}, live"
        self._world = self._listen(World, "world", qos.reliable(_DEPTH))
        self._status = self._listen(RobotStatus, "robot_status", qos.reliable(_SHARED_DEPTH))
        self._talk: list[Subscription] = []
        #: Whether what robots say and answer has to be heard, to know what the chosen ones state.
        self._closely = False
        self._ears: dict[str, _Ear] = {}
        self._said: deque[bytes] = deque()
        self._wished: deque[bytes] = deque()
        self._worlds: deque[World] = deque(maxlen=_TICKS)
        self._frames: deque[tuple[int, bytes]] = deque(maxlen=_FRAMES)
        self._episode: WatchedEpisode | None = None
        self._results: list[dict[str, Any]] = []
        self._health = Health()
        self._policies: dict[str, Policy | str] = {}

    def _listen(self, kind: type, name: str, profile: QoSProfile) -> Subscription:
        return self.node.create_subscription(kind, name, lambda _: None, profile)

    def destroy(self) -> None:
        """Listen no longer."""
        self.node.destroy_node()

    # --- Source ---

    def poll(self, chosen: Collection[int]) -> None:
        """Take what has come."""
        now = time.monotonic()
        # Worlds first: what led to one has come before it.
        for world in _taken(self._world, World):
            self._step(world)
        for status in _taken(self._status, RobotStatus):
            self._health.reported(status, now)
        if self._episode is not None:
            robots = self._episode.robots
            self._choose(robots, {robots[number] for number in chosen if number < len(robots)})
        for subscription, kept in zip(self._talk, (self._wished, self._said), strict=False):
            kept.extend(_raw(subscription))
        for ear in self._ears.values():
            observations, *bundles = ear.subscriptions
            ear.observations.extend(_raw(observations))
            for subscription in bundles:
                ear.bundles.extend(_raw(subscription))

    @property
    def newest(self) -> int:
        """Number of the newest episode; -1 before the first one."""
        return -1 if self._episode is None else self._episode.number

    def results(self) -> list[dict[str, Any]]:
        """Of the last episodes, and the one that runs."""
        return self._results

    def scene(self, episode: int) -> dict[str, Any]:
        """What stays of the newest episode."""
        assert self._episode is not None
        return self._episode.scene()

    def frames(self, episode: int, after: int) -> tuple[int, bytes]:
        """The newest few: who is slower than the ticks misses some, and is never behind."""
        assert self._episode is not None
        return self._episode.tick, b"".join(frame for tick, frame in self._frames if tick > after)

    def health(self, episode: int) -> dict[str, Any]:
        """How the processes of the team are, now."""
        assert self._episode is not None
        return self._health.report(self._episode.robots, self._episode.silences.tolist(), time.monotonic())

    def detail(self, episode: int, tick: int, robot: int) -> dict[str, Any] | None:
        """Of the newest tick that is over and was heard; None before one is."""
        state = self._episode
        if state is None or robot >= len(state.robots) or (name := state.robots[robot]) not in self._ears:
            return None
        worlds = {world.tick: world for world in self._worlds}
        for data in reversed(self._ears[name].observations):
            told = deserialize_message(data, Observation)
            if told.episode == state.id and told.tick in worlds and told.tick + 1 in worlds and _usable(told):
                world, after = worlds[told.tick], worlds[told.tick + 1]
                positions = np.stack([world.x, world.y], axis=1).astype(np.int64)
                moment = TeamSnapshot(told.tick, positions, state.goals, state.obstacles)
                fate = TickOutcome(after.silent[robot], after.missing[robot], after.action[robot], told.stream)
                found = detail(robot, moment, self._heard(name, told, fate), self._policy(name))
                soon = found["why"] in (_UNSAID, _LOADING)
                self._closely |= found["probabilities"] is None and not fate.silent and not soon
                return found
        return None

    # --- Topics ---

    def _step(self, world: World) -> None:
        if fault(world) is not None:
            return
        if self._episode is None or not self._episode.holds(world):
            # Without a map nothing can be computed again, and this one brings its own.
            self._closely &= self._episode is not None and self._episode.obstacles is not None
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

    def _choose(self, robots: list[str], chosen: set[str]) -> None:
        """Listen to what those of ``robots`` are told, and to what all say and answer if it has to be."""
        status = self._health.status_of(robots[0])
        relayed = status is not None and status.radio == "relayed"
        self._closely &= bool(chosen)
        for name in self._ears.keys() - chosen:
            for subscription in self._ears.pop(name).subscriptions:
                self.node.destroy_subscription(subscription)
        for name in chosen - self._ears.keys():
            self._ears[name] = _Ear([self._listen(Observation, f"{name}/observation", qos.newest(_DEPTH))])
        if self._closely and relayed:
            for name, ear in self._ears.items():
                if len(ear.subscriptions) == 1:
                    ear.subscriptions.append(self._listen(FeatureBundle, f"{name}/heard", qos.newest(_DEPTH)))
        if self._closely and not self._talk:
            most = _TICKS * len(robots)
            self._wished, self._said = deque(maxlen=most), deque(maxlen=most)
            self._talk = [self._listen(Preference, "preference", qos.newest(_SHARED_DEPTH))]
            if not relayed:
                self._talk.append(self._listen(Feature, "feature", qos.newest(_SHARED_DEPTH)))
        elif not self._closely and self._talk:
            bundles = [ear.subscriptions.pop() for ear in self._ears.values() if len(ear.subscriptions) > 1]
            for subscription in (*self._talk, *bundles):
                self.node.destroy_subscription(subscription)
            self._talk = []

    def _heard(self, robot: str, told: Observation, fate: TickOutcome) -> RobotTick:
        """What one robot heard in the first round of a tick, and what it answered, as far as it is listened to."""
        at, audible = (told.episode, told.tick, 0), set(told.audible_tags)
        ear, status = self._ears[robot], self._health.status_of(robot)
        by_tag = {
            feature.tag: feature.payload
            for feature in map(cdr.unpack_feature, self._said)
            if feature is not None and feature[:3] == at and feature.tag in audible
        }
        payloads = list(by_tag.values())
        for bundle in map(cdr.unpack_bundle, ear.bundles):
            if bundle is not None and bundle[:3] == at and bundle.messages:
                size = len(bundle.payloads) // bundle.messages
                payloads = [bundle.payloads[size * i : size * (i + 1)] for i in range(bundle.messages)]
        answer = self._answer(told)
        all_came = answer is not None and len(payloads) >= answer.heard
        view = np.frombuffer(told.field_of_view, dtype=np.uint8).reshape(OBSERVATION_SHAPE)
        encoding = status.encoding if status else ""
        return RobotTick(view, len(audible), payloads if all_came else None, encoding, answer, fate)

    def _answer(self, told: Observation) -> Preference | None:
        """The preference under the tag of an observation; only messages that hold its bytes are made objects of."""
        tag = told.own_tag.to_bytes(8, "little")
        for data in self._wished:
            if tag in data:
                wish = deserialize_message(data, Preference)
                if (wish.episode, wish.tick, wish.tag) == (told.episode, told.tick, told.own_tag):
                    return wish
        return None

    def _policy(self, robot: str) -> "Policy | str":
        """The policy that ``robot`` carries, or why it is not known (yet)."""
        status = self._health.status_of(robot)
        if status is None:
            return _UNSAID
        if status.digest not in self._policies:
            self._policies[status.digest] = _LOADING
            # It takes seconds, torch's import most of them, in which the page goes on.
            threading.Thread(target=self._load, args=(status,), daemon=True).start()
        return self._policies[status.digest]

    def _load(self, status: RobotStatus) -> None:
        import torch

        from magat_robot.policy.store import load

        torch.set_num_threads(1)  # what one robot computes is small: threads would only wait for each other
        folder = self._find_policy(status.digest)
        try:
            self._policies[status.digest] = (
                f"there is no policy {status.policy} ({status.digest[:12]}) in the folders of models"
                if folder is None
                else load(folder)
            )
        except ModelError as error:
            self._policies[status.digest] = str(error)


def _usable(told: Observation) -> bool:
    """Not a hello, nor damaged."""
    view = np.frombuffer(told.field_of_view, dtype=np.uint8)
    return told.tick != Observation.HELLO and view.size == np.prod(OBSERVATION_SHAPE) and bool((view <= 1).all())


def _taken(subscription: Subscription, kind: type) -> list[Any]:
    """The messages that have come."""
    return [deserialize_message(data, kind) for data in _raw(subscription)]


def _raw(subscription: Subscription) -> list[bytes]:
    """The same as they came over the wire."""
    found, handle = [], subscription.handle
    with handle:
        while (taken := handle.take_message(subscription.msg_type, True)) is not None:
            found.append(taken[0])
    return found
