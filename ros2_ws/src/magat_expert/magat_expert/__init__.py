# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The expert that the policy imitates, ECBS, a planner for crowded maps, and two baselines. Importing it needs no ROS.

Cells are `(x, y)`, x to the right, y up; maps are indexed `[y, x]`.
"""

from magat_expert.baselines import solve_hca, solve_replan
from magat_expert.batch import Case, solve_many
from magat_expert.instance import InvalidInstanceError
from magat_expert.lacam import solve_lacam
from magat_expert.solver import Solution, SolveStatus, StopFlag, solve
from magat_expert.validity import check_paths

__all__ = [
    "Case",
    "InvalidInstanceError",
    "Solution",
    "SolveStatus",
    "StopFlag",
    "check_paths",
    "solve",
    "solve_hca",
    "solve_lacam",
    "solve_many",
    "solve_replan",
]
