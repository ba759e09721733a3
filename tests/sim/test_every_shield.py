# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What holds under every registered shield."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_sim.constants import SHIELD_NAMES
from magat_sim.shield import SHIELDS
from magat_sim.simulator import Actions, Rules, Simulator
from magat_sim.streams import episode_streams


@pytest.mark.parametrize("shield", SHIELDS)
@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), width=st.integers(1, 9), height=st.integers(1, 9), share=st.floats(0.05, 1))
def test_robots_never_collide(
    random_case: Callable, judge: Callable, shield: str, seed: int, width: int, height: int, share: float
) -> None:
    rng = np.random.default_rng(seed)
    case = random_case(rng, width, height, max(1, int(share * width * height)))
    simulator = Simulator([case], [10], [episode_streams(seed, 0, case.robots)], Rules(shield=shield))
    while not simulator.done:
        before = simulator.position.copy()
        silent = rng.random(case.robots) < 0.1
        preferences = rng.normal(size=(case.robots, 5)).astype(np.float32)
        step = simulator.step(Actions(rng.integers(5, size=case.robots), preferences, silent))
        faults = judge(case.obstacles, before, step.moved, simulator.position)
        assert [fault for fault in faults if "was kept" not in fault] == []
        assert (simulator.position[silent] == before[silent]).all(), "a silent robot moved"


def test_the_names_are_those_of_the_shields() -> None:
    assert tuple(SHIELDS) == SHIELD_NAMES
