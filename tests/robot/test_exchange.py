"""Which messages count: those of this tick that can be heard, once each, in good order."""

import pickle

import numpy as np
import pytest

from magat_robot import exchange as module
from magat_robot.exchange import Exchange


def payload(*values: float) -> bytes:
    return np.array(values, dtype="<f4").tobytes()


GOOD = payload(0.0, 0.25, 8.0)


@pytest.fixture
def exchange() -> Exchange:
    """In tick 5 of episode 2, in which the tags 10, 11 and 12 can be heard."""
    exchange = Exchange(features=3)
    exchange.begin(2, 5, [10, 11, 12])
    return exchange


def heard(exchange: Exchange) -> list[list[float]]:
    return sorted(exchange.messages().tolist())


def test_messages_of_this_tick_are_taken_until_all_are_there(exchange: Exchange) -> None:
    assert (exchange.complete, exchange.missing) == (False, 3)
    assert exchange.receive(2, 5, 11, GOOD)
    assert exchange.receive(2, 5, 10, payload(1, 2, 3))
    assert (exchange.complete, exchange.missing) == (False, 1)
    assert exchange.receive(2, 5, 12, payload(4, 5, 6))
    assert (exchange.complete, exchange.missing, exchange.dropped) == (True, 0, 0)
    assert exchange.messages().dtype == np.float32
    assert heard(exchange) == [[0, 0.25, 8], [1, 2, 3], [4, 5, 6]]


def test_who_can_hear_nobody_has_all_messages_at_once() -> None:
    exchange = Exchange(features=3)
    exchange.begin(0, 0, [])
    assert (exchange.complete, exchange.missing) == (True, 0)
    assert exchange.messages().shape == (0, 3)
    assert exchange.messages().dtype == np.float32


def test_a_missing_message_leaves_those_that_came(exchange: Exchange) -> None:
    exchange.receive(2, 5, 12, GOOD)
    assert (exchange.missing, heard(exchange)) == (2, [[0, 0.25, 8]])


def test_early_messages_wait_for_their_tick(exchange: Exchange) -> None:
    assert not exchange.receive(2, 6, 20, GOOD)
    assert not exchange.receive(2, 7, 30, payload(7, 7, 7))
    assert exchange.messages().shape == (0, 3)
    exchange.begin(2, 6, [20, 21])
    assert (exchange.missing, heard(exchange)) == (1, [[0, 0.25, 8]])
    exchange.begin(2, 7, [30])
    assert (exchange.complete, heard(exchange), exchange.dropped) == (True, [[7, 7, 7]], 0)


def test_messages_of_the_next_episode_wait_while_this_one_ends(exchange: Exchange) -> None:
    exchange.receive(3, 0, 40, GOOD)
    exchange.begin(2, 6, [])
    assert exchange.complete
    exchange.begin(3, 0, [40])
    assert exchange.complete
    assert heard(exchange) == [[0, 0.25, 8]]


def test_messages_may_come_before_the_very_first_observation() -> None:
    exchange = Exchange(features=3)
    assert exchange.messages().shape == (0, 3)
    assert not exchange.receive(1, 0, 10, GOOD)
    exchange.begin(1, 0, [10])
    assert exchange.complete


def test_early_messages_out_of_range_are_not_heard(exchange: Exchange) -> None:
    exchange.receive(2, 6, 20, GOOD)
    exchange.receive(2, 6, 21, payload(1, 1, 1))
    exchange.begin(2, 6, [21])
    assert (exchange.complete, heard(exchange), exchange.dropped) == (True, [[1, 1, 1]], 0)


def test_an_unknown_tag_is_somebody_out_of_range_and_no_fault(exchange: Exchange) -> None:
    assert not exchange.receive(2, 5, 99, GOOD)
    assert (exchange.dropped, exchange.missing, exchange.messages().shape) == (0, 3, (0, 3))


def test_late_messages_are_dropped_even_under_a_tag_of_this_tick(exchange: Exchange) -> None:
    assert not exchange.receive(2, 4, 10, GOOD)
    assert (exchange.dropped, exchange.missing) == (1, 3)
    assert "late" in exchange.last_drop
    assert "tick 4" in exchange.last_drop


def test_what_was_heard_does_not_reach_into_the_next_tick(exchange: Exchange) -> None:
    exchange.receive(2, 5, 10, GOOD)
    exchange.begin(2, 6, [10])
    assert (exchange.missing, exchange.messages().shape) == (1, (0, 3))
    exchange.receive(2, 8, 10, GOOD)
    exchange.begin(2, 9, [10])  # tick 8 was missed; what waited for it is late by now
    assert exchange.missing == 1
    exchange.begin(2, 8, [10])
    assert exchange.missing == 1


def test_the_first_of_two_messages_under_one_tag_counts(exchange: Exchange) -> None:
    assert exchange.receive(2, 5, 10, payload(1, 1, 1))
    assert not exchange.receive(2, 5, 10, payload(2, 2, 2))
    exchange.receive(2, 6, 20, payload(3, 3, 3))
    assert not exchange.receive(2, 6, 20, payload(4, 4, 4))
    assert exchange.dropped == 2
    assert "repeated" in exchange.last_drop
    assert heard(exchange) == [[1, 1, 1]]
    exchange.begin(2, 6, [20])
    assert heard(exchange) == [[3, 3, 3]]


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        pytest.param(b"", "0 bytes, not 12", id="empty"),
        pytest.param(GOOD[:-1], "11 bytes, not 12", id="too short"),
        pytest.param(GOOD + b"\0", "13 bytes, not 12", id="too long"),
        pytest.param(payload(0, 1, 2, 3), "16 bytes, not 12", id="of another policy"),
        pytest.param(payload(0, np.nan, 1), "other than multiples", id="nan"),
        pytest.param(payload(0, np.inf, 1), "other than multiples", id="infinity"),
        pytest.param(payload(-np.inf, 0, 1), "other than multiples", id="minus infinity"),
        pytest.param(payload(0, 1, -0.015625), "other than multiples", id="below"),
        pytest.param(payload(8.015625, 1, 1), "other than multiples", id="above"),
        pytest.param(payload(0.01, 1, 1), "other than multiples", id="off the grid"),
    ],
)
@pytest.mark.parametrize("tick", [5, 6], ids=["now", "early"])
def test_a_payload_that_no_policy_sends_is_dropped_and_may_be_sent_again(
    exchange: Exchange, bad: bytes, why: str, tick: int
) -> None:
    assert not exchange.receive(2, tick, 10, bad)
    assert exchange.dropped == 1
    assert why in exchange.last_drop
    exchange.receive(2, tick, 10, GOOD)
    exchange.begin(2, 6, [10]) if tick == 6 else None
    assert heard(exchange) == [[0, 0.25, 8]]
    assert exchange.dropped == 1


def test_a_tick_can_take_only_so_many_early_messages(exchange: Exchange, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "EARLY_FEATURES", 10)
    for tag in range(12):
        exchange.receive(2, 6, tag, GOOD)
    assert exchange.dropped == 2
    assert "more than 10" in exchange.last_drop
    exchange.begin(2, 6, list(range(12)))
    assert exchange.missing == 2


def test_early_messages_have_room_for_more_than_the_largest_team() -> None:
    exchange = Exchange(features=3)
    exchange.begin(0, 0, [])
    for tag in range(1000):
        exchange.receive(0, 1, tag, GOOD)
    exchange.begin(0, 1, list(range(1000)))
    assert exchange.complete


@pytest.mark.parametrize("content", [GOOD, b"too short", payload(np.nan, 1, 1)], ids=["sound", "short", "nan"])
@pytest.mark.parametrize("where", ["ticks", "episodes", "both", "tags now"])
def test_no_flood_fills_a_robots_memory(exchange: Exchange, where: str, content: bytes) -> None:
    for i in range(20_000):
        episode = 3 + i if where in ("episodes", "both") else 2
        tick = {"ticks": 6 + i, "episodes": 0, "both": i % 7, "tags now": 5}[where]
        exchange.receive(episode, tick, 1000 + i, content)
    assert len(pickle.dumps(exchange)) < 20_000  # a kept message takes more than 100 bytes
    # And it still works.
    exchange.receive(2, 5, 10, GOOD)
    assert heard(exchange) == [[0, 0.25, 8]]
    exchange.receive(2, 6, 20, GOOD)
    exchange.begin(2, 6, [20])
    assert exchange.complete


def test_messages_are_copies_of_what_was_received(exchange: Exchange) -> None:
    buffer = bytearray(GOOD)
    exchange.receive(2, 5, 10, bytes(buffer))
    exchange.messages()[:] = 7
    assert heard(exchange) == [[0, 0.25, 8]]
