# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Numbers and names that the simulator node, launch, the evaluation and the training share. Quick to import."""

#: T_max is this many times the expert's makespan (MAGAT paper, Sec. VI-A).
T_MAX_FACTOR = 3
#: The expert's suboptimality bound w: its solutions cost at most w times the optimum.
EXPERT_W = 1.1
#: The names of `magat_sim.shield.SHIELDS`.
SHIELD_NAMES = ("idle", "pibt", "pibt-memory")
