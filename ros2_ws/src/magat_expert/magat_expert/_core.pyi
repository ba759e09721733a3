# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

import numpy as np

class StopFlag:
    """Ends the searches that were given it; may be set by any thread."""

    def __init__(self) -> None: ...
    def set(self) -> None: ...
    def is_set(self) -> bool: ...

def solve(
    obstacles: np.ndarray,
    starts: np.ndarray,
    goals: np.ndarray,
    w: float,
    time_limit: float,
    node_limit: int,
    memory_limit: int,
    stop: StopFlag | None,
) -> tuple[int, np.ndarray | None, int, int, float, int, int]: ...
def solve_hca(
    obstacles: np.ndarray,
    starts: np.ndarray,
    goals: np.ndarray,
    time_limit: float,
    orders: int,
    seed: int,
    memory_limit: int,
    stop: StopFlag | None,
) -> tuple[int, np.ndarray | None, int, int, float, int, int]: ...
def solve_replan(
    obstacles: np.ndarray,
    starts: np.ndarray,
    goals: np.ndarray,
    time_limit: float,
    max_steps: int,
    seed: int,
    memory_limit: int,
    stop: StopFlag | None,
) -> tuple[int, np.ndarray | None, int, int, float, int, int]: ...
def solve_lacam(
    obstacles: np.ndarray,
    starts: np.ndarray,
    goals: np.ndarray,
    time_limit: float,
    node_limit: int,
    seed: int,
    memory_limit: int,
    stop: StopFlag | None,
) -> tuple[int, np.ndarray | None, int, int, float, int, int]: ...
def components(obstacles: np.ndarray) -> np.ndarray: ...
