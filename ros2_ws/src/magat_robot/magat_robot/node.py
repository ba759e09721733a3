# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ROS node of the robots in one process: translates between ROS messages and `Crew` and `PolicySlot`."""

import functools
import math
import secrets
import struct
import sys
import time
from pathlib import Path

from magat_node.imports import quiet_imports

with quiet_imports():
    from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

    from magat_interfaces.msg import Deployment, Observation, Preference, RobotStatus
    from magat_node import cdr, topics
    from magat_node.parameters import (
        SettableParameters,
        declare_choice,
        declare_count,
        declare_seconds,
        declare_value,
    )
    from magat_node.run import run_node
    from magat_robot.crew import Answer, Crew, Message, ReceivedObservation
    from magat_robot.policy.backends import load_policy
    from magat_robot.policy.config import BACKENDS, ENCODINGS, MAX_SIZE, ModelError
    from magat_robot.policy.folder import read_temperature
    from magat_robot.policy.payload import encoded_bytes, round_bytes
    from magat_robot.policy_slot import PolicySlot

#: Seconds between two statuses while waiting, and between two hellos in a small team.
HELLO_PERIOD = 0.2
#: P processes receive P^2 hellos in a period. In teams of more processes than this, the period is longer.
HELLO_PROCESSES = 32
#: A peer counts as heard for this many periods after its hello.
HELLO_VALID = 10
#: The robots are waiting again when there was no observation for this long, seconds.
SILENCE = 1.0
#: While the robots run, the status is sent every this many periods.
STATUS_EVERY = 10

_COUNT = struct.Struct("<I")
_MAX_UINT32 = 2**32 - 1
#: Upper limit of the parameter max_payload, bytes.
_MAX_PAYLOAD = encoded_bytes(MAX_SIZE, "float32")


class RobotNode(LifecycleNode):
    """The node of one robot, or of a crew: several robots in one process.

    In a tick a robot receives its Observation, sends a Feature in each round, receives the Features of the robots in
    range, and sends a Preference. The node's namespace is the name of the robot. For a crew, the parameter ``robots``
    lists the names, and the namespace is one of them.

    It is a lifecycle node: configuring loads the policy, and an active node takes part in the team. Unless the
    parameter ``autostart`` is false, the node configures and activates itself when it is created.
    """

    def __init__(self, **options: object) -> None:
        """Declare the parameters, and join the team if ``autostart`` is true.

        Raises:
            ModelError: the policy cannot be used, or no policy is given.
            ValueError: a robot is named twice, the namespace is not the name of any of the robots, or a parameter has
                an invalid value.
        """
        super().__init__("robot", **options)
        self._folder = declare_value(self, "policy", "", "folder of the policy")
        encoding = declare_choice(
            self, "encoding", "", ["", *ENCODINGS], "encoding of messages; the policy's own if empty", fixed=False
        )
        self._changes = {"encoding": encoding} if encoding else {}
        self._shield = declare_value(self, "shield", "", "the simulator's: policies have a temperature for each shield")
        self._backend = declare_choice(self, "backend", "onnx", list(BACKENDS), "library that computes the policy")
        self._radio = declare_choice(self, "radio", "direct", ["direct", "relayed"], "same as the simulator's")
        declare_seconds(
            self,
            "feature_deadline",
            0.25,
            "longest wait for neighbours' messages in a tick, all rounds together",
            fixed=False,
        )
        self._max_payload = declare_count(
            self,
            "max_payload",
            0,
            "longest payload in bytes that a deployed policy may send; as long as the first policy's if 0",
            _MAX_PAYLOAD,
            0,
            fixed=False,
        )
        team_size = declare_count(self, "team_size", 32, "robots in the team; sets the queues of shared topics", 10_000)
        names = declare_value(self, "robots", [""], "robots of this process; only the namespace's if empty", False)
        autostart = declare_value(
            self, "autostart", True, "join the team at once; else wait to be configured and activated"
        )
        # Shared topics are in the parent of a robot's namespace, so that a whole team can be put in a namespace.
        self._team, _, own = self.get_namespace().rpartition("/")
        self.robots = [own] if list(names) == [""] else list(names)
        _check_names(self.robots, own, self.get_namespace())
        self._team_size = team_size
        processes = team_size / len(self.robots)
        self._hello_every = max(1, math.ceil(processes / HELLO_PROCESSES))
        self._problem: str | None = None
        self._slot: PolicySlot | None = None
        self._nonce = secrets.randbits(64)
        self._taking_part = False
        self._settable = SettableParameters(self, ["feature_deadline"], self._refuse, self._on_set)
        self._settable.show("robots", self.robots)
        if autostart:
            for trigger in (self.trigger_configure, self.trigger_activate):
                if trigger() is not TransitionCallbackReturn.SUCCESS:
                    raise ModelError(self._problem or "the node could not be activated")

    # --- Configure, activate, deactivate, clean up ---

    def on_configure(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Load the policy."""
        try:
            if not self._folder:
                raise ModelError("no policy given: start the robot with -p policy:=FOLDER")
            folder = Path(self._folder)
            temperature = read_temperature(folder, self._shield)
            policy = load_policy(folder, self._backend, temperature=temperature, **self._changes)
            self._slot = PolicySlot(policy, self._backend, self._max_payload, self._shield)
            self._settable.show("encoding", policy.config.encoding)
            self._settable.show("max_payload", self._slot.max_payload)
        except ModelError as error:
            self._problem = str(error)
            self.get_logger().error(f"not configured: {error}")
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Take part in the team."""
        self._peers: dict[int, tuple[float, int]] = {}
        self._last_observed = -math.inf
        self._ticks = self._beats = 0
        self._deadline = self.create_timer(1.0, self._on_deadline)  # `_set_deadline` sets the time
        self._restart()

        team, size = self._team, self._team_size
        self._send_feature = topics.FEATURE.publisher(self, team=team, robots=size)
        self._send_preference = topics.PREFERENCE.publisher(self, team=team, robots=size)
        self._send_status = topics.ROBOT_STATUS.publisher(self, team=team, robots=size)
        self._team_publishers = [self._send_feature, self._send_preference, self._send_status]
        # Callbacks with one argument do not get the middleware's information about the sender.
        self._team_subscriptions = [
            topics.DEPLOYMENT.subscription(self, self._on_deployment, team=team, on_drop=self._on_drop)
        ]
        if self._radio == "direct":
            self._team_subscriptions.append(
                topics.FEATURE.subscription(self, self._on_feature, team=team, robots=size, raw=True)
            )
        for number, name in enumerate(self.robots):
            observe = functools.partial(self._on_observation, number)
            self._team_subscriptions.append(
                topics.OBSERVATION.subscription(self, observe, robot=name, team=team, on_drop=self._on_drop)
            )
            if self._radio == "relayed":
                hear = functools.partial(self._on_bundle, number)
                self._team_subscriptions.append(topics.HEARD.subscription(self, hear, robot=name, team=team, raw=True))
        self._beat = self.create_timer(HELLO_PERIOD, self._on_beat)
        self._taking_part = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Leave the team: to all others, it is as if the process had ended."""
        self._leave()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Leave the team for good, from any state; the process goes on until it is told to end."""
        if self._taking_part:
            self._leave()
        self._slot = None
        return TransitionCallbackReturn.SUCCESS

    def _leave(self) -> None:
        self._taking_part = False
        for timer in (self._deadline, self._beat):
            self.destroy_timer(timer)
        for subscription in self._team_subscriptions:
            self.destroy_subscription(subscription)
        for publisher in self._team_publishers:
            self.destroy_publisher(publisher)

    def on_cleanup(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Release the policy."""
        self._slot = None
        return TransitionCallbackReturn.SUCCESS

    # --- The policy ---

    def _restart(self) -> None:
        """Start with a fresh crew and the current policy."""
        assert self._slot is not None
        policy = self._slot.policy
        self._encoding = ENCODINGS[policy.config.encoding]
        sizes = round_bytes(policy.config, policy.config.encoding)
        self._feature_bytes, self._rounds = cdr.feature_bytes(sizes), len(sizes)
        self._crew = Crew(policy, len(self.robots), self._on_send, self._on_answer, self._radio == "relayed")
        self._sending: tuple[int, int, int] | None = None  # episode, tick, round
        self._set_deadline()
        self._deadline.cancel()

    def _set_deadline(self) -> None:
        """Divide the deadline of a tick among the rounds."""
        seconds = self.get_parameter("feature_deadline").value
        self._deadline.timer_period_ns = int(1e9 * seconds / self._rounds)

    def _refuse(self, changes: dict[str, object]) -> str:
        if self._taking_part and not self._waiting:
            return f"{', '.join(changes)}: can be set between episodes only: the robots are in one"
        return ""

    def _on_set(self) -> None:
        if self._taking_part:
            self._set_deadline()

    def _on_deployment(self, message: Deployment) -> None:
        assert self._slot is not None
        number = message.deployment
        if message.order == Deployment.ROLL_BACK:
            changed = self._slot.roll_back(number)
        else:
            files = {file.name: file.data.tobytes() for file in message.files}
            self._slot.prepare(number, message.digest, files)
            changed = message.order == Deployment.SWITCH and self._slot.switch(number)
        if changed:
            self._restart()
            self.get_logger().info(f"switched to {self._policy_name()}")
        elif self._slot.refusal:
            self.get_logger().warning(f"refused the deployed policy: {self._slot.refusal}")
        self._send_robot_status()

    def _policy_name(self) -> str:
        assert self._slot is not None
        return f"{self._slot.policy.config.name} ({self._slot.policy.digest[:12]})"

    # --- A tick ---

    def _on_drop(self, why: str) -> None:
        self._crew.exchange.drop(why)

    def _on_observation(self, robot: int, message: Observation) -> None:
        if message.tick == Observation.HELLO:
            self._send_preference.publish(Preference(tick=Observation.HELLO, tag=message.own_tag))
            return
        self._last_observed = time.monotonic()
        observation = ReceivedObservation(
            message.episode,
            message.tick,
            message.stream,
            message.own_tag,
            frozenset(message.audible_tags),
            message.field_of_view.tobytes(),
            message.moved,
        )
        if self._crew.see(robot, observation) and self._crew.waiting:
            self._deadline.reset()

    def _on_send(self, _: int, message: Message) -> None:
        at = (message.episode, message.tick, message.round)
        if at != self._sending:
            self._sending = at
            self._deadline.reset()
        self._send_feature.publish(cdr.pack_feature(*at, message.tag, self._encoding, message.payload))

    def _on_feature(self, data: bytes) -> None:
        feature = cdr.unpack_feature(data)
        if feature is None:
            self._crew.exchange.drop(f"a damaged message of {len(data)} bytes")
        elif feature.tick == Observation.HELLO:
            if feature.tag != self._nonce and len(feature.payload) == _COUNT.size:
                self._peers[feature.tag] = (time.monotonic(), *_COUNT.unpack(feature.payload))
        elif feature.encoding != self._encoding:
            self._crew.exchange.drop(f"a message of encoding {feature.encoding}: these robots use {self._encoding}")
        else:
            self._crew.hear(Message(feature.episode, feature.tick, feature.round, feature.tag, feature.payload))

    def _on_bundle(self, robot: int, data: bytes) -> None:
        bundle = cdr.unpack_bundle(data)
        if bundle is None:
            self._crew.exchange.drop(f"a damaged bundle of {len(data)} bytes")
        elif bundle.encoding != self._encoding:
            self._crew.exchange.drop(f"a bundle of encoding {bundle.encoding}: these robots use {self._encoding}")
        else:
            self._crew.hear_bundle(robot, bundle.episode, bundle.tick, bundle.round, bundle.split())

    def _on_deadline(self) -> None:
        self._deadline.cancel()
        self._crew.overdue()

    def _on_answer(self, _: int, answer: Answer) -> None:
        self._deadline.cancel()
        observation = answer.observation
        message = Preference(episode=observation.episode, tick=observation.tick, tag=observation.own_tag)
        message.log_probabilities = answer.log_probabilities
        message.primitive = answer.primitive
        message.heard = answer.heard
        message.feature_bytes = self._feature_bytes
        message.compute_us = round(1e6 * answer.compute)
        self._send_preference.publish(message)
        self._ticks += 1

    # --- Hellos and statuses ---

    def _on_beat(self) -> None:
        now = time.monotonic()
        if self._waiting and self._radio == "direct" and self._beats % self._hello_every == 0:
            hello = cdr.pack_feature(0, Observation.HELLO, 0, self._nonce, 0, _COUNT.pack(len(self.robots)))
            self._send_feature.publish(hello)
        valid = HELLO_PERIOD * self._hello_every * HELLO_VALID
        self._peers = {nonce: peer for nonce, peer in self._peers.items() if now - peer[0] < valid}
        self._beats += 1
        if self._waiting or self._beats % STATUS_EVERY == 0:
            self._send_robot_status()

    @property
    def _waiting(self) -> bool:
        return time.monotonic() - self._last_observed > SILENCE

    def _send_robot_status(self) -> None:
        assert self._slot is not None
        slot, exchange = self._slot, self._crew.exchange
        peers = len(self.robots) - 1 + sum(count for _, count in self._peers.values())
        self._send_status.publish(
            RobotStatus(
                robots=self.robots,
                state=RobotStatus.WAITING if self._waiting else RobotStatus.RUNNING,
                policy=slot.policy.config.name,
                digest=slot.policy.digest,
                encoding=slot.policy.config.encoding,
                radio=self._radio,
                rounds=len(exchange.sizes),
                max_payload=slot.max_payload,
                deployment=slot.deployment,
                prepared=slot.prepared,
                refusal=slot.refusal,
                peers_heard=min(peers, _MAX_UINT32),  # a faulty hello may hold any number
                ticks=min(self._ticks, _MAX_UINT32),
                features_missing=min(self._crew.missing, _MAX_UINT32),
                messages_dropped=min(exchange.dropped, _MAX_UINT32),
                last_drop=exchange.last_drop,
            )
        )


def _check_names(robots: list[str], own: str, namespace: str) -> None:
    """Raise a ValueError unless ``own``, the end of the ``namespace``, is one of ``robots``, all of them different."""
    if not own or own not in robots:
        raise ValueError(
            f"the namespace {namespace} is not the name of any of the robots {robots}: start the node with "
            "-r __ns:=/NAME, where NAME is the robot, or one robot of the crew"
        )
    if len(set(robots)) < len(robots):
        raise ValueError(f"the robots are {robots}: name each only once")


def main(args: list[str] | None = None) -> int:
    """Run the robots of one process until it is shut down. Returns the exit status."""
    return run_node("robot", RobotNode, args)


if __name__ == "__main__":
    sys.exit(main())
