# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The exchange keeps valid messages of this tick from robots in range, once each, and drops or ignores others."""

import pickle

import pytest

from magat_robot import exchange as module
from magat_robot.exchange import EARLY_TICKS, FOREIGN_ROUNDS, Exchange

GOOD, OTHER = b"twelve bytes", b"and 12 more."
LONG = b"of the second round"


@pytest.fixture
def exchange() -> Exchange:
    """An exchange in tick 5 of episode 2, with two rounds; the tags 10, 11 and 12 are audible."""
    exchange = Exchange([len(GOOD), len(LONG)])
    exchange.begin(2, 5)
    exchange.listen(frozenset([10, 11, 12]))
    return exchange


def begin(exchange: Exchange, episode: int, tick: int, audible: list[int]) -> dict[int, bytes]:
    """Begin a tick in which the tags ``audible`` are audible; returns the messages of its first round so far."""
    exchange.begin(episode, tick)
    exchange.listen(frozenset(audible))
    return exchange.kept(0)


def test_messages_of_this_tick_are_taken_by_round_and_tag(exchange: Exchange) -> None:
    assert (exchange.kept(0), exchange.kept(1)) == ({}, {})
    assert exchange.receive(2, 5, 0, 11, GOOD)
    assert exchange.receive(2, 5, 1, 11, LONG)
    assert exchange.receive(2, 5, 0, 10, OTHER)
    assert (exchange.kept(0), exchange.kept(1)) == ({11: GOOD, 10: OTHER}, {11: LONG})
    assert exchange.dropped == 0


def test_early_messages_wait_for_their_tick(exchange: Exchange) -> None:
    assert not exchange.receive(2, 6, 0, 20, GOOD)
    assert not exchange.receive(2, 7, 0, 30, OTHER)
    assert not exchange.receive(2, 7, 1, 30, LONG)
    assert exchange.kept(0) == {}
    assert begin(exchange, 2, 6, [20, 21]) == {20: GOOD}
    assert begin(exchange, 2, 7, [30]) == {30: OTHER}
    assert (exchange.kept(1), exchange.dropped) == ({30: LONG}, 0)


def test_messages_of_the_next_episode_wait_while_this_one_ends(exchange: Exchange) -> None:
    exchange.receive(3, 0, 0, 40, GOOD)
    assert begin(exchange, 2, 6, []) == {}
    assert begin(exchange, 3, 0, [40]) == {40: GOOD}


def test_messages_may_come_before_the_very_first_observation() -> None:
    exchange = Exchange([len(GOOD)])
    assert exchange.kept(0) == {}
    assert not exchange.receive(1, 0, 0, 10, GOOD)
    assert begin(exchange, 1, 0, [10]) == {10: GOOD}


def test_messages_of_this_tick_wait_until_it_is_known_who_can_be_heard(exchange: Exchange) -> None:
    """The robots of one process do not receive their observations at the same time."""
    exchange.begin(2, 6)
    for tag in (20, 21, 22):
        assert exchange.receive(2, 6, 0, tag, GOOD)
        assert exchange.receive(2, 6, 1, tag, LONG)
    exchange.listen(frozenset([20, 22, 23]))
    assert exchange.kept(0).keys() == exchange.kept(1).keys() == {20, 22}
    assert exchange.receive(2, 6, 0, 23, OTHER)
    assert exchange.kept(0) == {20: GOOD, 22: GOOD, 23: OTHER}
    assert exchange.dropped == 0


def test_early_messages_out_of_range_are_not_heard(exchange: Exchange) -> None:
    exchange.receive(2, 6, 0, 20, GOOD)
    exchange.receive(2, 6, 0, 21, OTHER)
    assert begin(exchange, 2, 6, [21]) == {21: OTHER}
    assert exchange.dropped == 0


def test_an_unknown_tag_is_somebody_out_of_range_and_no_fault(exchange: Exchange) -> None:
    for number, content in enumerate((GOOD, LONG)):
        assert not exchange.receive(2, 5, number, 99, content)
    assert (exchange.dropped, exchange.kept(0), exchange.kept(1)) == (0, {}, {})


def test_who_is_in_range_in_one_tick_is_not_so_in_the_next(exchange: Exchange) -> None:
    exchange.begin(2, 6)
    assert exchange.receive(2, 6, 0, 99, GOOD), "nobody knows yet"
    exchange.listen(frozenset([99]))
    assert not exchange.receive(2, 6, 0, 10, GOOD)
    assert exchange.kept(0) == {99: GOOD}


def test_late_messages_are_dropped_even_under_a_tag_of_this_tick(exchange: Exchange) -> None:
    assert not exchange.receive(2, 4, 0, 10, GOOD)
    assert (exchange.dropped, exchange.kept(0)) == (1, {})
    assert "late" in exchange.last_drop
    assert "tick 4" in exchange.last_drop


def test_messages_far_ahead_are_dropped(exchange: Exchange) -> None:
    exchange.receive(2, 5 + EARLY_TICKS, 0, 20, GOOD)
    assert exchange.dropped == 0
    assert not exchange.receive(2, 6 + EARLY_TICKS, 0, 20, GOOD)
    assert exchange.dropped == 1
    assert "far ahead" in exchange.last_drop
    assert begin(exchange, 2, 5 + EARLY_TICKS, [20]) == {20: GOOD}


def test_messages_of_rounds_that_the_policy_does_not_have_are_dropped(exchange: Exchange) -> None:
    for tick in (5, 6):
        assert not exchange.receive(2, tick, 2, 10, GOOD)
    assert not exchange.receive(9, 0, 255, 10, LONG)
    assert exchange.dropped == 3
    assert "round 255" in exchange.last_drop
    assert "0 to 1" in exchange.last_drop


def test_what_was_heard_does_not_reach_into_the_next_tick(exchange: Exchange) -> None:
    exchange.receive(2, 5, 0, 10, GOOD)
    assert begin(exchange, 2, 6, [10]) == {}
    exchange.receive(2, 8, 0, 10, GOOD)
    assert begin(exchange, 2, 9, [10]) == {}  # tick 8 was missed, so its messages are late
    assert begin(exchange, 2, 8, [10]) == {}


def test_the_first_of_two_messages_under_one_tag_counts(exchange: Exchange) -> None:
    assert exchange.receive(2, 5, 0, 10, GOOD)
    assert not exchange.receive(2, 5, 0, 10, OTHER)
    exchange.receive(2, 6, 0, 20, OTHER)
    assert not exchange.receive(2, 6, 0, 20, GOOD)
    assert exchange.dropped == 2
    assert "repeated" in exchange.last_drop
    assert exchange.kept(0) == {10: GOOD}
    assert begin(exchange, 2, 6, [20]) == {20: OTHER}


@pytest.mark.parametrize(
    ("number", "bad", "why"),
    [
        pytest.param(0, b"", "0 bytes, not 12", id="empty"),
        pytest.param(0, GOOD[:-1], "11 bytes, not 12", id="too short"),
        pytest.param(0, GOOD + b"\0", "13 bytes, not 12", id="too long"),
        pytest.param(0, LONG, "19 bytes, not 12", id="of the second round"),
        pytest.param(1, GOOD, "12 bytes, not 19", id="of the first round"),
    ],
)
@pytest.mark.parametrize("tick", [5, 6], ids=["now", "early"])
def test_a_message_of_a_size_that_no_robot_sends_is_dropped_and_may_be_sent_again(
    exchange: Exchange, number: int, bad: bytes, why: str, tick: int
) -> None:
    assert not exchange.receive(2, tick, number, 10, bad)
    assert exchange.dropped == 1
    assert why in exchange.last_drop
    good = (GOOD, LONG)[number]
    exchange.receive(2, tick, number, 10, good)
    if tick == 6:
        begin(exchange, 2, 6, [10])
    assert exchange.kept(number) == {10: good}
    assert exchange.dropped == 1


def test_robots_that_do_not_talk_exchange_messages_of_no_bytes() -> None:
    exchange = Exchange([0])
    begin(exchange, 0, 0, [10])
    assert exchange.receive(0, 0, 0, 10, b"")
    assert exchange.kept(0) == {10: b""}


def test_a_round_can_take_only_so_many_early_messages(exchange: Exchange, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_MESSAGES", 10)
    for tag in range(12):
        exchange.receive(2, 6, 0, tag, GOOD)
    assert exchange.dropped == 2
    assert "more than 10" in exchange.last_drop
    assert len(begin(exchange, 2, 6, list(range(12)))) == 10


def test_early_messages_have_room_for_more_than_the_largest_team(exchange: Exchange) -> None:
    for tag in range(1000):
        exchange.receive(2, 6, 0, tag, GOOD)
    assert len(begin(exchange, 2, 6, list(range(1000)))) == 1000


def test_episodes_are_forgotten_in_the_order_in_which_they_were_first_heard_of(exchange: Exchange) -> None:
    for episode in range(3, 4 + FOREIGN_ROUNDS):
        exchange.receive(episode, 0, 0, 10, GOOD)
    exchange.receive(2, 6, 0, 20, OTHER)
    assert begin(exchange, 2, 6, [20]) == {20: OTHER}, "this episode is none of them"
    assert begin(exchange, 4, 0, [10]) == {10: GOOD}
    assert begin(exchange, 3, 0, [10]) == {}


@pytest.mark.parametrize("content", [GOOD, b"too short"], ids=["sound", "short"])
@pytest.mark.parametrize("where", ["ticks", "episodes", "both", "rounds", "tags now", "no episode"])
def test_no_flood_fills_a_robots_memory(exchange: Exchange, where: str, content: bytes) -> None:
    if where == "no episode":
        exchange = Exchange([len(GOOD), len(LONG)])  # before the first tick
    for i in range(20_000):
        episode = 3 + i if where in ("episodes", "both", "rounds") else 0 if where == "no episode" else 2
        tick = {"ticks": 6 + i, "both": i % 7, "tags now": 5, "no episode": i}.get(where, 0)
        exchange.receive(episode, tick, i % 300 if where == "rounds" else 0, 1000 + i, content)
    assert len(pickle.dumps(exchange)) < 20_000  # a kept message takes more than 100 bytes
    # The exchange still works.
    begin(exchange, 2, 5, [10]) if where == "no episode" else None
    exchange.receive(2, 5, 0, 10, GOOD)
    assert exchange.kept(0) == {10: GOOD}
    exchange.receive(2, 6, 0, 20, GOOD)
    assert begin(exchange, 2, 6, [20]) == {20: GOOD}


def test_large_messages_do_not_fill_it_either(exchange: Exchange) -> None:
    large = bytes(1_000_000)
    for tick in (5, 6):
        for tag in range(1000):
            exchange.receive(2, tick, 0, tag, large)
    assert len(pickle.dumps(exchange)) < 20_000
    assert exchange.dropped == 1003  # the audible ones of this tick
