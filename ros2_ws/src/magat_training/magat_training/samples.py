# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Training samples: observations of whole teams with the expert's next primitives, turned by random symmetries."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from magat_evaluation.cases import SolvedCase
from magat_sim.field_of_view import RADIUS, field_of_view, pad
from magat_sim.grid import IntArray, primitives_between
from magat_sim.radio import neighbours
from magat_training import symmetry


@dataclass(frozen=True)
class Instants:
    """Positions at S instants, on cases of one size with N robots."""

    #: ``[S]`` index of the case.
    case: npt.NDArray[np.int32]
    #: ``[S, N, 2]`` cells of the robots, and their cells a step later if they follow the expert.
    now: npt.NDArray[np.int16]
    next: npt.NDArray[np.int16]

    def __len__(self) -> int:
        """S."""
        return len(self.case)

    @classmethod
    def of_paths(cls, paths: Sequence[IntArray], cases: Sequence[int]) -> "Instants":
        """All instants of ``paths`` (at least one, each ``[T + 1, N, 2]``), on ``cases``.

        The last instant, with all robots on their goals, is followed by itself.
        """
        return cls(
            np.repeat(np.asarray(cases, dtype=np.int32), [len(path) for path in paths]),
            np.concatenate(paths).astype(np.int16),
            np.concatenate([np.concatenate([path[1:], path[-1:]]) for path in paths]).astype(np.int16),
        )

    def take(self, index: IntArray) -> "Instants":
        """Those at ``index``."""
        return Instants(self.case[index], self.now[index], self.next[index])

    @classmethod
    def join(cls, parts: Sequence["Instants"]) -> "Instants":
        """The instants of all ``parts``, of which there is at least one."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("case", "now", "next")))


@dataclass(frozen=True)
class Pool:
    """S instants to draw from. An instant's probability is proportional to its robots underway, plus one.

    Nearly half of all robots rest on their goals, and there is nothing to learn from them.
    """

    instants: Instants
    #: ``[S]`` cumulative weights of the instants.
    sums: npt.NDArray[np.int64]

    def __len__(self) -> int:
        """S."""
        return len(self.instants)

    def draw(self, rng: np.random.Generator, count: int) -> Instants:
        """Draw ``count`` instants with replacement."""
        return self.instants.take(np.searchsorted(self.sums, rng.integers(self.sums[-1], size=count), side="right"))


@dataclass(frozen=True)
class Batch:
    """B instants of N robots each, R = B * N rows."""

    #: ``[R, 3, 11, 11]`` uint8.
    view: npt.NDArray[np.uint8]
    #: ``[R, M]`` rows each robot hears, -1 for none.
    heard: IntArray
    #: ``[R]`` the expert's primitives.
    action: IntArray


class Sampler:
    """Makes batches of instants on cases of maps of one size and teams of one size.

    Observations are rebuilt for each batch, by the same functions that the simulator uses.
    """

    def __init__(self, solved: Sequence[SolvedCase]) -> None:
        """Prepare the maps and goals of ``solved``; the indices of cases refer to it.

        Raises:
            ValueError: ``solved`` is empty.
        """
        if not solved:
            raise ValueError("no solved case: there is nothing to learn from")
        self._obstacles = pad(np.stack([s.case.obstacles for s in solved]), 1)
        self._goals = np.stack([s.case.goals for s in solved])

    def pool(self, instants: Instants) -> Pool:
        """A pool of ``instants``, of which there is at least one."""
        underway = (instants.now != self._goals[instants.case]).any(axis=2).sum(axis=1)
        return Pool(instants, np.cumsum(underway + 1))

    def batch(self, rng: np.random.Generator, shares: Sequence[tuple[Pool, int]]) -> Batch:
        """Draw ``count`` instants of each ``(pool, count)`` with ``rng``, and turn each by a random symmetry."""
        drawn = Instants.join([pool.draw(rng, count) for pool, count in shares])
        turns = rng.integers(len(symmetry.SYMMETRIES), size=len(drawn))
        size, robots = drawn.now.shape[:2]
        world = np.repeat(np.arange(size), robots)
        position = drawn.now.reshape(-1, 2).astype(np.int64)
        goal = self._goals[drawn.case].reshape(-1, 2)
        obstacles = self._obstacles[drawn.case]
        occupied = np.zeros_like(obstacles)
        occupied[world, position[:, 1] + RADIUS, position[:, 0] + RADIUS] = 1
        view = field_of_view(obstacles, occupied, world, position, goal)
        action = primitives_between(position, drawn.next.reshape(-1, 2).astype(np.int64))
        for turn in np.unique(turns):
            rows = np.repeat(turns == turn, robots)
            view[rows] = symmetry.turn_arrays(view[rows], int(turn))
            action[rows] = symmetry.PRIMITIVES[turn, action[rows]]
        return Batch(view, neighbours(world, position), action)
