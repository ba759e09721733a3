"""Numbers that the simulator node, the evaluation and the training share. Quick to import."""

#: T_max is this many times the expert's makespan (MAGAT paper, Sec. VI-A).
T_MAX_FACTOR = 3
#: The expert's suboptimality bound w: its solutions cost at most w times the optimum.
EXPERT_W = 1.1
