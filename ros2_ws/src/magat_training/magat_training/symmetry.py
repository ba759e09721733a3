# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The eight rotations and reflections of a grid world: each observation and its action give eight."""

import numpy as np
import numpy.typing as npt

from magat_sim.grid import DELTAS

#: (transpose, mirror x, mirror y), applied in this order.
SYMMETRIES = [(t, x, y) for t in (False, True) for x in (False, True) for y in (False, True)]


def turn_cells(offsets: npt.NDArray, symmetry: int) -> npt.NDArray:
    """``[..., 2]`` offsets ``(x, y)``, turned by symmetry 0 to 7."""
    transpose, mirror_x, mirror_y = SYMMETRIES[symmetry]
    turned = offsets[..., ::-1] if transpose else offsets
    return turned * np.array([-1 if mirror_x else 1, -1 if mirror_y else 1])


def turn_arrays(arrays: npt.NDArray, symmetry: int) -> npt.NDArray:
    """``[..., S, S]`` arrays indexed ``[y, x]``, turned the same way."""
    transpose, mirror_x, mirror_y = SYMMETRIES[symmetry]
    turned = arrays.swapaxes(-1, -2) if transpose else arrays
    return turned[..., :: -1 if mirror_y else 1, :: -1 if mirror_x else 1]


def _turned_primitives() -> npt.NDArray[np.int64]:
    table = np.empty((len(SYMMETRIES), len(DELTAS)), dtype=np.int64)
    for symmetry in range(len(SYMMETRIES)):
        for primitive, delta in enumerate(turn_cells(DELTAS, symmetry)):
            table[symmetry, primitive] = int(np.flatnonzero((delta == DELTAS).all(axis=1))[0])
    return table


#: ``[8, 5]`` what each symmetry makes of each primitive.
PRIMITIVES = _turned_primitives()
