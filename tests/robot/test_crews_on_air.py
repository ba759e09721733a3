# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Crews of any size decide as single robots and as the batched simulator, in any order of delivery, with any loss."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_robot.crew import Answer, Crew, Message, ReceivedObservation
from magat_robot.policy.config import ENCODINGS
from magat_robot.policy.interface import Decision
from magat_robot.policy.payload import encoded_bytes, round_trip
from magat_robot.policy.policy import Policy
from magat_sim.relay import Relay
from magat_sim.simulator import Observation

POLICIES = {
    "MAGAT": ("MAGAT-F-16", {}),
    "MAGAT, 2 layers of 3 taps": ("MAGAT-F-8-P3", {"taps": 3, "layers": 2}),
    "GNN, bare": ("GNN-B-8-P3", {"taps": 3, "layers": 2, "normalise": False}),
    "GAT that does not talk": ("GAT-F-8", {"taps": 1, "layers": 2}),
}
EPISODE = 77

seeds = st.integers(0, 2**32 - 1)
encodings = st.sampled_from(list(ENCODINGS))


@dataclass(frozen=True)
class Delivery:
    """A pending delivery: an observation or bundle to a robot, or a message to a crew or to the relay."""

    kind: str
    to: int
    #: Sender of the message.
    sender: int = -1
    #: Round of the message or bundle.
    round: int = -1
    deliver: Callable[[], None] = field(compare=False, default=lambda: None)


class Team:
    """Crews with a simulated radio, which delivers everything in random order or loses it."""

    def __init__(self, policy: Policy, sizes: Sequence[int], relayed: bool = False, at_once: bool = False) -> None:
        self.relayed, self.at_once, self.robots = relayed, at_once, sum(sizes)
        self.crews = [
            Crew(policy, size, partial(self._sent, number), partial(self._answered, number), relayed)
            for number, size in enumerate(sizes)
        ]
        self.first = np.cumsum([0, *sizes]).tolist()
        self.answers: dict[int, Answer] = {}
        self.messages: list[Message] = []
        self.deadlines = 0

    def crew_of(self, robot: int) -> tuple[int, int]:
        """The robot's crew, and its number in the crew."""
        crew = int(np.searchsorted(self.first, robot, side="right")) - 1
        return crew, robot - self.first[crew]

    def tick(
        self,
        observation: Observation,
        rng: np.random.Generator,
        lost: Callable[[Delivery], bool] = lambda delivery: False,
        tick: int = 0,
    ) -> dict[int, Answer]:
        """The answers of the robots, without those that did not answer."""
        self.answers, self.messages, self.deadlines, self.pending = {}, [], 0, []
        self.progress = [-1] * len(self.crews)  # the last round in which they sent
        self.tags = rng.integers(1, 2**63, size=self.robots).tolist()
        rows = [row[row >= 0].tolist() for row in observation.heard]
        self.relay, self.rng = Relay(self.tags, rows, [True] * self.robots), rng
        for robot, hears in enumerate(rows):
            crew, number = self.crew_of(robot)
            audible = frozenset(self.tags[j] for j in hears)
            field_of_view = observation.field_of_view[robot].tobytes()
            received = ReceivedObservation(
                EPISODE, tick, int(observation.streams[robot]), self.tags[robot], audible, field_of_view
            )
            see = partial(self.crews[crew].see, number, received)
            self.pending.append(Delivery("observation", robot, deliver=see))
        while self.pending or self._deadline():
            if self.pending:
                delivery = self.pending.pop(rng.integers(len(self.pending)))
                if not lost(delivery):
                    delivery.deliver()
        assert not any(crew.waiting for crew in self.crews)
        return self.answers

    def _sent(self, crew: int, number: int, message: Message) -> None:
        sender = self.first[crew] + number
        assert message.tag == self.tags[sender]
        self.messages.append(message)
        self.progress[crew] = message.round
        if self.relayed:
            take = partial(self._relay, message)
            self._put(Delivery("relay", 0, sender, message.round, take))
            return
        for to, other in enumerate(self.crews):
            self._put(Delivery("message", to, sender, message.round, partial(other.hear, message)))

    def _answered(self, crew: int, number: int, answer: Answer) -> None:
        robot = self.first[crew] + number
        assert robot not in self.answers
        self.answers[robot] = answer

    def _relay(self, message: Message) -> None:
        assert self.relay.receive(message.round, message.tag, 0, message.payload) is None
        if self.relay.complete:
            self._hand_on()

    def _hand_on(self) -> None:
        number = self.relay.round
        for robot, bundle in enumerate(self.relay.bundles()):
            crew, place = self.crew_of(robot)
            at = (EPISODE, self.messages[-1].tick, number)
            hear = partial(self.crews[crew].hear_bundle, place, *at, bundle.payloads)
            self._put(Delivery("bundle", robot, round=number, deliver=hear))

    def _put(self, delivery: Delivery) -> None:
        """Deliver at once, or add to the pending deliveries."""
        if self.at_once:
            delivery.deliver()
        else:
            self.pending.append(delivery)

    def _deadline(self) -> bool:
        """Without pending deliveries, the deadline of the crew that waits longest passes; False if none is waiting."""
        waiting = [number for number, crew in enumerate(self.crews) if crew.waiting]
        if not waiting:
            return False
        self.deadlines += 1
        assert self.deadlines < 100, "deadlines lead nowhere"
        behind = min(self.progress[number] for number in waiting)
        if self.relayed and behind >= self.relay.round:
            self._hand_on()
            return True
        for number in self.rng.permutation([number for number in waiting if self.progress[number] == behind]):
            self.crews[number].overdue()
        return True


def reference(
    policy: Policy, observation: Observation, heard: Sequence[Sequence[Sequence[int]]], tick: int
) -> Decision:
    """As `Policy.decide_together`, but with other neighbours in each round: ``heard[round][robot]`` lists them."""
    own = policy.perceive(observation.field_of_view)
    for lists in heard:
        places = max(map(len, lists), default=0)
        rows = np.array([[*row, *[-1] * (places - len(row))] for row in lists], np.int64).reshape(len(lists), places)
        own = policy.hear(own, round_trip(own.messages, policy.config.encoding)[np.maximum(rows, 0)], rows >= 0)
    return policy.decide(own, observation.streams, tick)


def assert_decided(answers: dict[int, Answer], decision: Decision) -> None:
    logs = decision.log_probabilities
    for robot, answer in answers.items():
        assert answer.log_probabilities.dtype == np.float32
        assert answer.log_probabilities.tobytes() == logs[robot].tobytes()
        assert answer.primitive == decision.primitives[robot]


@pytest.fixture(scope="session", params=POLICIES)
def make_policy(request: pytest.FixtureRequest, small_policy: Callable) -> Callable:
    """Makes one of `POLICIES`, with a given encoding of messages."""
    name, sizes = POLICIES[request.param]
    return lambda encoding="float32": small_policy(name, encoding=encoding, **sizes)


def partition(rng: np.random.Generator, robots: int) -> list[int]:
    """Random crew sizes, from one crew of all robots to crews of one robot."""
    bounds = np.flatnonzero(rng.random(robots - 1) < rng.choice([0.0, 0.3, 0.7, 1.0])) + 1
    return np.diff([0, *bounds, robots]).tolist()


# --- Nothing is lost ---


@pytest.mark.parametrize("relayed", [False, True], ids=["direct", "relayed"])
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_one_crew_and_robots_alone_and_a_simulator_decide_the_same_bits(
    random_team: Callable, make_policy: Callable, encoding: str, relayed: bool
) -> None:
    policy, rng = make_policy(encoding), np.random.default_rng(0)
    observation = random_team(rng, 12, side=20)
    decision = policy.decide_together(observation.field_of_view, observation.heard, observation.streams, 5)
    for sizes in ([12], [1] * 12, [5, 7]):
        team = Team(policy, sizes, relayed)
        answers = team.tick(observation, rng, tick=5)
        assert answers.keys() == set(range(12))
        assert_decided(answers, decision)
        assert team.deadlines == 0
        assert len({answer.primitive for answer in answers.values()}) > 1


@pytest.mark.parametrize("relayed", [False, True], ids=["direct", "relayed"])
@settings(max_examples=12)
@given(seed=seeds, encoding=encodings)
def test_decisions_do_not_depend_on_the_order_in_which_anything_arrives(
    random_team: Callable, make_policy: Callable, relayed: bool, seed: int, encoding: str
) -> None:
    policy, rng = make_policy(encoding), np.random.default_rng(seed)
    robots = int(rng.integers(1, 11))
    team = Team(policy, partition(rng, robots), relayed)
    for tick in (3, 4, 8):
        observation = random_team(rng, robots, side=20)
        answers = team.tick(observation, rng, tick=tick)
        decision = policy.decide_together(observation.field_of_view, observation.heard, observation.streams, tick)
        assert answers.keys() == set(range(robots))
        assert_decided(answers, decision)
        audible = (observation.heard >= 0).sum(axis=1)
        assert [answers[i].heard for i in range(robots)] == audible.tolist()
        assert {answer.missing for answer in answers.values()} == {0}
        assert all(answer.compute > 0 for answer in answers.values())
        assert [answers[i].observation.stream for i in range(robots)] == observation.streams.tolist()
        assert team.deadlines == 0
        # Each robot sends one message a round, under its own tag.
        rounds, size = len(policy.config.message_sizes), policy.config.message_sizes
        assert len({(m.round, m.tag) for m in team.messages}) == len(team.messages) == rounds * robots
        assert all(len(m.payload) == encoded_bytes(size[m.round], encoding) for m in team.messages)
        assert all((m.episode, m.tick) == (EPISODE, tick) for m in team.messages)
    for crew in team.crews:
        assert (crew.missing, crew.exchange.dropped) == (0, 0)


@pytest.mark.parametrize("relayed", [False, True], ids=["direct", "relayed"])
@pytest.mark.parametrize("sizes", [[1] * 9, [9], [4, 5]], ids=str)
def test_what_is_sent_may_arrive_before_the_call_that_sends_it_returns(
    random_team: Callable, make_policy: Callable, sizes: list[int], relayed: bool
) -> None:
    policy, rng = make_policy(), np.random.default_rng(7)
    observation = random_team(rng, 9, side=20)
    team = Team(policy, sizes, relayed, at_once=True)
    answers = team.tick(observation, rng)
    decision = policy.decide_together(observation.field_of_view, observation.heard, observation.streams, 0)
    assert answers.keys() == set(range(9))
    assert_decided(answers, decision)
    assert all((crew.missing, crew.exchange.dropped) == (0, 0) for crew in team.crews)


# --- Something is lost ---


@pytest.mark.parametrize("relayed", [False, True], ids=["direct", "relayed"])
@settings(max_examples=25)
@given(seed=seeds, encoding=encodings)
def test_what_is_lost_is_missing_where_it_was_lost_and_nowhere_else(
    random_team: Callable, make_policy: Callable, relayed: bool, seed: int, encoding: str
) -> None:
    policy, rng = make_policy(encoding), np.random.default_rng(seed)
    robots = int(rng.integers(2, 11))
    team = Team(policy, partition(rng, robots), relayed)
    missing = 0
    for tick in range(2):
        observation = random_team(rng, robots, side=16)
        gone: set[Delivery] = set()
        share = dict.fromkeys(
            ("observation", "message", "relay", "bundle"), rng.choice([0.0, 0.1, 0.4], p=[0.2, 0.5, 0.3])
        )
        share |= {"observation": rng.choice([0.0, 0.2])}

        def lost(delivery: Delivery, gone: set[Delivery] = gone, share: dict[str, float] = share) -> bool:
            if rng.random() < share[delivery.kind]:
                gone.add(delivery)
            return delivery in gone

        answers = team.tick(observation, rng, lost, tick)
        present = [robot for robot in range(robots) if Delivery("observation", robot) not in gone]
        assert answers.keys() == set(present)

        def came(sender: int, to: int, number: int, present: list[int] = present, gone: set[Delivery] = gone) -> bool:
            if relayed:
                way = {Delivery("relay", 0, sender, number), Delivery("bundle", to, round=number)}
            else:
                way = {Delivery("message", team.crew_of(to)[0], sender, number)}
            return sender in present and not way & gone

        audible = [row[row >= 0].tolist() for row in observation.heard]
        rounds = range(len(policy.config.message_sizes))
        heard = [[[j for j in audible[i] if came(j, i, number)] for i in range(robots)] for number in rounds]
        assert_decided(answers, reference(policy, observation, heard, tick))
        for robot, answer in answers.items():
            expected = sum(len(audible[robot]) - len(lists[robot]) for lists in heard)
            assert answer.missing == expected
            assert answer.heard == max(len(audible[robot]) - expected, 0)
            missing += expected
        assert sum(crew.missing for crew in team.crews) == missing
