# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The measures computed from recorded positions are those of the simulator."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from magat_sim.measures import Flowtime, walk_measures
from magat_sim.simulator import Simulator
from magat_sim.streams import episode_streams


@given(seed=st.integers(0, 2**32 - 1), robots=st.integers(1, 4), t_max=st.integers(0, 30), solved=st.booleans())
def test_watching_and_running_come_to_the_same(random_case, seed, robots, t_max, solved):
    rng = np.random.default_rng(seed)
    case = random_case(rng, 4, 3, robots)  # so small that robots come to their goals, leave them and come back
    if case.robots < robots:
        return
    simulator = Simulator([case], [t_max], [episode_streams(seed, 0, robots)])
    on_goal, blocked = [simulator.on_goal], 0
    while not simulator.done:
        blocked += int(simulator.step(rng.integers(0, 5, robots)).blocked.sum())
        on_goal.append(simulator.on_goal)
    best = Flowtime(3, 4) if solved else None
    assert walk_measures(np.stack(on_goal), t_max, blocked, best) == simulator.measures([best])[0]


def test_all_kinds_of_endings_are_watched():
    """Three robots: one stays, one comes and leaves, one never comes."""
    on_goal = np.array([[False, False, False], [True, True, False], [True, False, False]])
    measures = walk_measures(on_goal, 2, 1, Flowtime(2, 3))
    assert (measures.success, measures.success_strict, measures.p_rg) == (False, False, pytest.approx(2 / 3))
    assert measures.flowtime == Flowtime(1 + 1 + 2, 1 + 2 + 2)
    assert (measures.makespan, measures.ticks, measures.moves_blocked) == (2, 2, 1)
