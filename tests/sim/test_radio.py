# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The communication graph, compared with a brute-force implementation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_sim.radio import COMMUNICATION_RADIUS, neighbours, without_lost


def brute_force(world: np.ndarray, position: np.ndarray, squared_radius: float) -> list[list[int]]:
    """Every pair, in integers."""
    cells = [(int(w), int(x), int(y)) for w, (x, y) in zip(world, position, strict=True)]
    return [
        [j for j, (v, p, q) in enumerate(cells) if j != i and v == w and (p - x) ** 2 + (q - y) ** 2 <= squared_radius]
        for i, (w, x, y) in enumerate(cells)
    ]


def rows(heard: np.ndarray) -> list[list[int]]:
    """The neighbourhoods without their filling, which must stand at the end."""
    lists = [[int(j) for j in row if j >= 0] for row in heard]
    width = max(map(len, lists), default=0)
    assert heard.shape == (len(lists), width)
    assert heard.tolist() == [row + [-1] * (width - len(row)) for row in lists]
    return lists


@settings(max_examples=150)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 60),
    side=st.integers(8, 40),
    worlds=st.integers(1, 4),
    radius=st.sampled_from([1.0, 1.5, 2.0, 5.0, 7.0, 7.5, 10.0]),
)
def test_neighbourhoods_are_those_of_brute_force(seed: int, count: int, side: int, worlds: int, radius: float) -> None:
    rng = np.random.default_rng(seed)
    position = rng.integers(side, size=(count, 2))
    world = np.sort(rng.integers(worlds, size=count))
    heard = neighbours(world, position, radius)
    assert heard.dtype == np.int64
    assert rows(heard) == brute_force(world, position, radius**2)


def test_the_radius_is_seven_cells_if_nothing_else_is_said() -> None:
    assert COMMUNICATION_RADIUS == 7
    rng = np.random.default_rng(3)
    position = rng.integers(30, size=(80, 2))
    world = np.zeros(80, dtype=np.int64)
    assert rows(neighbours(world, position)) == brute_force(world, position, 49)


@pytest.mark.parametrize(
    ("offset", "heard"),
    [((7, 0), True), ((0, -7), True), ((7, 1), False), ((5, 5), False), ((4, 5), True), ((8, 0), False)],
)
def test_the_radius_is_euclidean_and_inclusive(offset: tuple[int, int], heard: bool) -> None:
    position = np.array([[10, 10], [10 + offset[0], 10 + offset[1]]])
    assert rows(neighbours(np.zeros(2, np.int64), position)) == ([[1], [0]] if heard else [[], []])


def test_no_robot_hears_itself_and_rows_may_be_empty() -> None:
    assert neighbours(np.zeros(1, np.int64), np.array([[3, 4]])).shape == (1, 0)
    assert neighbours(np.zeros(0, np.int64), np.zeros((0, 2), np.int64)).shape == (0, 0)


def test_worlds_do_not_hear_each_other_wherever_their_robots_are() -> None:
    corners = np.array([[0, 0], [199, 0], [0, 199], [199, 199]])
    position = np.concatenate([corners] * 50)
    world = np.repeat(np.arange(50), 4)
    assert neighbours(world, position).shape == (200, 0)
    assert neighbours(np.repeat(np.arange(50), 4), np.zeros((200, 2), np.int64)).shape == (200, 3)


def crowd(seed: int, robots: int = 120, side: int = 30) -> tuple[np.ndarray, np.ndarray]:
    """The neighbourhoods of a random team, and the seeds of its robots."""
    rng = np.random.default_rng(seed)
    streams = rng.integers(2**64, size=robots, dtype=np.uint64)
    return neighbours(np.zeros(robots, np.int64), rng.integers(side, size=(robots, 2))), streams


def links(heard: np.ndarray) -> set[tuple[int, int]]:
    return {(receiver, sender) for receiver, row in enumerate(rows(heard)) for sender in row}


def test_the_links_that_are_left_are_rows_of_the_same_form() -> None:
    heard, streams = crowd(0)
    left = without_lost(heard, streams, 3, 0.6)
    assert left.shape[1] < heard.shape[1]
    assert links(left) < links(heard)
    assert all(row == sorted(row) for row in rows(left))
    assert links(without_lost(heard, streams, 3, 0.0)) == links(heard)
    assert without_lost(heard, streams, 3, 1.0).shape == (120, 0)


@pytest.mark.parametrize("loss", [0.1, 0.3, 0.5])
def test_a_share_of_the_links_is_lost_each_by_itself(loss: float) -> None:
    heard, streams = crowd(1)
    every = links(heard)
    ticks = 200
    lost = np.zeros((ticks, 120, 120), bool)
    for tick in range(ticks):
        for link in every - links(without_lost(heard, streams, tick, loss)):
            lost[tick][link] = True
    there = np.zeros((120, 120), bool)
    there[tuple(zip(*every, strict=True))] = True
    draws = lost[:, there]
    count = draws.shape[1]
    assert abs(draws.mean() - loss) < 4 * np.sqrt(loss * (1 - loss) / draws.size)
    # Neither a link, nor a tick, nor a robot's ears or voice have a share of their own.
    for shares, of in (
        (draws.mean(axis=0), ticks),
        (draws.mean(axis=1), count),
        (lost.sum(axis=(0, 2)) / (ticks * there.sum(axis=1)), ticks * there.sum(axis=1)),
        (lost.sum(axis=(0, 1)) / (ticks * there.sum(axis=0)), ticks * there.sum(axis=0)),
    ):
        assert (np.abs(shares - loss) < 5 * np.sqrt(loss * (1 - loss) / of)).all()
    # To hear does not mean to be heard, nor to be heard in the next tick.
    both = (lost & lost.transpose(0, 2, 1))[:, there].mean()
    again = (draws[1:] & draws[:-1]).mean()
    assert (both, again) == pytest.approx((loss**2, loss**2), abs=0.01)


def test_whether_a_link_is_lost_does_not_depend_on_other_robots() -> None:
    heard, streams = crowd(2)
    order = np.random.default_rng(0).permutation(120)
    number = np.append(np.argsort(order), -1)
    left = links(without_lost(heard, streams, 5, 0.4))
    anew = np.sort(number[heard[order]], axis=1)[:, ::-1]  # the same team, numbered anew
    renumbered = without_lost(anew, streams[order], 5, 0.4)
    assert {(int(order[i]), int(order[j])) for i, row in enumerate(renumbered) for j in row if j >= 0} == left
    alone = np.where(heard[:1] == heard[0, 0], heard[:1], -1)
    some = np.vstack([alone, np.full((119, heard.shape[1]), -1)])
    assert links(without_lost(some, streams, 5, 0.4)) == left & {(0, int(heard[0, 0]))}
