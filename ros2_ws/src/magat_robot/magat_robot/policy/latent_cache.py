"""What was seen a moment ago need not be computed again."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from magat_robot.policy.interface import LatentState
from magat_robot.policy.network import NodeState


class LatentCache:
    """Encodes views, those that have changed: of the others, the encoding is still known.

    Who stands still among others that do sees the same, and many do as soon as they have arrived. An encoding follows
    from its view alone, whatever is computed beside it (see `fixed_point`), so what is recalled has the bits of what
    would be computed. Only the last call is remembered, which finds nearly all that could be found.
    """

    def __init__(self, perceive: Callable[[npt.NDArray[np.uint8]], LatentState]) -> None:
        """Remember nothing yet; ``perceive`` is a policy's, see `RobotPolicy`."""
        self._perceive = perceive
        self._row: dict[bytes, int] = {}
        self._known: LatentState | None = None

    def perceive(self, view: npt.NDArray[np.uint8]) -> LatentState:
        """As the policy's ``perceive``: ``[R, 3, 11, 11]`` of 0 and 1."""
        keys = [one.tobytes() for one in view]
        rows = np.array([self._row.get(key, -1) for key in keys], dtype=np.int64)
        fresh = np.flatnonzero(rows < 0)
        if self._known is None or len(fresh) == len(rows):
            known = self._perceive(view)
        else:
            known = _replaced(self._known, np.maximum(rows, 0), fresh, self._perceive(view[fresh]))
        self._known, self._row = known, dict(zip(keys, range(len(keys)), strict=True))
        return known


def _replaced(
    known: LatentState, rows: npt.NDArray[np.int64], fresh: npt.NDArray[np.int64], new: LatentState
) -> LatentState:
    """The ``rows`` of ``known``, with ``new`` in the places ``fresh``; all of them before the first round."""
    old, now = known.state, new.state
    tensors = []
    for name in ("features", "x", "total"):
        tensor = getattr(old, name)[rows]
        tensor[fresh] = getattr(now, name)
        tensors.append(tensor)
    messages = known.messages[rows]
    messages[fresh] = new.messages
    features, x, total = tensors
    return LatentState(NodeState(features, 0, x, None, total), messages)
