"""The robot node: translates between ROS messages and the robot's own policy and exchange."""

import array
import math
import secrets
import sys
import time
from pathlib import Path

import numpy as np
import torch
from rclpy.node import Node
from rclpy.serialization import serialize_message

from magat_interfaces.msg import Feature, Observation, Preference, RobotStatus
from magat_node import qos
from magat_node.parameters import declare_count, declare_seconds, declare_value
from magat_node.run import run_node
from magat_robot.exchange import Exchange
from magat_robot.policy.config import ModelError
from magat_robot.policy.extractor import OBSERVATION_SHAPE
from magat_robot.policy.policy import Encoding
from magat_robot.policy.store import load

#: Seconds between hellos while waiting, and how long a hello heard counts.
HELLO_PERIOD = 0.2
HELLO_VALID = 2.0
#: Without an observation for so long the robot waits again, seconds.
SILENCE = 1.0
#: While it runs, the status is sent every this many periods.
STATUS_EVERY = 10


class RobotNode(Node):
    """One robot: observation in, feature out, features in, preference out; its namespace is its name."""

    def __init__(self, **options: object) -> None:
        """Load the policy that the parameter ``policy`` names and join the team.

        Raises:
            ModelError: the policy cannot be used, or no policy is given.
        """
        super().__init__("robot", **options)
        self.name = self.get_namespace().strip("/").rsplit("/", 1)[-1]
        folder = declare_value(self, "policy", "", "folder of the policy to carry")
        if not folder:
            raise ModelError("no policy given: start the robot with -p policy:=FOLDER")
        deadline = declare_seconds(
            self, "feature_deadline", 0.25, "wait so long in a tick for neighbours' features, then decide without"
        )
        team_size = declare_count(self, "team_size", 32, "robots in the team, for the queues of shared topics", 10_000)
        self._policy = load(Path(folder))
        if self._policy.rounds > 1:
            raise ModelError(
                f"{folder} exchanges messages in {self._policy.rounds} rounds a tick, and robot nodes do so in one: "
                "evaluate it with `magat evaluate`"
            )
        self._exchange = Exchange(self._policy.config.message_sizes[0])
        self._nonce = secrets.randbits(64)
        self._peers: dict[int, float] = {}
        self._observation: Observation | None = None
        self._encoding: Encoding | None = None
        self._last_observed = -math.inf
        self._compute = 0.0
        self._ticks = self._missing = self._beats = 0
        sample = Feature(payload=array.array("B", bytes(4 * self._policy.config.message_sizes[0])))
        self._feature_bytes = len(serialize_message(sample))

        # Shared topics live in the namespace above the robot's own, so that a whole team can be put in a namespace.
        team = self.get_namespace().rstrip("/").rsplit("/", 1)[0]
        depth = qos.shared_depth(team_size)
        self._send_feature = self.create_publisher(Feature, f"{team}/feature", qos.newest(depth))
        self._send_preference = self.create_publisher(Preference, f"{team}/preference", qos.newest(depth))
        self._send_status = self.create_publisher(RobotStatus, f"{team}/robot_status", qos.reliable(depth))
        # One-argument callbacks: what the middleware knows of a message's origin is never asked for.
        self.create_subscription(Feature, f"{team}/feature", self._on_feature, qos.newest(depth))
        self.create_subscription(Observation, "observation", self._on_observation, qos.newest(4))
        self._deadline = self.create_timer(deadline, self._on_deadline)
        self._deadline.cancel()
        self.create_timer(HELLO_PERIOD, self._on_beat)

    # --- A tick: look, send, hear, decide ---

    def _on_observation(self, message: Observation) -> None:
        if message.tick == Observation.HELLO:
            self._send_preference.publish(Preference(tick=Observation.HELLO, tag=message.own_tag))
            return
        if len(message.field_of_view) != int(np.prod(OBSERVATION_SHAPE)):
            self._exchange.drop(f"an observation of {len(message.field_of_view)} numbers, not {OBSERVATION_SHAPE}")
            return
        view = np.frombuffer(message.field_of_view, dtype=np.uint8).reshape(1, *OBSERVATION_SHAPE)
        if view.max() > 1:
            self._exchange.drop(f"an observation that holds {view.max()}, where there are 0 and 1")
            return
        last = self._observation
        if last is not None and last.episode == message.episode and message.tick <= last.tick:
            self._exchange.drop(f"a repeated or late observation, of tick {message.tick} after {last.tick}")
            return
        self._last_observed = started = time.monotonic()
        self._observation = message
        self._encoding = self._policy.encode(view)
        feature = Feature(episode=message.episode, tick=message.tick, tag=message.own_tag)
        feature.payload = array.array("B", self._encoding.messages.astype("<f4").tobytes())
        self._compute = time.monotonic() - started
        self._send_feature.publish(feature)
        self._exchange.begin(message.episode, message.tick, list(message.audible_tags))
        if self._exchange.complete:
            self._decide()
        else:
            self._deadline.reset()

    def _on_feature(self, message: Feature) -> None:
        if message.tick == Observation.HELLO:
            if message.tag != self._nonce:
                self._peers[message.tag] = time.monotonic()
            return
        if message.round != 0 or message.encoding != Feature.FLOAT32:
            self._exchange.drop(
                f"round {message.round}, encoding {message.encoding}: this policy has round 0, encoding 0"
            )
            return
        mine = self._exchange.receive(message.episode, message.tick, message.tag, message.payload.tobytes())
        if mine and self._encoding is not None and self._exchange.complete:
            self._decide()

    def _on_deadline(self) -> None:
        self._deadline.cancel()
        if self._encoding is not None:
            self._decide()

    def _decide(self) -> None:
        self._deadline.cancel()
        observation, encoding = self._observation, self._encoding
        assert observation is not None and encoding is not None
        self._encoding = None  # this tick is decided
        started = time.monotonic()
        messages = self._exchange.messages()
        present = np.ones((1, len(messages)), dtype=bool)
        stream = np.array([observation.stream], dtype=np.uint64)
        decision = self._policy.decide(self._policy.hear(encoding, messages[None], present), stream, observation.tick)
        answer = Preference(episode=observation.episode, tick=observation.tick, tag=observation.own_tag)
        answer.log_probabilities = decision.log_probabilities[0]
        answer.primitive = int(decision.primitives[0])
        answer.heard = len(messages)
        answer.feature_bytes = self._feature_bytes
        answer.compute_us = round(1e6 * (self._compute + time.monotonic() - started))
        self._send_preference.publish(answer)
        self._ticks += 1
        self._missing += self._exchange.missing

    # --- Between episodes: who is there ---

    def _on_beat(self) -> None:
        now = time.monotonic()
        waiting = now - self._last_observed > SILENCE
        if waiting:
            self._send_feature.publish(Feature(tick=Observation.HELLO, tag=self._nonce))
        self._peers = {nonce: heard for nonce, heard in self._peers.items() if now - heard < HELLO_VALID}
        self._beats += 1
        if waiting or self._beats % STATUS_EVERY == 0:
            self._send_status.publish(
                RobotStatus(
                    robot=self.name,
                    state=RobotStatus.WAITING if waiting else RobotStatus.RUNNING,
                    policy=self._policy.config.name,
                    digest=self._policy.digest,
                    peers_heard=len(self._peers),
                    ticks=self._ticks,
                    features_missing=self._missing,
                    messages_dropped=self._exchange.dropped,
                    last_drop=self._exchange.last_drop,
                )
            )


def main(args: list[str] | None = None) -> int:
    """Run one robot until it is told to end. Returns the exit status."""
    # A robot computes one observation at a time: threads would only wait for each other.
    torch.set_num_threads(1)
    return run_node("robot", RobotNode, args)


if __name__ == "__main__":
    sys.exit(main())
