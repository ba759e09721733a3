# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Random instances, limits and memory for all planners; `make test-sanitizers` runs them with a checked build."""

import os

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_expert import InvalidInstanceError, SolveStatus, _core, check_paths, solve, solve_hca, solve_replan


def test_the_checked_build_is_the_one_that_runs():
    if "MAGAT_SANITIZED" in os.environ:
        assert "magat_expert_sanitized" in _core.__file__


@st.composite
def instances(draw):
    """Maps of any shape, also of one cell, with robots anywhere: some of them valid instances."""
    width, height = draw(st.integers(1, 40)), draw(st.integers(1, 40))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    obstacles = generator.random((height, width)) < draw(st.sampled_from([0.0, 0.05, 0.3, 0.6]))
    free = np.argwhere(~obstacles)[:, ::-1]
    robots = min(draw(st.integers(1, 40)), len(free))
    starts, goals = (generator.permutation(free)[:robots] for _ in range(2))
    if draw(st.integers(0, 9)) == 0:
        goals = goals + draw(st.integers(-2, 2))  # off the map, or on obstacles
    return obstacles, starts, goals


@given(
    instance=instances(),
    planner=st.sampled_from(["ecbs", "hca", "replan"]),
    memory_limit=st.integers(1, 8),
    small=st.integers(0, 200),
    w=st.sampled_from([1.0, 1.1, 3.0, 1000.0]),
)
@settings(max_examples=150, deadline=None)
def test_every_input_ends_in_a_status_or_an_error(instance, planner, memory_limit, small, w):
    obstacles, starts, goals = instance
    limits = {"time_limit": 1.0, "memory_limit": memory_limit}
    try:
        if planner == "ecbs":
            found = solve(*instance, w, node_limit=small, **limits)
        elif planner == "hca":
            found = solve_hca(*instance, orders=small + 1, seed=small, **limits)
        else:
            found = solve_replan(*instance, max_steps=small, seed=small, **limits)
    except InvalidInstanceError:
        return
    if found.paths is None:
        assert found.status is not SolveStatus.SOLVED
    else:
        assert check_paths(obstacles, starts, goals if found.solved else found.paths[-1], found.paths) == []
