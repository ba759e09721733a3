"""Training samples: instants of the expert's solutions, seen by all robots at once, turned by a random symmetry."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from magat_sim.field_of_view import RADIUS, field_of_view, pad
from magat_sim.grid import IntArray, primitives_between
from magat_sim.radio import neighbours
from magat_training import symmetry
from magat_training.cases import SolvedCase


@dataclass(frozen=True)
class Batch:
    """B instants of N robots each, R = B * N rows."""

    #: ``[R, 3, 11, 11]`` uint8.
    view: npt.NDArray[np.uint8]
    #: ``[R, M]`` rows each robot hears, -1 for none.
    heard: IntArray
    #: ``[R]`` the expert's primitives.
    action: IntArray

    def join(self, other: "Batch") -> "Batch":
        """The rows of this batch, then those of ``other``."""
        width = max(self.heard.shape[1], other.heard.shape[1])
        later = np.where(other.heard >= 0, other.heard + len(self.action), -1)
        heard = [np.pad(h, ((0, 0), (0, width - h.shape[1])), constant_values=-1) for h in (self.heard, later)]
        return Batch(
            np.concatenate([self.view, other.view]),
            np.concatenate(heard),
            np.concatenate([self.action, other.action]),
        )


class Samples:
    """All instants of the expert's solutions of maps of one size and teams of one size.

    Kept as positions; observations are rebuilt for each batch by the same functions that the simulator uses.
    """

    def __init__(self, solved: Sequence[SolvedCase]) -> None:
        """Index the instants of ``solved``.

        Raises:
            ValueError: nothing to learn from.
        """
        if not solved:
            raise ValueError("no solved case: there is nothing to learn from")
        self._obstacles = pad(np.stack([s.case.obstacles for s in solved]), 1)
        self._goals = np.stack([s.case.goals for s in solved])
        # The last instant, all robots resting on their goals, is a sample too: it repeats as its own successor.
        self._now = np.concatenate([s.paths for s in solved]).astype(np.int16)
        self._next = np.concatenate([np.concatenate([s.paths[1:], s.paths[-1:]]) for s in solved]).astype(np.int16)
        self._case = np.repeat(np.arange(len(solved)), [len(s.paths) for s in solved])

    def __len__(self) -> int:
        """Number of instants."""
        return len(self._case)

    def batch(self, rng: np.random.Generator, size: int) -> Batch:
        """``size`` instants drawn uniformly with ``rng``, each turned by a symmetry of its own."""
        index = rng.integers(len(self), size=size)
        turns = rng.integers(len(symmetry.SYMMETRIES), size=size)
        index, turns = index[np.argsort(turns, kind="stable")], np.sort(turns)
        now, case = self._now[index].astype(np.int64), self._case[index]
        robots = now.shape[1]
        world = np.repeat(np.arange(size), robots)
        position = now.reshape(-1, 2)
        goal = self._goals[case].reshape(-1, 2)
        obstacles = self._obstacles[case]
        occupied = np.zeros_like(obstacles)

        occupied[world, position[:, 1] + RADIUS, position[:, 0] + RADIUS] = 1
        view = field_of_view(obstacles, occupied, world, position, goal)
        action = primitives_between(position, self._next[index].reshape(-1, 2))
        for turn in np.unique(turns):
            rows = np.repeat(turns == turn, robots)
            view[rows] = symmetry.turn_arrays(view[rows], int(turn))
            action[rows] = symmetry.PRIMITIVES[turn, action[rows]]
        return Batch(view, neighbours(world, position), action)
