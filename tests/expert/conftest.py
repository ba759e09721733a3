# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shared by the tests of the expert: an oracle that finds optimal costs by brute force, and small maps."""

import heapq
import itertools
from collections import deque
from collections.abc import Callable

import numpy as np
import pytest

Cell = tuple[int, int]


@pytest.fixture(scope="session")
def world() -> Callable[[str], tuple[np.ndarray, list[Cell], list[Cell]]]:
    """Reads a drawing: '#' is an obstacle, a letter a start, its capital the goal; the last line is y = 0."""

    def read(drawing: str) -> tuple[np.ndarray, list[Cell], list[Cell]]:
        rows = [line.split() for line in drawing.strip().splitlines()][::-1]
        obstacles = np.array([[cell == "#" for cell in row] for row in rows])
        where = {letter: (x, y) for y, row in enumerate(rows) for x, cell in enumerate(row) for letter in cell}
        robots = sorted(letter for letter in where if letter.islower())
        return obstacles, [where[r] for r in robots], [where[r.upper()] for r in robots]

    return read


@pytest.fixture(scope="session")
def cost_of() -> Callable[[np.ndarray], int]:
    """The sum over robots of the time after which the robot stays on its last cell."""

    def cost(paths: np.ndarray) -> int:
        total = 0
        for robot in range(paths.shape[1]):
            cells = [tuple(cell) for cell in paths[:, robot]]
            while len(cells) > 1 and cells[-1] == cells[-2]:
                cells.pop()
            total += len(cells) - 1
        return total

    return cost


@pytest.fixture(scope="session")
def optimal_cost() -> Callable[..., int | None]:
    """The least cost of valid paths, or None if there are none: A* over the cells of all robots together.

    A state also says which robots have come to rest for good; only the others pay for a step.
    """
    return _optimal_cost


def _optimal_cost(obstacles: np.ndarray, starts: list[Cell], goals: list[Cell]) -> int | None:
    robots = range(len(starts))
    distances = [_distances(obstacles, goal) for goal in goals]
    best: dict[tuple[tuple[Cell, ...], frozenset[int]], int] = {}
    queue: list[tuple[int, int, tuple[Cell, ...], list[int]]] = []

    def reach(cells: tuple[Cell, ...], resting: frozenset[int], cost: int) -> None:
        may_rest = [r for r in robots if r not in resting and cells[r] == goals[r]]
        for count in range(len(may_rest) + 1):
            for more in itertools.combinations(may_rest, count):
                state = (cells, resting.union(more))
                if cost < best.get(state, cost + 1):
                    best[state] = cost
                    to_go = sum(distances[r][cells[r]] for r in robots if r not in state[1])
                    heapq.heappush(queue, (cost + to_go, cost, cells, sorted(state[1])))

    reach(tuple(starts), frozenset(), 0)
    while queue:
        _, cost, cells, at_rest = heapq.heappop(queue)
        resting = frozenset(at_rest)
        if cost > best[cells, resting]:
            continue
        if len(resting) == len(starts):
            return cost
        options = [[cells[r]] if r in resting else _steps(obstacles, cells[r]) for r in robots]
        for after in itertools.product(*options):
            if len(set(after)) == len(after) and not _swaps(cells, after):
                reach(after, resting, cost + len(starts) - len(resting))
    return None


def _swaps(before: tuple[Cell, ...], after: tuple[Cell, ...]) -> bool:
    return any(
        after[a] == before[b] and after[b] == before[a] for a, b in itertools.combinations(range(len(before)), 2)
    )


def _steps(obstacles: np.ndarray, cell: Cell) -> list[Cell]:
    height, width = obstacles.shape
    x, y = cell
    around = [(x, y), (x, y + 1), (x, y - 1), (x - 1, y), (x + 1, y)]
    return [(i, j) for i, j in around if 0 <= i < width and 0 <= j < height and not obstacles[j, i]]


def _distances(obstacles: np.ndarray, goal: Cell) -> dict[Cell, int]:
    distances = {goal: 0}
    queue = deque([goal])
    while queue:
        cell = queue.popleft()
        for step in _steps(obstacles, cell):
            if step not in distances:
                distances[step] = distances[cell] + 1
                queue.append(step)
    return distances
