# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings of a team that is simulated in this process, so that every message is known."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rclpy.serialization import serialize_message

from magat_interfaces.msg import Feature, FeatureBundle, Observation, Preference, RobotStatus, World
from magat_node.topics import team_topics
from magat_recording.bag import BagWriter
from magat_recording.definitions import described
from magat_robot.policy import payload
from magat_robot.policy.config import ENCODINGS
from magat_robot.policy.policy import Policy
from magat_sim.measures import EpisodeMeasures, Flowtime
from magat_sim.streams import episode_streams
from magat_sim.ticks import DistributedEpisode, ReceivedPreference

#: The expert's flowtimes in all World messages.
BEST = Flowtime(30, 31)
NAMES = ["alice", "bob", "carol", "dave", "eve", "frank"]
#: Duration of a tick, nanoseconds.
STEP = 10_000_000


@dataclass
class Simulated:
    """A bag, and its expected contents."""

    bag: Path
    measures: list[EpisodeMeasures]
    #: By episode, the number of features in range that were not received.
    missing: list[int]
    names: tuple[str, ...] = tuple(NAMES)


def simulate_team(
    policy: Policy,
    random_case: Callable,
    bag: Path,
    episodes: int = 2,
    t_max: int = 12,
    relayed: bool = False,
    encoding: str = "float32",
    lose: Callable[[str, int, int], bool] = lambda kind, tick, robot: False,
    silent: tuple[int, int] | None = None,
    deaf: tuple[int, int] | None = None,
    digests: Sequence[str] = ("d" * 64,),
) -> Simulated:
    """Run episodes of six robots in this process, and write the messages of such a team to a bag.

    Args:
        policy: of all robots.
        random_case: the fixture.
        bag: folder to write.
        episodes: their number.
        t_max: most ticks of an episode.
        relayed: whether the radio is relayed.
        encoding: of the features.
        lose: ``lose(kind, tick, robot)`` says whether a message is missing in the bag; World messages have the robot
            -1.
        silent: tick and robot that does not answer in time.
        deaf: tick and robot that does not receive one of its messages.
        digests: of the policies in the robots' statuses.
    """
    measures, missing = [], []
    with BagWriter(bag) as writer:
        for topic in team_topics(NAMES, relayed):
            writer.add_topic(described(topic, topic.name if topic.name.startswith("/") else f"/{topic.name}"))
        for digest in digests:
            status = RobotStatus(robots=NAMES, policy=policy.config.name, digest=digest, encoding=encoding)
            writer.write("/robot_status", serialize_message(status), STEP, STEP)
        for number in range(episodes):
            case = random_case(np.random.default_rng(number), 10, 9, len(NAMES), 0.1)
            episode = DistributedEpisode(case, t_max, episode_streams(5, number, len(NAMES)))
            now = STEP * (1 + number * (t_max + 2))
            identity = 100 + number

            def write(kind: str, robot: int, topic: str, message: object, at: int, tick: int) -> None:
                if not lose(kind, tick, robot):
                    writer.write(topic, serialize_message(message), at, at)

            def world(outcome, at, *, episode=episode, identity=identity, case=case, write=write) -> None:
                simulator = episode.simulator
                message = World(episode=identity, tick=simulator.tick, robots=NAMES, width=10, height=9)
                message.x, message.y = simulator.position.T.tolist()
                message.goal_x, message.goal_y = case.goals.T.tolist()
                message.visited, message.t_max = simulator.visited.tolist(), int(simulator.t_max[0])
                message.expert_flowtime, message.expert_flowtime_strict = BEST.first_visit, BEST.last_arrival
                if outcome is None:
                    message.obstacles = case.obstacles.astype(np.uint8).ravel().tolist()
                    message.action = message.moved = [0] * len(NAMES)
                    message.silent, message.missing = [False] * len(NAMES), [0] * len(NAMES)
                else:
                    message.action, message.moved = outcome.actions.tolist(), outcome.step.moved.tolist()
                    message.missing = outcome.missing.tolist()
                    message.silent, message.links, message.seconds = outcome.silent.tolist(), outcome.links, 0.01
                write("World", -1, "/world", message, at, simulator.tick)

            world(None, now)
            while not episode.simulator.done:
                tick, now = episode.simulator.tick, now + STEP
                observations = episode.look([True] * len(NAMES))
                for robot, observed in enumerate(observations):
                    seen = Observation(episode=identity, tick=tick, stream=observed.stream, own_tag=observed.own_tag)
                    seen.audible_tags = observed.audible_tags
                    seen.field_of_view = observed.field_of_view.ravel().tolist()
                    write("Observation", robot, f"/{NAMES[robot]}/observation", seen, now, tick)
                row_of = {observed.own_tag: row for row, observed in enumerate(observations)}
                heard = [[row_of[tag] for tag in observed.audible_tags] for observed in observations]
                if deaf == (tick, deaf and deaf[1]) and heard[deaf[1]]:
                    heard[deaf[1]].pop()
                most = max(map(len, heard))
                rows = np.array([row + [-1] * (most - len(row)) for row in heard]).reshape(len(NAMES), most)
                own = policy.perceive(np.stack([observed.field_of_view for observed in observations]))
                for exchange in range(policy.rounds):
                    for robot, observed in enumerate(observations):
                        data = payload.encode(own.messages[robot], encoding)
                        sent = Feature(episode=identity, tick=tick, round=exchange, tag=observed.own_tag)
                        sent.encoding, sent.payload = ENCODINGS[encoding], data
                        write("Feature", robot, "/feature", sent, now + 1000 + robot, tick)
                        if relayed:
                            bundle = FeatureBundle(episode=identity, tick=tick, round=exchange)
                            write("FeatureBundle", robot, f"/{NAMES[robot]}/heard", bundle, now + 2000, tick)
                    carried = payload.round_trip(own.messages, encoding)
                    own = policy.hear(own, carried[np.maximum(rows, 0)], rows >= 0)
                decision = policy.decide(own, np.array([o.stream for o in observations], dtype=np.uint64), tick)
                for robot, observed in enumerate(observations):
                    preference = Preference(episode=identity, tick=tick, tag=observed.own_tag, heard=len(heard[robot]))
                    preference.log_probabilities = decision.log_probabilities[robot]
                    preference.primitive, preference.feature_bytes = int(decision.primitives[robot]), 100 + robot
                    preference.compute_us = 1500
                    late = silent == (tick, robot)
                    write("Preference", robot, "/preference", preference, now + 10**6 * (robot + 1), tick)
                    if not late:
                        episode.answer(
                            observed.own_tag,
                            ReceivedPreference(preference.primitive, preference.heard, preference.feature_bytes),
                        )
                world(episode.advance(), now + 9 * 10**6)
            measures += episode.simulator.measures([BEST])
            missing.append(episode.features_missing)
    return Simulated(bag, measures, missing)
