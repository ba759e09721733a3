"""The online expert: what to do where the policy itself got stuck (MAGAT paper, Sec. V-D)."""

import math
from collections.abc import Sequence

import numpy as np

from magat_expert import SolveStatus, solve_many
from magat_robot.policy.policy import Policy
from magat_sim.case import Case
from magat_training.cases import EXPERT_NODE_LIMIT, EXPERT_W, SolvedCase
from magat_training.evaluate import run_policy, simulator_for


def stuck_cases(policy: Policy, solved: Sequence[SolvedCase], seed: int) -> list[SolvedCase]:
    """Cases that begin where ``policy`` failed.

    Args:
        policy: runs one episode on each case.
        solved: the cases.
        seed: of the episodes' random streams.

    Returns:
        For each episode in which not all robots reached their goals: its last state as a case, not yet solved, with an
        empty path; see `solve`.
    """
    simulator = simulator_for(solved, seed)
    run_policy(policy, simulator)
    stuck = []
    for world, origin in enumerate(solved):
        here = simulator.world == world
        if not simulator.visited[here].all():
            case = Case(origin.case.obstacles, simulator.position[here].copy(), origin.case.goals)
            stuck.append(SolvedCase(origin.number, case, np.zeros((0, case.robots, 2), dtype=np.int64)))
    return stuck


def solve(stuck: Sequence[SolvedCase]) -> list[SolvedCase]:
    """``stuck`` with the expert's paths; without those that it gives up."""
    solutions = solve_many((s.case for s in stuck), w=EXPERT_W, time_limit=math.inf, node_limit=EXPERT_NODE_LIMIT)
    return [
        SolvedCase(origin.number, origin.case, solution.paths)
        for origin, solution in zip(stuck, solutions, strict=True)
        if solution.status is SolveStatus.SOLVED and solution.paths is not None
    ]
