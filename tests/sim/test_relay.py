# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The relay sends each robot the messages in its range, once per round, and nothing else."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from magat_sim.relay import Relay

TAGS = [100, 101, 102, 103, 104]
HEARS = [[1, 2, 3, 4], [0], [0, 3], [], [0]]
RNG = np.random.default_rng


def payload(robot: int, number: int = 0) -> bytes:
    return bytes([robot, number % 256, 7])


@pytest.fixture
def relay() -> Relay:
    return Relay(TAGS, HEARS, [True] * 5)


def send(relay: Relay, *robots: int, number: int = 0, encoding: int = 0) -> None:
    for robot in robots:
        assert relay.receive(number, TAGS[robot], encoding, payload(robot, number)) is None


def heard(relay: Relay) -> list[list[bytes]]:
    return [sorted(bundle.payloads) for bundle in relay.bundles()]


def test_each_robot_gets_what_is_in_its_range_in_every_round(relay: Relay) -> None:
    for number in range(3):
        assert relay.round == number
        send(relay, 3, 0, 4, 1, 2, number=number)
        assert heard(relay) == [[payload(j, number) for j in hears] for hears in HEARS]


@given(seed=st.integers(0, 2**32 - 1))
def test_bundles_do_not_depend_on_the_order_of_arrival(seed: int) -> None:
    rng = RNG(seed)
    robots = int(rng.integers(1, 9))
    hears = [[j for j in range(robots) if j != i and rng.random() < 0.5] for i in range(robots)]
    relay = Relay(list(range(robots)), hears, [True] * robots)
    for spoke, robot in enumerate(rng.permutation(robots).tolist()):
        assert not relay.complete
        assert relay.receive(0, robot, 2, payload(robot)) is None
        assert relay.complete == (spoke + 1 == robots)
    bundles = relay.bundles()
    assert [sorted(bundle.payloads) for bundle in bundles] == [[payload(j) for j in row] for row in hears]
    assert {bundle.encoding for bundle in bundles} == {2}


def test_bundles_come_shuffled(relay: Relay) -> None:
    orders = set()
    for number in range(500):
        send(relay, 0, 1, 2, 3, 4, number=number)
        orders.add(tuple(data[0] for data in relay.bundles()[0].payloads))
    assert orders == set(itertools.permutations([1, 2, 3, 4]))


def test_two_robots_that_hear_the_same_get_it_in_orders_of_their_own() -> None:
    relay = Relay(list(range(8)), [[*range(1, 7)]] * 8, [True] * 8)
    for robot in range(8):
        relay.receive(0, robot, 0, payload(robot))
    orders = {tuple(bundle.payloads) for bundle in relay.bundles()}
    assert len(orders) > 4


def test_a_round_is_complete_when_all_have_spoken_that_are_there() -> None:
    relay = Relay(TAGS, HEARS, [True, False, True, True, False])
    for robot in (1, 0, 4, 3):  # two of them are not waited for
        send(relay, robot)
        assert not relay.complete
    send(relay, 2)
    assert relay.complete
    heard(relay)
    assert not relay.complete, "the next round has begun"


def test_what_did_not_come_is_missing_and_the_rest_is_handed_on(relay: Relay) -> None:
    send(relay, 0, 3)
    assert not relay.complete
    assert heard(relay) == [[payload(3)], [payload(0)], [payload(0), payload(3)], [], [payload(0)]]
    send(relay, 1, number=1)
    assert heard(relay) == [[payload(1, 1)], [], [], [], []], "of the round before nothing is left"


def test_a_round_without_messages_is_empty(relay: Relay) -> None:
    assert heard(relay) == [[]] * 5
    assert relay.round == 1


@pytest.mark.parametrize("size", [0, 2, 4])
def test_payloads_of_an_odd_size_are_left_out(relay: Relay, size: int) -> None:
    assert relay.receive(0, TAGS[1], 0, bytes(size)) is None
    send(relay, 0, 2, 3, 4)
    assert relay.complete
    bundles = relay.bundles()
    assert sorted(bundles[0].payloads) == [payload(2), payload(3), payload(4)]
    assert bundles[2].payloads == [payload(0), payload(3)] or bundles[2].payloads == [payload(3), payload(0)]


@pytest.mark.parametrize("last", [False, True], ids=["first", "last"])
def test_a_message_in_another_encoding_is_left_out_and_the_others_are_relayed(relay: Relay, last: bool) -> None:
    """Its sender may have been restarted during an episode."""
    if last:
        send(relay, 0, 2, 3, 4, encoding=1)
    send(relay, 1, encoding=2)
    if not last:
        send(relay, 0, 2, 3, 4, encoding=1)
    bundles = relay.bundles()
    assert {bundle.encoding for bundle in bundles} == {1}
    assert [sorted(bundle.payloads) for bundle in bundles] == [
        [payload(2), payload(3), payload(4)],
        [payload(0)],
        [payload(0), payload(3)],
        [],
        [payload(0)],
    ]


def test_messages_of_no_bytes_are_handed_on_too(relay: Relay) -> None:
    for tag in TAGS:
        relay.receive(0, tag, 0, b"")
    assert [len(bundle.payloads) for bundle in relay.bundles()] == [4, 1, 2, 0, 1]


def test_an_unknown_tag_is_dropped(relay: Relay) -> None:
    assert "not given out" in str(relay.receive(0, 99, 0, payload(0)))
    assert heard(relay) == [[]] * 5


def test_another_round_is_dropped(relay: Relay) -> None:
    assert "round 1, while round 0" in str(relay.receive(1, TAGS[0], 0, payload(0)))
    send(relay, 0)
    assert heard(relay)[1] == [payload(0)]
    assert "round 0, while round 1" in str(relay.receive(0, TAGS[1], 0, payload(1)))
    assert heard(relay) == [[]] * 5


def test_the_first_of_two_messages_counts(relay: Relay) -> None:
    send(relay, 0)
    assert "second message" in str(relay.receive(0, TAGS[0], 0, payload(9)))
    assert heard(relay)[1] == [payload(0)]
    send(relay, 0, number=1)  # one a round


def test_nothing_dropped_completes_a_round() -> None:
    relay = Relay(TAGS[:1], [[]], [True])
    relay.receive(0, 99, 0, payload(0))
    relay.receive(1, TAGS[0], 0, payload(0))
    assert not relay.complete
