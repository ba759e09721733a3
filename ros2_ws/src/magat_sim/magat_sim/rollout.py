# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whole episodes in one process: the batched simulator with any decision function."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from magat_sim.grid import IntArray
from magat_sim.simulator import Actions, Observation, Simulator

#: Returns the actions of R robots for an observation of them, or only their primitives (``[R]``).
Decide = Callable[[Observation], npt.ArrayLike | Actions]


def run(simulator: Simulator, decide: Decide, on_step: Callable[[Simulator], None] | None = None) -> None:
    """Step ``simulator`` until every world is done; ``on_step`` is called after each step."""
    while not simulator.done:
        simulator.step(decide(simulator.observe()))
        if on_step is not None:
            on_step(simulator)


def run_recorded(simulator: Simulator, decide: Decide) -> IntArray:
    """Like `run`, for one world; returns the paths, ``[ticks + 1, N, 2]`` int64 cells ``(x, y)``."""
    paths = [simulator.position.copy()]
    run(simulator, decide, lambda after: paths.append(after.position.copy()))
    return np.stack(paths)
