# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Baselines: planners without learning, in the same simulator and with the same measures as policies.

The expert, HCA and Replan plan whole paths, which the robots then follow. In PIBT each robot knows the map and ranks
its primitives by the distance to its goal; the shield ``pibt`` resolves the conflicts.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from magat_evaluation.cases import SolvedCase
from magat_evaluation.greedy import greedy
from magat_evaluation.planners import Planner, prefer_near
from magat_expert import Solution, solve_hca, solve_replan
from magat_sim.case import Case
from magat_sim.grid import DELTAS, BoolArray, IntArray, primitives_between
from magat_sim.rollout import Decide
from magat_sim.shield import SHIELDS
from magat_sim.simulator import Actions, Observation, Simulator

#: Time limit of HCA and Replan for each case, seconds.
PLANNING_LIMIT = 60.0


def hca(solved: Sequence[SolvedCase], simulator: Simulator) -> Decide:
    """Hierarchical Cooperative A*; if it finds no paths, no robot moves."""
    return _walk(solved, simulator, lambda one: solve_hca(*_instance(one.case), PLANNING_LIMIT, seed=one.number))


def replan(solved: Sequence[SolvedCase], simulator: Simulator) -> Decide:
    """Global re-planning around the robots in the way."""
    return _walk(
        solved,
        simulator,
        lambda one: solve_replan(*_instance(one.case), PLANNING_LIMIT, max_steps=one.t_max, seed=one.number),
    )


def expert(solved: Sequence[SolvedCase], simulator: Simulator) -> Decide:
    """The expert's own paths, which delta_FT and T_max refer to."""
    return _walk(solved, simulator, lambda one: one)


def pibt(solved: Sequence[SolvedCase], simulator: Simulator) -> Decide:
    """Each robot ranks the primitives by the distance to its goal after them; equal ones in random order.

    The simulator must have the shield ``pibt``.
    """
    steps_to_goal = [distances(one.case) for one in solved]

    def decide(observation: Observation) -> Actions:
        robots = simulator.active
        distance = np.empty((len(robots), len(DELTAS)))
        for world in np.unique(simulator.world[robots]):
            here = simulator.world[robots] == world
            mine = robots[here] - np.searchsorted(simulator.world, world)
            cells = simulator.position[robots[here]][:, None] + DELTAS + 1  # in a map with a border
            distance[here] = steps_to_goal[world][mine[:, None], cells[..., 1], cells[..., 0]]
        return prefer_near(distance, observation)

    return decide


def distances(case: Case) -> npt.NDArray[np.float32]:
    """Steps to each robot's goal, without other robots: ``[N, H + 2, W + 2]``, infinite on obstacles and border."""
    free = np.pad(~case.obstacles, 1)
    width = free.shape[1]
    cells = np.flatnonzero(free)
    number = np.full(free.size, -1)
    number[cells] = np.arange(len(cells))
    ends = [(cells[_open(free, cells + step)], cells[_open(free, cells + step)] + step) for step in (1, width)]
    one, other = (np.concatenate([number[pair[side]] for pair in ends]) for side in (0, 1))
    graph = csr_array((np.ones(len(one), np.int8), (one, other)), shape=(len(cells), len(cells)))
    goals = number[(case.goals[:, 1] + 1) * width + case.goals[:, 0] + 1]
    steps = np.full((case.robots, free.size), np.inf, dtype=np.float32)
    for robot, goal in enumerate(goals):  # one by one, because all at once take eight bytes per cell and robot
        steps[robot, cells] = dijkstra(graph, directed=False, indices=goal, unweighted=True)
    return steps.reshape(case.robots, *free.shape)


def _open(free: BoolArray, cells: IntArray) -> BoolArray:
    return free.reshape(-1)[cells]


def _instance(case: Case) -> tuple[BoolArray, IntArray, IntArray]:
    return case.obstacles, case.starts, case.goals


def _walk(
    solved: Sequence[SolvedCase], simulator: Simulator, plan: Callable[[SolvedCase], Solution | SolvedCase]
) -> Decide:
    """Follow the planned paths step by step; robots stay at the ends of their paths."""
    walks = [
        np.zeros((0, one.case.robots), np.int64) if paths is None else primitives_between(paths[:-1], paths[1:])
        for one, paths in ((one, plan(one).paths) for one in solved)
    ]
    made = np.zeros((max(map(len, walks)) + 1, len(simulator.world)), dtype=np.int64)
    for world, walk in enumerate(walks):
        made[: len(walk), simulator.world == world] = walk
    return lambda observation: made[min(observation.tick, len(made) - 1)][simulator.active]


class Baseline(NamedTuple):
    """A planner without learning."""

    planner: Planner
    #: The shields with which it can be run; the first one is the default.
    shields: tuple[str, ...]


#: By name.
BASELINES: Mapping[str, Baseline] = {
    "expert": Baseline(expert, ("idle",)),
    "HCA": Baseline(hca, ("idle",)),
    "Replan": Baseline(replan, ("idle",)),
    "PIBT": Baseline(pibt, ("pibt",)),
    "greedy": Baseline(greedy, tuple(SHIELDS)),
}
