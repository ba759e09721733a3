# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The control without a network and without a radio: each robot walks towards its goal by what it sees itself."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from magat_evaluation.cases import SolvedCase
from magat_evaluation.planners import prefer_near
from magat_sim.field_of_view import CENTRE, GOAL, OBSTACLES, SIZE, Uint8Array
from magat_sim.grid import DELTAS
from magat_sim.rollout import Decide
from magat_sim.simulator import Actions, Observation, Simulator

#: More than any number of steps inside a field of view.
_FAR = float(SIZE * SIZE)


def greedy(_: Sequence[SolvedCase], __: Simulator) -> Decide:
    """Each robot prefers the primitives by how close they bring it to the goal's mark in its own field of view.

    Distances are those of a breadth-first search around the obstacles that the robot sees; other robots are ignored.
    Ties are broken at random. A policy that does not beat this control has not shown that its network or its messages
    are worth anything.
    """

    def decide(observation: Observation) -> Actions:
        return prefer_near(distances_in_view(observation.field_of_view), observation)

    return decide


def distances_in_view(field_of_view: Uint8Array) -> npt.NDArray[np.float64]:
    """Steps from where each primitive leads to the goal's mark, by a breadth-first search in the field of view.

    Args:
        field_of_view: ``[R, 3, 11, 11]``; cells of the outer ring count as free.

    Returns:
        ``[R, 5]``; a large number on obstacles, and where no path inside the field of view leads to the mark.
    """
    free = np.pad(field_of_view[:, OBSTACLES] == 0, ((0, 0), (1, 1), (1, 1)))
    reached = np.pad(field_of_view[:, GOAL] == 1, ((0, 0), (1, 1), (1, 1))) & free
    steps = np.where(reached, 0.0, _FAR)
    front, step = reached, 0
    while front.any():
        step += 1
        spread = np.zeros_like(front)
        spread[:, 1:] |= front[:, :-1]
        spread[:, :-1] |= front[:, 1:]
        spread[:, :, 1:] |= front[:, :, :-1]
        spread[:, :, :-1] |= front[:, :, 1:]
        front = spread & free & (steps == _FAR)
        steps[front] = step
    cells = DELTAS + CENTRE + 1  # in the padded field of view
    return steps[:, cells[:, 1], cells[:, 0]]
