# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Worlds as a team would say them, without ROS."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from magat_sim.simulator import Simulator
from magat_sim.streams import episode_streams


@pytest.fixture
def walk(random_case) -> Callable:
    """An episode of robots that go wherever chance takes them: its case, its simulator at the end, and its worlds."""

    def run(robots: int = 5, ticks: int = 12, seed: int = 3, side: int = 7, episode: int = 2**63) -> SimpleNamespace:
        rng = np.random.default_rng(seed)
        case = random_case(rng, side, side + 1, robots, 0.1)
        simulator = Simulator([case], [ticks], [episode_streams(seed, 0, robots)])
        none = [False] * robots

        def world(action, moved, silent) -> SimpleNamespace:
            x, y = simulator.position.T.tolist()
            goal_x, goal_y = case.goals.T.tolist()
            grid = b"" if simulator.tick else case.obstacles.astype(np.uint8).tobytes()
            return SimpleNamespace(
                episode=episode, tick=simulator.tick, robots=[f"r_{i}" for i in range(robots)], width=side,
                height=side + 1, obstacles=grid, x=x, y=y, goal_x=goal_x, goal_y=goal_y, action=bytes(action),
                moved=bytes(moved), silent=list(silent), visited=simulator.visited.tolist(), links=4, seconds=0.02,
                t_max=ticks, expert_flowtime=20, expert_flowtime_strict=21,
            )  # fmt: skip

        worlds = [world([0] * robots, [0] * robots, none)]
        while not simulator.done:
            action = rng.integers(5, size=robots)
            step = simulator.step(action)
            worlds.append(world(action.tolist(), step.moved.tolist(), none))
        return SimpleNamespace(case=case, simulator=simulator, worlds=worlds)

    return run
