"""The node of a process's robots, one or many: translates between ROS messages and the robots' policy and exchange."""

import functools
import math
import secrets
import struct
import sys
import time
from pathlib import Path

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from magat_interfaces.msg import Deployment, Feature, FeatureBundle, Observation, Preference, RobotStatus
from magat_node import cdr, qos
from magat_node.parameters import declare_choice, declare_count, declare_seconds, declare_value
from magat_node.run import run_node
from magat_robot.crew import Answer, Crew, Message, ReceivedObservation
from magat_robot.policy.backends import BACKENDS, load_policy
from magat_robot.policy.config import ENCODINGS, MAX_SIZE, ModelError
from magat_robot.policy.payload import encoded_bytes
from magat_robot.policy_slot import PolicySlot

#: Seconds between two statuses while waiting, and between two hellos in a small team.
HELLO_PERIOD = 0.2
#: P processes hear P^2 hellos: where there are more than so many, each says hello the more seldom.
HELLO_PROCESSES = 32
#: A hello counts for so many of these periods.
HELLO_VALID = 10
#: Without an observation for so long the robots wait again, seconds.
SILENCE = 1.0
#: While they run, the status is sent every this many periods.
STATUS_EVERY = 10

_COUNT = struct.Struct("<I")
_MOST = 2**32 - 1
#: More numbers than `magat_robot.policy.config.MAX_SIZE` no message has.
_MOST_BYTES = 4 * MAX_SIZE


class RobotNode(LifecycleNode):
    """One robot: observation in, feature out, features in, preference out; its namespace is its name.

    Or a crew, the robots that the parameter ``robots`` names; the namespace is the name of one of them.

    A lifecycle node: configuring loads the policy, and an active node takes part in the team. It does both by itself
    when it is created, unless the parameter ``autostart`` is false.
    """

    def __init__(self, **options: object) -> None:
        """Join the team.

        Raises:
            ModelError: the policy cannot be used, or no policy is given.
            ValueError: a robot is named twice, the namespace is none's name, or a parameter is not one of its choices.
        """
        super().__init__("robot", **options)
        self._folder = declare_value(self, "policy", "", "folder of the policy to carry")
        encoding = declare_choice(
            self, "encoding", "", ["", *ENCODINGS], "of messages; that of the policy's configuration if empty"
        )
        self._changes = {"encoding": encoding} if encoding else {}
        self._backend = declare_choice(self, "backend", "torch", list(BACKENDS), "what computes the policy")
        self._radio = declare_choice(self, "radio", "direct", ["direct", "relayed"], "as the simulator's")
        self._feature_deadline = declare_seconds(
            self, "feature_deadline", 0.25, "wait so long in a tick, in all its rounds, for neighbours' messages"
        )
        self._max_payload = declare_count(
            self,
            "max_payload",
            0,
            "bytes that a policy may send in a message; as many as the first one if 0",
            _MOST_BYTES,
            0,
        )
        team_size = declare_count(self, "team_size", 32, "robots in the team, for the queues of shared topics", 10_000)
        names = declare_value(self, "robots", [""], "robots of this process; the one that the namespace names if empty")
        autostart = declare_value(
            self, "autostart", True, "take part at once; else wait to be configured and activated"
        )
        # Shared topics live in the namespace above a robot's own, so that a whole team can be put in a namespace.
        self._team, _, own = self.get_namespace().rpartition("/")
        self.robots = [own] if list(names) == [""] else list(names)
        if not own or own not in self.robots:
            raise ValueError(
                f"the namespace {self.get_namespace()} is the name of none of the robots {self.robots}: "
                "start the node with -r __ns:=/NAME, for a crew with the name of one of them"
            )
        if len(set(self.robots)) < len(self.robots):
            raise ValueError(f"the robots are {self.robots}: name none twice")
        self._depth = qos.shared_depth(team_size)
        processes = team_size / len(self.robots)
        self._hello_every = max(1, math.ceil(processes / HELLO_PROCESSES))
        self._problem: str | None = None
        self._carried: PolicySlot | None = None
        self._nonce = secrets.randbits(64)
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
            policy = load_policy(Path(self._folder), self._backend, **self._changes)
            self._carried = PolicySlot(policy, self._backend, self._max_payload)
        except ModelError as error:
            self._problem = str(error)
            self.get_logger().error(f"not configured: {error}")
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Take part in the team from now on."""
        self._peers: dict[int, tuple[float, int]] = {}
        self._last_observed = -math.inf
        self._ticks = self._beats = 0
        self._deadline = self.create_timer(self._feature_deadline, self._on_deadline)
        self._carry()

        team, depth = self._team, self._depth
        self._send_feature = self.create_publisher(Feature, f"{team}/feature", qos.newest(depth))
        self._send_preference = self.create_publisher(Preference, f"{team}/preference", qos.newest(depth))
        self._send_status = self.create_publisher(RobotStatus, f"{team}/robot_status", qos.reliable(depth))
        self._talking = [self._send_feature, self._send_preference, self._send_status]
        # One-argument callbacks: what the middleware knows of a message's origin is never asked for.
        self._listening = [
            self.create_subscription(Deployment, f"{team}/deployment", self._on_deployment, qos.latched(1))
        ]
        if self._radio == "direct":
            hear_all = self._on_feature
            self._listening.append(
                self.create_subscription(Feature, f"{team}/feature", hear_all, qos.newest(depth), raw=True)
            )
        for number, name in enumerate(self.robots):
            observe = functools.partial(self._on_observation, number)
            topic = f"{team}/{name}/observation"
            self._listening.append(self.create_subscription(Observation, topic, observe, qos.newest(4)))
            if self._radio == "relayed":
                hear, topic = functools.partial(self._on_bundle, number), f"{team}/{name}/heard"
                self._listening.append(self.create_subscription(FeatureBundle, topic, hear, qos.newest(8), raw=True))
        self._beat = self.create_timer(HELLO_PERIOD, self._on_beat)
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Take no part any longer: to the others it is as if the process had ended."""
        for timer in (self._deadline, self._beat):
            self.destroy_timer(timer)
        for subscription in self._listening:
            self.destroy_subscription(subscription)
        for publisher in self._talking:
            self.destroy_publisher(publisher)
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Put the policy away."""
        self._carried = None
        return TransitionCallbackReturn.SUCCESS

    # --- The policy ---

    def _carry(self) -> None:
        """Begin anew, with the policy that is carried now."""
        assert self._carried is not None
        policy = self._carried.policy
        self._encoding = ENCODINGS[policy.config.encoding]
        sizes = [encoded_bytes(size, policy.config.encoding) for size in policy.config.message_sizes]
        self._feature_bytes = cdr.feature_bytes(sizes)
        self._crew = Crew(policy, len(self.robots), self._on_send, self._on_answer, self._radio == "relayed")
        self._sending: tuple[int, int, int] | None = None  # episode, tick, round
        # A tick takes no longer with many rounds than with one.
        self._deadline.timer_period_ns = int(1e9 * self._feature_deadline / len(sizes))
        self._deadline.cancel()

    def _on_deployment(self, message: Deployment) -> None:
        assert self._carried is not None
        number = message.deployment
        if message.order == Deployment.ROLL_BACK:
            changed = self._carried.roll_back(number)
        else:
            files = {file.name: file.data.tobytes() for file in message.files}
            self._carried.prepare(number, message.digest, files)
            changed = message.order == Deployment.SWITCH and self._carried.switch(number)
        if changed:
            self._carry()
            self.get_logger().info(f"carries {self._policy_named()} from now on")
        elif self._carried.refusal:
            self.get_logger().warning(f"does not carry what is deployed: {self._carried.refusal}")
        self._say_status()

    def _policy_named(self) -> str:
        assert self._carried is not None
        return f"{self._carried.policy.config.name} ({self._carried.policy.digest[:12]})"

    # --- A tick: look, send, hear, decide ---

    def _on_observation(self, robot: int, message: Observation) -> None:
        if message.tick == Observation.HELLO:
            self._send_preference.publish(Preference(tick=Observation.HELLO, tag=message.own_tag))
            return
        self._last_observed = time.monotonic()
        sight = ReceivedObservation(
            message.episode,
            message.tick,
            message.stream,
            message.own_tag,
            frozenset(message.audible_tags),
            message.field_of_view.tobytes(),
        )
        if self._crew.see(robot, sight) and self._crew.waiting:
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
            self._crew.exchange.drop(f"of encoding {feature.encoding}: these robots use {self._encoding}")
        else:
            self._crew.hear(Message(feature.episode, feature.tick, feature.round, feature.tag, feature.payload))

    def _on_bundle(self, robot: int, data: bytes) -> None:
        bundle = cdr.unpack_bundle(data)
        if bundle is None:
            self._crew.exchange.drop(f"a damaged bundle of {len(data)} bytes")
        elif bundle.encoding != self._encoding:
            self._crew.exchange.drop(f"of encoding {bundle.encoding}: these robots use {self._encoding}")
        else:
            size = len(bundle.payloads) // max(bundle.messages, 1)
            payloads = [bundle.payloads[size * i : size * (i + 1)] for i in range(bundle.messages)]
            self._crew.hear_bundle(robot, bundle.episode, bundle.tick, bundle.round, payloads)

    def _on_deadline(self) -> None:
        self._deadline.cancel()
        self._crew.overdue()

    def _on_answer(self, _: int, answer: Answer) -> None:
        self._deadline.cancel()
        sight = answer.sight
        message = Preference(episode=sight.episode, tick=sight.tick, tag=sight.own_tag)
        message.log_probabilities = answer.log_probabilities
        message.primitive = answer.primitive
        message.heard = answer.heard
        message.feature_bytes = self._feature_bytes
        message.compute_us = round(1e6 * answer.compute)
        self._send_preference.publish(message)
        self._ticks += 1

    # --- Between episodes: who is there ---

    def _on_beat(self) -> None:
        now = time.monotonic()
        if self._waiting and self._radio == "direct" and self._beats % self._hello_every == 0:
            hello = cdr.pack_feature(0, Observation.HELLO, 0, self._nonce, 0, _COUNT.pack(len(self.robots)))
            self._send_feature.publish(hello)
        valid = HELLO_PERIOD * self._hello_every * HELLO_VALID
        self._peers = {nonce: peer for nonce, peer in self._peers.items() if now - peer[0] < valid}
        self._beats += 1
        if self._waiting or self._beats % STATUS_EVERY == 0:
            self._say_status()

    @property
    def _waiting(self) -> bool:
        return time.monotonic() - self._last_observed > SILENCE

    def _say_status(self) -> None:
        assert self._carried is not None
        carried, exchange = self._carried, self._crew.exchange
        peers = len(self.robots) - 1 + sum(count for _, count in self._peers.values())
        self._send_status.publish(
            RobotStatus(
                robots=self.robots,
                state=RobotStatus.WAITING if self._waiting else RobotStatus.RUNNING,
                policy=carried.policy.config.name,
                digest=carried.policy.digest,
                encoding=carried.policy.config.encoding,
                radio=self._radio,
                rounds=len(exchange.sizes),
                max_payload=carried.max_payload,
                deployment=carried.deployment,
                prepared=carried.prepared,
                refusal=carried.refusal,
                peers_heard=min(peers, _MOST),  # a stranger may count to any number
                ticks=min(self._ticks, _MOST),
                features_missing=min(self._crew.missing, _MOST),
                messages_dropped=min(exchange.dropped, _MOST),
                last_drop=exchange.last_drop,
            )
        )


def main(args: list[str] | None = None) -> int:
    """Run the robots of one process until it is told to end. Returns the exit status."""
    return run_node("robot", RobotNode, args)


if __name__ == "__main__":
    sys.exit(main())
