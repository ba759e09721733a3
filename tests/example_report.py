# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A report for tests of pages and files."""

from magat_evaluation.report import Report


def report(**changes: object) -> Report:
    """What there is of a point on 30 cases."""
    values = {
        "policy": "a", "temperature": 0.75, "encoding": "int8", "link_loss": 0.0, "alpha": 0.9,
        "alpha_interval": (0.8, 0.95), "alpha_strict": 0.8, "alpha_strict_interval": (0.7, 0.9), "delta_ft": 0.1,
        "delta_ft_half_width": 0.01, "p_rg": 0.99, "delta_ft_strict": 0.3, "cases": 30, "unsolved_by_expert": 2,
        "width": 100, "height": 100, "robots": 500, "density": 0.1, "expert_w": 5.0, "generator_version": 1, "seed": 1,
        "first_case": 0, "shield": "idle", "shield_version": 3, "digest": "ab", "bytes_per_step": 164,
        "makespan": 200.5, "moves_blocked": 7.0, "stranded": {0: 27, 1: 2, 40: 1},
    }  # fmt: skip
    return Report(**values | changes)
