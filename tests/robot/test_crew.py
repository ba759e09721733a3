# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A single crew, step by step: what it waits for, what it can do without, and what it drops."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from magat_robot.crew import Answer, Crew, Message, ReceivedObservation
from magat_robot.exchange import MOST_MESSAGES
from magat_robot.policy.policy import Policy

EPISODE = 77


@pytest.fixture
def four_rounds(small_policy: Callable) -> Policy:
    """A policy whose robots exchange messages in four rounds."""
    return small_policy("MAGAT-F-8-P3", taps=3, layers=2)


@pytest.fixture
def one_round(small_policy: Callable) -> Policy:
    """A policy whose robots exchange messages in one round."""
    return small_policy("MAGAT-F-16")


class Log:
    """A crew, with a log of its messages and answers."""

    def __init__(self, policy: Policy, robots: int, relayed: bool = False) -> None:
        self.policy = policy
        self.sent: list[tuple[int, Message]] = []
        self.answers: list[tuple[int, Answer]] = []
        self.crew = Crew(
            policy,
            robots,
            lambda robot, message: self.sent.append((robot, message)),
            lambda robot, answer: self.answers.append((robot, answer)),
            relayed,
        )
        rng = np.random.default_rng(12)
        self.fields_of_view = (rng.random((8, 3, 11, 11)) < 0.2).astype(np.uint8)
        #: Messages of eight robots outside the crew, in every round.
        size = [(rng.random((8, n)) * 8 * 64).astype(int) / 64 for n in policy.config.message_sizes]
        self.others = [values.astype("<f4") for values in size]

    def observation(
        self, robot: int, tick: int = 0, audible: Sequence[int] = (), episode: int = EPISODE
    ) -> ReceivedObservation:
        """An observation of a robot; its own tag is its number + 1000 * (tick + 1)."""
        tag = robot + 1000 * (tick + 1)
        return ReceivedObservation(episode, tick, robot, tag, frozenset(audible), self.fields_of_view[robot].tobytes())

    def see(self, robot: int, tick: int = 0, audible: Sequence[int] = (), episode: int = EPISODE) -> bool:
        return self.crew.see(robot, self.observation(robot, tick, audible, episode))

    def message(self, stranger: int, tick: int = 0, number: int = 0, **changes: object) -> Message:
        """The message of ``stranger``, a robot outside the crew, in round ``number``; its tag is its number + 1."""
        data = self.others[number][stranger].tobytes()
        return replace(Message(EPISODE, tick, number, stranger + 1, data), **changes)

    def hear(self, stranger: int, tick: int = 0, number: int = 0, **changes: object) -> None:
        self.crew.hear(self.message(stranger, tick, number, **changes))

    def bundle(self, robot: int, strangers: Sequence[int] = (), tick: int = 0, number: int = 0, **at: int) -> None:
        data = [self.others[number][stranger].tobytes() for stranger in strangers]
        self.crew.hear_bundle(robot, at.get("episode", EPISODE), tick, number, data)

    def expected(self, robot: int, *heard: Sequence[int], tick: int = 0) -> tuple[list[float], int]:
        """The decision of a robot that hears the given robots outside the crew in each round."""
        own = self.policy.perceive(self.fields_of_view[robot : robot + 1])
        for number, strangers in enumerate(heard):
            values = self.others[number][list(strangers)][None]
            own = self.policy.hear(own, values, np.ones(values.shape[:2], bool))
        decision = self.policy.decide(own, np.array([robot], np.uint64), tick)
        return decision.log_probabilities[0].tolist(), int(decision.primitives[0])

    def decided(self) -> dict[int, tuple[list[float], int]]:
        """The answers since the last call."""
        result = {robot: (answer.log_probabilities.tolist(), answer.primitive) for robot, answer in self.answers}
        assert len(result) == len(self.answers)
        self.answers.clear()
        return result

    @property
    def drops(self) -> int:
        return self.crew.exchange.dropped

    @property
    def last_drop(self) -> str:
        return self.crew.exchange.last_drop


def test_a_robot_that_hears_nobody_decides_at_once(one_round: Policy) -> None:
    log = Log(one_round, 1)
    assert log.see(0)
    assert log.decided() == {0: log.expected(0, [])}
    assert [message.tag for _, message in log.sent] == [1000]
    assert not log.crew.waiting


def test_a_robot_waits_for_all_that_it_can_hear_and_for_nobody_else(one_round: Policy) -> None:
    log = Log(one_round, 1)
    log.see(0, audible=[1, 2, 3])
    for stranger in (2, 6, 0):  # 6 is out of range
        log.hear(stranger)
        assert log.crew.waiting
        assert log.decided() == {}
    log.hear(1)
    assert log.decided() == {0: log.expected(0, [0, 1, 2])}
    assert (log.drops, log.crew.missing) == (0, 0)


def test_what_came_before_the_observation_counts(four_rounds: Policy) -> None:
    log = Log(four_rounds, 1)
    for number in range(3):
        for stranger in (0, 1, 4):
            log.hear(stranger, number=number)
    log.see(0, audible=[1, 2])
    assert [message.round for _, message in log.sent] == [0, 1, 2, 3]
    log.hear(1, number=3)
    log.hear(0, number=3)
    assert log.decided() == {0: log.expected(0, *[[0, 1]] * 4)}
    assert log.drops == 0


def test_the_robots_of_a_crew_look_when_all_of_them_can(one_round: Policy) -> None:
    log = Log(one_round, 3)
    assert log.see(2, audible=[1])
    assert not log.see(0, audible=[2])
    assert (log.sent, log.crew.waiting) == ([], True)
    log.hear(0)
    assert not log.see(1)
    assert sorted((robot, message.tag) for robot, message in log.sent) == [(0, 1000), (1, 1001), (2, 1002)]
    log.hear(1)
    assert log.decided() == {0: log.expected(0, [1]), 1: log.expected(1, []), 2: log.expected(2, [0])}


def test_a_robot_without_an_observation_is_silent_and_the_others_go_on(one_round: Policy) -> None:
    log = Log(one_round, 3)
    log.see(0)
    log.see(2, audible=[1000, 1001])  # the other robots of its crew
    log.crew.overdue()
    assert [robot for robot, _ in log.sent] == [0, 2]
    assert not log.see(1), "too late"
    assert (log.drops, len(log.sent)) == (1, 2)
    assert "late" in log.last_drop
    log.crew.hear(log.sent[0][1])
    log.crew.overdue()
    assert log.decided().keys() == {0, 2}
    assert not log.see(1)
    assert (log.drops, log.crew.waiting, log.crew.missing) == (2, False, 1)
    # The next tick works again.
    assert log.see(1, tick=1)
    log.see(0, tick=1)
    log.see(2, tick=1)
    assert log.decided() == {robot: log.expected(robot, [], tick=1) for robot in range(3)}


def test_a_message_that_is_lost_is_missing(one_round: Policy) -> None:
    log = Log(one_round, 2)
    log.see(0, audible=[1, 2, 3])
    log.see(1, audible=[3])
    log.hear(0)
    log.hear(1)
    log.crew.overdue()
    assert [(answer.heard, answer.missing) for _, answer in log.answers] == [(2, 1), (0, 1)]
    assert log.decided() == {0: log.expected(0, [0, 1]), 1: log.expected(1, [])}
    assert (log.crew.missing, log.drops) == (2, 0)


def test_messages_missing_in_several_rounds_are_all_counted(four_rounds: Policy) -> None:
    log = Log(four_rounds, 1)
    log.see(0, audible=[1, 2])
    for number, strangers in enumerate([[0], [0, 1], [], [1]]):
        for stranger in strangers:
            log.hear(stranger, number=number)
        if number != 1:
            assert log.sent[-1][1].round == number
            log.crew.overdue()
    (_, answer), *_ = log.answers
    # heard is the number of announced messages minus those missing over all rounds, at least 0.
    assert (answer.heard, answer.missing, log.crew.missing) == (0, 4, 4)
    assert log.decided() == {0: log.expected(0, [0], [0, 1], [], [1])}


def test_a_late_message_changes_nothing(one_round: Policy) -> None:
    log = Log(one_round, 1)
    log.see(0, audible=[1, 2])
    log.hear(0)
    log.crew.overdue()
    log.hear(1)  # of a tick that is decided
    log.crew.overdue()
    assert log.decided() == {0: log.expected(0, [0])}
    log.see(0, tick=1, audible=[1, 2])
    log.hear(0, tick=0)
    assert (log.drops, log.crew.waiting) == (1, True)
    assert "late" in log.last_drop
    log.hear(0, tick=1)
    log.hear(1, tick=1)
    assert log.decided() == {0: log.expected(0, [0, 1], tick=1)}
    assert (len(log.sent), log.crew.missing) == (2, 1)


@pytest.mark.parametrize("relayed", [False, True], ids=["direct", "relayed"])
def test_a_deadline_with_nothing_under_way_does_nothing(one_round: Policy, relayed: bool) -> None:
    log = Log(one_round, 2, relayed)
    log.crew.overdue()
    log.see(0)
    log.see(1)
    for robot in range(2) if relayed else ():
        log.bundle(robot)
    assert len(log.answers) == 2
    log.crew.overdue()
    assert (len(log.answers), len(log.sent), log.drops) == (2, 2, 0)


@pytest.mark.parametrize("relayed", [False, True], ids=["direct", "relayed"])
def test_the_deadline_ends_each_phase_once(four_rounds: Policy, relayed: bool) -> None:
    log = Log(four_rounds, 2, relayed)
    log.see(1, audible=[1, 2])
    for phase in range(5):
        assert log.answers == []
        log.crew.overdue()
        assert len(log.sent) == min(phase + 1, 4)
    ((robot, answer),) = log.answers
    assert (robot, answer.heard, answer.missing) == (1, 0, 8)
    assert log.decided() == {1: log.expected(1, [], [], [], [])}
    log.crew.overdue()
    assert (log.answers, len(log.sent)) == ([], 4)


@pytest.mark.parametrize("relayed", [False, True], ids=["direct", "relayed"])
@pytest.mark.parametrize("phase", ["before all looked", "in the first round", "in a later round"])
def test_a_tick_is_abandoned_when_the_next_one_begins(four_rounds: Policy, relayed: bool, phase: str) -> None:
    log = Log(four_rounds, 2, relayed)
    log.see(0, audible=[1])
    if phase != "before all looked":
        log.see(1)
    if phase == "in a later round":
        log.bundle(0, [0]) if relayed else log.hear(0)
        log.bundle(1) if relayed else None
        assert log.sent[-1][1].round == 1
    sent, drops = len(log.sent), log.drops
    assert log.see(1, tick=1), "a tick begins"
    assert not log.see(0, tick=0), "and what was missing of the old one is late"
    assert (log.drops, len(log.sent)) == (drops + 1, sent)
    assert not log.see(0, tick=1, audible=[2])
    assert [(message.tick, message.round) for _, message in log.sent[sent:]] == [(1, 0)] * 2
    if not relayed:
        log.hear(0, number=1)  # of the old tick, which it was waiting for
    for number in range(4):
        assert log.answers == []
        log.bundle(0, [1], tick=1, number=number) if relayed else log.hear(1, tick=1, number=number)
        log.bundle(1, tick=1, number=number) if relayed else None
    assert {answer.observation.tick for _, answer in log.answers} == {1}
    heard = [[1]] * 4
    assert log.decided() == {0: log.expected(0, *heard, tick=1), 1: log.expected(1, *[[]] * 4, tick=1)}
    assert log.crew.missing == 0


def test_another_episode_begins_at_any_tick(one_round: Policy) -> None:
    log = Log(one_round, 1)
    log.see(0, tick=9, audible=[1])
    log.hear(1, tick=0, episode=EPISODE + 1)
    assert log.see(0, tick=0, audible=[2], episode=EPISODE + 1)
    assert log.decided() == {0: log.expected(0, [1])}
    assert log.drops == 0
    assert [(message.episode, message.tick) for _, message in log.sent] == [(EPISODE, 9), (EPISODE + 1, 0)]


def test_an_observation_that_announces_more_than_can_be_heard_is_dropped(one_round: Policy) -> None:
    log = Log(one_round, 1)
    assert not log.see(0, audible=range(MOST_MESSAGES + 1))
    assert (log.drops, log.sent, log.crew.waiting) == (1, [], False)
    assert "announces 4097 messages" in log.last_drop
    assert log.see(0, audible=range(MOST_MESSAGES))


def test_a_repeated_observation_is_dropped_in_every_phase(one_round: Policy) -> None:
    log = Log(one_round, 2)
    log.see(0, audible=[1])
    other = replace(log.observation(0), own_tag=5, field_of_view=log.fields_of_view[7].tobytes())
    repeated = 0
    for step in (lambda: None, partial(log.see, 1), partial(log.hear, 0), lambda: None):
        step()
        for observation in (log.observation(0, audible=[1]), other):
            assert not log.crew.see(0, observation)
            repeated += 1
            assert log.drops == repeated
            assert "repeated" in log.last_drop
    assert log.decided() == {0: log.expected(0, [0]), 1: log.expected(1, [])}
    assert {message.tag for _, message in log.sent} == {1000, 1001}


def test_an_earlier_observation_is_dropped(one_round: Policy) -> None:
    log = Log(one_round, 1)
    log.see(0, tick=5)
    for tick in (4, 0):
        assert not log.see(0, tick=tick)
        assert f"late observation, of tick {tick} after 5" in log.last_drop
    assert (log.drops, len(log.answers), len(log.sent)) == (2, 1, 1)


@pytest.mark.parametrize(
    ("field_of_view", "why"),
    [
        (b"", "0 numbers"),
        (bytes(5), "5 numbers"),
        (bytes(362), "362 numbers"),
        (bytes(364), "364 numbers"),
        (bytes(362) + b"\2", "holds 2"),
        (b"\xff" + bytes(362), "holds 255"),
    ],
    ids=["empty", "short", "one less", "one more", "a two", "a 255"],
)
def test_a_wrong_view_is_dropped_and_a_good_one_may_follow(one_round: Policy, field_of_view: bytes, why: str) -> None:
    log = Log(one_round, 2)
    for wrong in (0, 1):
        assert not log.crew.see(wrong, replace(log.observation(wrong), field_of_view=field_of_view))
        assert why in log.last_drop
        assert log.see(wrong) == (wrong == 0)
    assert log.drops == 2
    assert log.decided() == {robot: log.expected(robot, []) for robot in range(2)}


def test_a_sender_in_nobodys_range_is_not_heard_and_no_fault(one_round: Policy) -> None:
    log = Log(one_round, 2)
    log.hear(5)
    log.see(0, audible=[1])
    log.hear(6)
    log.see(1, audible=[2])
    log.hear(7)
    log.hear(0)
    log.hear(1)
    assert log.decided() == {0: log.expected(0, [0]), 1: log.expected(1, [1])}
    assert (log.drops, log.crew.missing) == (0, 0)


def test_robots_of_one_crew_hear_each_other_over_the_radio_only(one_round: Policy) -> None:
    log = Log(one_round, 2)
    log.see(0, audible=[1001])
    log.see(1, audible=[1000])
    log.crew.overdue()
    assert log.decided() == {0: log.expected(0, []), 1: log.expected(1, [])}
    assert log.crew.missing == 2


@pytest.mark.parametrize(
    ("value", "why"), [(np.nan, "multiples"), (1e30, "multiples"), (-0.25, "multiples"), (0.001, "multiples")], ids=str
)
@pytest.mark.parametrize("relayed", [False, True], ids=["direct", "relayed"])
def test_a_message_that_no_robot_sends_is_dropped_counted_and_missing(
    one_round: Policy, relayed: bool, value: float, why: str
) -> None:
    bad = np.full(16, value, "<f4").tobytes()
    log = Log(one_round, 1, relayed)
    log.see(0, audible=[1, 2, 3])
    if relayed:
        log.crew.hear_bundle(0, EPISODE, 0, 0, [bad, log.others[0][1].tobytes(), bad])
    else:
        # Two equal messages count twice.
        log.hear(0, payload=bad)
        log.hear(1)
        log.hear(2, payload=bad)
    ((_, answer),) = log.answers
    assert (answer.heard, answer.missing) == (1, 2)
    assert log.decided() == {0: log.expected(0, [1])}
    assert (log.drops, log.crew.missing) == (2, 2)
    assert why in log.last_drop


@pytest.mark.parametrize("payload", [b"", b"abc", bytes(63), bytes(65)], ids=len)
@pytest.mark.parametrize("relayed", [False, True], ids=["direct", "relayed"])
def test_a_message_of_another_size_is_dropped_and_counted(one_round: Policy, relayed: bool, payload: bytes) -> None:
    log = Log(one_round, 1, relayed)
    log.see(0, audible=[1, 2])
    if relayed:
        log.crew.hear_bundle(0, EPISODE, 0, 0, [payload, log.others[0][1].tobytes()])
    else:
        log.hear(0, payload=payload)
        log.hear(1)
        log.crew.overdue()
    assert (log.drops, log.crew.missing) == (1, 1)
    assert f"{len(payload)} bytes, not 64" in log.last_drop
    assert log.decided() == {0: log.expected(0, [1])}


def test_a_second_message_under_one_tag_is_dropped_and_the_first_one_counts(four_rounds: Policy) -> None:
    log = Log(four_rounds, 1)
    log.see(0, audible=[1, 2])
    log.hear(0)
    log.hear(0, payload=log.others[0][3].tobytes())
    assert log.drops == 1
    log.hear(1)
    log.hear(1)  # its round is over
    assert log.drops == 2
    for number in (1, 2, 3):
        log.hear(0, number=number)
        log.hear(1, number=number)
    assert log.decided() == {0: log.expected(0, *[[0, 1]] * 4)}


# --- Bundles ---


def test_a_crew_decides_when_all_its_bundles_are_there(four_rounds: Policy) -> None:
    log = Log(four_rounds, 2, relayed=True)
    log.see(0, audible=[1, 2])
    log.see(1, audible=[3])
    for number in range(4):
        assert [message.round for _, message in log.sent] == [i for i in range(number + 1) for _ in range(2)]
        log.bundle(1, [2], number=number)
        assert log.answers == []
        log.bundle(0, [1, 0], number=number)
    assert log.decided() == {0: log.expected(0, *[[0, 1]] * 4), 1: log.expected(1, *[[2]] * 4)}
    assert (log.drops, log.crew.missing) == (0, 0)


def test_a_robot_that_hears_nobody_waits_for_its_bundle_too(one_round: Policy) -> None:
    log = Log(one_round, 1, relayed=True)
    log.see(0)
    assert log.crew.waiting
    log.bundle(0)
    assert log.decided() == {0: log.expected(0, [])}


def test_a_bundle_that_is_lost_leaves_its_robot_deaf_and_no_other(one_round: Policy) -> None:
    log = Log(one_round, 2, relayed=True)
    log.see(0, audible=[1, 2])
    log.see(1, audible=[1, 2, 3])
    log.bundle(0, [0, 1])
    log.crew.overdue()
    assert [(answer.heard, answer.missing) for _, answer in log.answers] == [(2, 0), (0, 3)]
    assert log.decided() == {0: log.expected(0, [0, 1]), 1: log.expected(1, [])}


def test_a_bundle_lacks_what_was_lost_on_the_way_to_the_relay(one_round: Policy) -> None:
    log = Log(one_round, 1, relayed=True)
    log.see(0, audible=[1, 2, 3])
    log.bundle(0, [2])
    ((_, answer),) = log.answers
    assert (answer.heard, answer.missing) == (1, 2)
    assert log.decided() == {0: log.expected(0, [2])}


def test_bundles_that_nobody_waits_for_are_dropped_and_counted(four_rounds: Policy) -> None:
    log = Log(four_rounds, 2, relayed=True)
    drops = 0

    def dropped(robot: int, *strangers: int, **at: int) -> None:
        nonlocal drops
        before = len(log.sent), len(log.answers)
        log.bundle(robot, strangers, **at)
        drops += 1
        assert log.drops == drops
        assert "bundle" in log.last_drop
        assert (len(log.sent), len(log.answers)) == before

    dropped(0, 4)  # before the first tick
    log.see(0, audible=[1])
    dropped(2, 4)  # there is no such robot
    log.see(1, audible=[1])
    for number in range(4):
        for wrong in ({"number": 3 - number}, {"tick": 1}, {"episode": EPISODE + 1}):
            at = {"number": number} | wrong
            if at != {"number": number}:
                dropped(0, 4, **at)
        dropped(2, 4, number=number)  # there is no such robot
        log.bundle(0, [0], number=number)
        dropped(0, 4, number=number)  # a second one
        log.bundle(1, [0], number=number)
        dropped(1, 4, number=number)  # when the round is over
    assert log.decided() == {robot: log.expected(robot, *[[0]] * 4) for robot in range(2)}


def test_a_bundle_that_comes_before_all_have_looked_is_kept(four_rounds: Policy) -> None:
    """If one robot of the crew misses its observation, bundles for the others arrive before this process goes on."""
    log = Log(four_rounds, 3, relayed=True)
    for robot in (0, 2):
        log.see(robot, audible=[1])
    log.bundle(0, [0])
    log.bundle(1, [4])
    log.bundle(0, [5])
    assert (log.drops, log.sent) == (1, [])
    log.crew.overdue()
    assert len(log.sent) == 2
    log.bundle(2, [0])
    assert len(log.sent) == 4, "the next round"
    for number in range(1, 4):
        for robot in (0, 2):
            log.bundle(robot, [0], number=number)
    assert log.decided() == {robot: log.expected(robot, *[[0]] * 4) for robot in (0, 2)}
    # Bundles are kept for one tick only.
    for robot in range(3):
        log.see(robot, tick=1, audible=[1])
    sent = len(log.sent)
    for robot in range(3):
        assert len(log.sent) == sent
        log.bundle(robot, [0], tick=1)
    assert (log.drops, len(log.sent)) == (1, sent + 3)


def test_a_bundle_after_the_deadline_is_dropped(one_round: Policy) -> None:
    log = Log(one_round, 1, relayed=True)
    log.see(0, audible=[1])
    log.crew.overdue()
    log.bundle(0, [0])
    assert (log.drops, len(log.answers)) == (1, 1)


# --- Messages from outside the team ---


def test_a_flood_of_messages_drowns_none_that_can_be_heard(one_round: Policy) -> None:
    log = Log(one_round, 1)
    log.see(0, audible=[1, 2])
    log.hear(0)
    data = log.others[0][3].tobytes()
    for tag in range(100, 20_000):
        log.hear(3, tag=tag, payload=data)
    log.hear(1)
    assert log.decided() == {0: log.expected(0, [0, 1])}
    assert log.drops == 0


def test_the_robots_of_a_crew_send_in_random_order(four_rounds: Policy) -> None:
    """In a fixed order, the place of a message among those of its crew would link it to its sender, tick by tick."""
    log = Log(four_rounds, 3)
    for tick in range(30):
        for robot in range(3):
            log.see(robot, tick)
    senders = [robot for robot, _ in log.sent]
    orders = [tuple(senders[i : i + 3]) for i in range(0, len(senders), 3)]
    assert len(orders) == 30 * 4
    assert set(orders) == set(itertools.permutations(range(3)))
    first = [order[0] for order in orders]
    assert all(15 < first.count(robot) < 68 for robot in range(3))  # 40 on average, with a standard deviation of 5.2
