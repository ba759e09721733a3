# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The eight symmetries are a group, and turn cells, arrays and primitives alike."""

from itertools import product

import numpy as np
import pytest

from magat_sim.grid import DELTAS, Primitive
from magat_training.symmetry import PRIMITIVES, SYMMETRIES, turn_arrays, turn_cells

ALL = range(8)
CELLS = np.array([[1, 0], [0, 1], [3, -2]])


def turned(symmetry: int) -> tuple:
    return tuple(map(tuple, turn_cells(CELLS, symmetry).tolist()))


def test_there_are_eight_and_the_first_leaves_all_as_it_is() -> None:
    assert len(SYMMETRIES) == len({turned(s) for s in ALL}) == 8
    assert turned(0) == ((1, 0), (0, 1), (3, -2))
    assert PRIMITIVES[0].tolist() == [0, 1, 2, 3, 4]


def test_they_keep_lengths_and_half_of_them_mirror() -> None:
    determinants = []
    for s in ALL:
        matrix = turn_cells(np.eye(2, dtype=int), s)
        assert (np.abs(matrix @ matrix.T) == np.eye(2)).all()
        determinants.append(round(np.linalg.det(matrix)))
    assert sorted(determinants) == [-1] * 4 + [1] * 4


def test_one_after_another_is_one_of_them_and_each_has_an_inverse() -> None:
    by_effect = {turned(s): s for s in ALL}
    table = np.array(
        [[by_effect[tuple(map(tuple, turn_cells(turn_cells(CELLS, a), b).tolist()))] for b in ALL] for a in ALL]
    )
    assert all(sorted(row) == list(ALL) for row in table.tolist())  # a group's table is a Latin square
    assert all(sorted(column) == list(ALL) for column in table.T.tolist())
    for a, b in product(ALL, ALL):
        assert (PRIMITIVES[b, PRIMITIVES[a]] == PRIMITIVES[table[a, b]]).all()
        pixels = np.arange(9).reshape(3, 3)
        assert (turn_arrays(turn_arrays(pixels, a), b) == turn_arrays(pixels, int(table[a, b]))).all()


@pytest.mark.parametrize("symmetry", ALL)
def test_primitives_turn_as_their_deltas_do(symmetry: int) -> None:
    assert (DELTAS[PRIMITIVES[symmetry]] == turn_cells(DELTAS, symmetry)).all()
    assert PRIMITIVES[symmetry, Primitive.IDLE] == Primitive.IDLE


@pytest.mark.parametrize("symmetry", ALL)
def test_arrays_turn_as_cells_do(symmetry: int) -> None:
    side = 5
    centred = np.array([(x - 2, y - 2) for y in range(side) for x in range(side)])
    values = np.arange(2 * side * side).reshape(2, side, side)
    result = turn_arrays(values, symmetry)
    for before, after in zip(centred + 2, turn_cells(centred, symmetry) + 2, strict=True):
        assert (result[:, after[1], after[0]] == values[:, before[1], before[0]]).all()


def test_mirrors_are_named_by_the_axis_they_flip() -> None:
    transpose, mirror_x, mirror_y = (
        SYMMETRIES.index(s) for s in [(True, False, False), (False, True, False), (False, False, True)]
    )
    right, up = Primitive.RIGHT, Primitive.UP
    assert PRIMITIVES[transpose, [right, up]].tolist() == [Primitive.UP, Primitive.RIGHT]
    assert PRIMITIVES[mirror_x, [right, up]].tolist() == [Primitive.LEFT, Primitive.UP]
    assert PRIMITIVES[mirror_y, [right, up]].tolist() == [Primitive.RIGHT, Primitive.DOWN]
