"""Who hears whom, against brute force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_sim.radio import COMMUNICATION_RADIUS, neighbours


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


def test_nobody_hears_itself_even_alone_and_rows_may_be_empty() -> None:
    assert neighbours(np.zeros(1, np.int64), np.array([[3, 4]])).shape == (1, 0)
    assert neighbours(np.zeros(0, np.int64), np.zeros((0, 2), np.int64)).shape == (0, 0)


def test_worlds_do_not_hear_each_other_wherever_their_robots_are() -> None:
    corners = np.array([[0, 0], [199, 0], [0, 199], [199, 199]])
    position = np.concatenate([corners] * 50)
    world = np.repeat(np.arange(50), 4)
    assert neighbours(world, position).shape == (200, 0)
    assert neighbours(np.repeat(np.arange(50), 4), np.zeros((200, 2), np.int64)).shape == (200, 3)
