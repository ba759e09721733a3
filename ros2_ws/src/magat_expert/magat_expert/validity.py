# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""An independent check of paths, in plain NumPy. It shares no code with the search."""

import numpy as np
from numpy.typing import ArrayLike

_MOST_REPORTED = 20


def check_paths(obstacles: ArrayLike, starts: ArrayLike, goals: ArrayLike, paths: ArrayLike) -> list[str]:
    """List the violations in a set of paths.

    Valid paths begin on the starts, end on the goals, use free cells only, and move at most one cell along one axis
    per step. No two robots are in one cell (vertex conflict) or exchange their cells in one step (swap conflict). A
    robot may follow another into the cell that it leaves.

    Args:
        obstacles: bool `[H, W]`, indexed `[y, x]`.
        starts: int `[N, 2]`, cells `(x, y)`.
        goals: int `[N, 2]`, cells `(x, y)`.
        paths: int `[T + 1, N, 2]`, cells `(x, y)` by time step and robot.

    Returns:
        One sentence for each violation, at most 20 of a kind; an empty list if the paths are valid.
    """
    blocked = np.asarray(obstacles).astype(bool)
    starts = np.asarray(starts, dtype=np.int64)
    goals = np.asarray(goals, dtype=np.int64)
    paths = np.asarray(paths)
    if paths.ndim != 3 or paths.shape[0] < 1 or paths.shape[1:] != starts.shape or starts.shape != goals.shape:
        return [
            f"paths have shape {paths.shape}, starts {starts.shape}, goals {goals.shape}: "
            "not [T + 1, N, 2], [N, 2], [N, 2]"
        ]
    if paths.dtype.kind not in "iu":
        return [f"paths have dtype {paths.dtype}, not integers"]
    paths = paths.astype(np.int64)

    violations = _wrong_ends(paths[0], starts, "begins", "start") + _wrong_ends(paths[-1], goals, "ends", "goal")
    off_map = _off_map(paths, blocked.shape)
    if off_map:
        return violations + off_map  # cells off the map have no index, so the rest cannot be checked
    return (
        violations
        + _on_obstacles(paths, blocked)
        + _jumps(paths)
        + _vertex_conflicts(paths, blocked.shape[1])
        + _swap_conflicts(paths, blocked.shape)
    )


def _show(cell: np.ndarray) -> str:
    return f"({int(cell[0])}, {int(cell[1])})"


def _wrong_ends(found: np.ndarray, expected: np.ndarray, verb: str, name: str) -> list[str]:
    wrong = np.flatnonzero((found != expected).any(axis=1))
    return [
        f"robot {r} {verb} on {_show(found[r])}, and its {name} is {_show(expected[r])}" for r in wrong[:_MOST_REPORTED]
    ]


def _off_map(paths: np.ndarray, shape: tuple[int, ...]) -> list[str]:
    height, width = shape
    x, y = paths[..., 0], paths[..., 1]
    where = np.argwhere((x < 0) | (y < 0) | (x >= width) | (y >= height))
    return [f"robot {r} is off the map at time {t}, on {_show(paths[t, r])}" for t, r in where[:_MOST_REPORTED]]


def _on_obstacles(paths: np.ndarray, blocked: np.ndarray) -> list[str]:
    where = np.argwhere(blocked[paths[..., 1], paths[..., 0]])
    return [f"robot {r} is on an obstacle at time {t}, on {_show(paths[t, r])}" for t, r in where[:_MOST_REPORTED]]


def _jumps(paths: np.ndarray) -> list[str]:
    lengths = np.abs(np.diff(paths, axis=0)).sum(axis=2)
    where = np.argwhere(lengths > 1)
    return [
        f"robot {r} jumps from {_show(paths[t, r])} to {_show(paths[t + 1, r])} after time {t}"
        for t, r in where[:_MOST_REPORTED]
    ]


def _vertex_conflicts(paths: np.ndarray, width: int) -> list[str]:
    cells = paths[..., 1] * width + paths[..., 0]
    order = np.argsort(cells, axis=1, kind="stable")
    ordered = np.take_along_axis(cells, order, axis=1)
    where = np.argwhere(ordered[:, 1:] == ordered[:, :-1])
    return [
        f"robots {order[t, i]} and {order[t, i + 1]} are both on {_show(paths[t, order[t, i]])} at time {t}"
        for t, i in where[:_MOST_REPORTED]
    ]


def _swap_conflicts(paths: np.ndarray, shape: tuple[int, ...]) -> list[str]:
    height, width = shape
    cells = paths[..., 1] * width + paths[..., 0]
    here, there = cells[:-1], cells[1:]
    # An edge has one number for both directions; the last bit of the key is the direction.
    edges = np.minimum(here, there) * (width * height) + np.maximum(here, there)
    keys = 2 * edges + (here > there)
    order = np.argsort(keys, axis=1, kind="stable")
    ordered = np.take_along_axis(keys, order, axis=1)
    where = np.argwhere((ordered[:, 1:] // 2 == ordered[:, :-1] // 2) & (ordered[:, 1:] != ordered[:, :-1]))
    violations = []
    for t, i in where[:_MOST_REPORTED]:
        a, b = sorted((int(order[t, i]), int(order[t, i + 1])))
        violations.append(f"robots {a} and {b} swap {_show(paths[t, a])} and {_show(paths[t, b])} after time {t}")
    return violations
