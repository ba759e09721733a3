# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A cache for `RobotPolicy.perceive`: fields of view that were there in the call before are not computed again."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt

from magat_robot.policy.interface import LatentState


class LatentCache:
    """Caches the latent states of the last call to ``perceive``, by field of view.

    A robot that stands still among others that stand still sees the same again, and many robots do so once they have
    arrived. A latent state depends on its field of view alone, not on the rest of the batch (see `fixed_point`), so
    cached and computed states are the same to the last bit. Keeping only the last call finds nearly all repetitions.
    """

    def __init__(self, perceive: Callable[[npt.NDArray[np.uint8]], LatentState]) -> None:
        """Start empty; ``perceive`` is a policy's, see `RobotPolicy`."""
        self._perceive = perceive
        self._row: dict[bytes, int] = {}
        self._known: LatentState | None = None

    def perceive(self, field_of_view: npt.NDArray[np.uint8]) -> LatentState:
        """As the policy's ``perceive``: ``[R, 3, 11, 11]`` of 0 and 1."""
        keys = [one.tobytes() for one in field_of_view]
        rows = np.array([self._row.get(key, -1) for key in keys], dtype=np.int64)
        fresh = np.flatnonzero(rows < 0)
        if self._known is None or len(fresh) == len(rows):
            known = self._perceive(field_of_view)
        else:
            known = _replaced(self._known, np.maximum(rows, 0), fresh, self._perceive(field_of_view[fresh]))
        self._known, self._row = known, dict(zip(keys, range(len(keys)), strict=True))
        return known


def _replaced(
    known: LatentState, rows: npt.NDArray[np.int64], fresh: npt.NDArray[np.int64], new: LatentState
) -> LatentState:
    """The ``rows`` of ``known``, with ``new`` in the places ``fresh``; all states are before the first round."""

    def merged(old: Any, now: Any) -> Any:
        if old is None or isinstance(old, int):
            return old
        values = old[rows]
        values[fresh] = now
        return values

    old, now = known.state, new.state
    state = type(old)(
        **{field.name: merged(getattr(old, field.name), getattr(now, field.name)) for field in fields(old)}
    )
    return LatentState(state, merged(known.messages, new.messages))
