# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cells and motion primitives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from magat_sim.grid import DELTAS, Primitive, at, inside, primitives_between

cell = st.tuples(st.integers(-5, 300), st.integers(-5, 300))


def test_primitives_are_numbered_in_the_order_of_the_protocol() -> None:
    assert [(p.name, int(p)) for p in Primitive] == [
        ("IDLE", 0),
        ("UP", 1),
        ("DOWN", 2),
        ("LEFT", 3),
        ("RIGHT", 4),
    ]


@pytest.mark.parametrize(
    ("primitive", "delta"),
    [
        (Primitive.IDLE, (0, 0)),
        (Primitive.UP, (0, 1)),
        (Primitive.DOWN, (0, -1)),
        (Primitive.LEFT, (-1, 0)),
        (Primitive.RIGHT, (1, 0)),
    ],
)
def test_x_grows_to_the_right_and_y_up(primitive: Primitive, delta: tuple[int, int]) -> None:
    assert tuple(DELTAS[primitive]) == delta


def test_at_reads_the_row_of_y_and_the_column_of_x() -> None:
    array = np.array([[10, 11, 12], [20, 21, 22]])
    assert at(array, [2, 0]) == 12
    assert at(array, [[[0, 1], [2, 1]]]).tolist() == [[20, 22]]


def test_inside_knows_each_edge_of_a_map_that_is_wider_than_high() -> None:
    edges = [(0, 0), (4, 2), (5, 0), (0, 3), (-1, 0), (0, -1), (2, 4)]
    assert inside((3, 5), edges).tolist() == [True, True, False, False, False, False, False]


@given(st.lists(st.tuples(cell, st.sampled_from(Primitive)), min_size=1, max_size=8))
def test_primitives_between_undoes_the_deltas(steps: list[tuple[tuple[int, int], Primitive]]) -> None:
    before = np.array([start for start, _ in steps])
    primitives = np.array([primitive for _, primitive in steps])
    assert (primitives_between(before, before + DELTAS[primitives]) == primitives).all()


def test_primitives_between_takes_whole_paths_of_small_integers() -> None:
    paths = np.array([[[0, 0], [5, 5]], [[0, 1], [4, 5]], [[0, 1], [4, 4]]], dtype=np.int16)
    primitives = primitives_between(paths[:-1], paths[1:])
    assert primitives.tolist() == [[Primitive.UP, Primitive.LEFT], [Primitive.IDLE, Primitive.DOWN]]
    assert primitives.dtype == np.int64


@pytest.mark.parametrize("jump", [(1, 1), (-1, 1), (2, 0), (0, -2)])
def test_a_longer_step_is_refused_with_its_length(jump: tuple[int, int]) -> None:
    before = np.array([[3, 3], [3, 3]])
    with pytest.raises(ValueError, match=rf"\({jump[0]}, {jump[1]}\)"):
        primitives_between(before, before + np.array([[0, 1], jump]))
