# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""LaCAM*: its paths are valid, it is complete on small maps, and its limits hold."""

import heapq
import itertools
import math
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from magat_expert import InvalidInstanceError, SolveStatus, StopFlag, check_paths, solve, solve_lacam

#: Two robots that have to pass each other in a corridor with one bay.
BAY = (
    np.array([[False, False, False, False, False], [True, True, False, True, True]]),
    [(0, 0), (4, 0)],
    [(4, 0), (0, 0)],
)


def random_instance(seed, side, density, robots):
    """Obstacles, starts and goals, all in the largest component; fewer robots if it is small."""
    generator = np.random.default_rng(seed)
    obstacles = generator.random((side, side)) < density
    obstacles[0, 0] = False
    labels = _components(obstacles)
    largest = np.argmax(np.bincount(labels[labels >= 0]))
    free = np.argwhere(labels == largest)[:, ::-1]
    robots = min(robots, len(free))
    return obstacles, generator.permutation(free)[:robots], generator.permutation(free)[:robots]


def _components(obstacles):
    labels = np.full(obstacles.shape, -1)
    for label, (y, x) in enumerate(np.argwhere(~obstacles)):
        if labels[y, x] >= 0:
            continue
        stack = [(y, x)]
        while stack:
            y, x = stack.pop()
            inside = 0 <= y < obstacles.shape[0] and 0 <= x < obstacles.shape[1]
            if inside and not obstacles[y, x] and labels[y, x] < 0:
                labels[y, x] = label
                stack += [(y + 1, x), (y - 1, x), (y, x + 1), (y, x - 1)]
    return labels


@given(
    seed=st.integers(0, 2**32 - 1),
    side=st.integers(2, 14),
    density=st.sampled_from([0.0, 0.1, 0.3]),
    robots=st.integers(1, 30),
)
@hypothesis_settings(max_examples=60)
def test_paths_are_valid_and_repeatable(cost_of, seed, side, density, robots):
    instance = random_instance(seed, side, density, robots)
    solution = solve_lacam(*instance, time_limit=math.inf, node_limit=300, seed=seed)
    again = solve_lacam(*instance, time_limit=math.inf, node_limit=300, seed=seed)
    assert (solution.status, solution.expansions_high) == (again.status, again.expansions_high)
    assert solution.status in (SolveStatus.SOLVED, SolveStatus.NODE_LIMIT, SolveStatus.NO_SOLUTION)
    if solution.solved:
        assert np.array_equal(solution.paths, again.paths)
        assert check_paths(*instance, solution.paths) == []
        assert solution.cost == cost_of(solution.paths) >= solution.lower_bound
        assert solution.makespan == len(solution.paths) - 1
    else:
        assert solution.paths is None


@given(seed=st.integers(0, 2**32 - 1))
@hypothesis_settings(max_examples=25)
def test_on_small_maps_it_ends_with_the_least_losses_or_a_proof(seed):
    obstacles, starts, goals = instance = random_instance(seed, 3, 0.15, 3)
    solution, best = solve_lacam(*instance, time_limit=math.inf, seed=seed), _least_losses(obstacles, starts, goals)
    assert solution.status is (SolveStatus.NO_SOLUTION if best is None else SolveStatus.SOLVED)
    if best is not None:
        assert check_paths(*instance, solution.paths) == []
        assert _losses(solution.paths, goals) == best


def _least_losses(obstacles, starts, goals):
    """By Dijkstra's algorithm over the cells of all robots; None if there are no paths."""
    start, goal = (tuple(map(tuple, cells.tolist())) for cells in (starts, goals))
    queue, done = [(0, start)], set()
    while queue:
        losses, cells = heapq.heappop(queue)
        if cells == goal:
            return losses
        if cells in done:
            continue
        done.add(cells)
        for after in itertools.product(*(_reached(obstacles, *cell) for cell in cells)):
            if len(set(after)) == len(after) and not any(
                after[i] == cells[j] and after[j] == cells[i] for i, j in itertools.combinations(range(len(cells)), 2)
            ):
                away = sum(at != to or end != to for at, end, to in zip(cells, after, goal, strict=True))
                heapq.heappush(queue, (losses + away, after))
    return None


def _reached(obstacles, x, y):
    around = [(x, y), (x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)]
    height, width = obstacles.shape
    return [(a, b) for a, b in around if 0 <= a < width and 0 <= b < height and not obstacles[b, a]]


def test_robots_that_face_each_other_in_a_corridor_use_the_bay():
    solution = solve_lacam(*BAY, time_limit=math.inf)
    assert solution.solved
    assert check_paths(*BAY, solution.paths) == []
    assert solution.cost == solve(*BAY, w=1.0).cost


def test_a_dense_team_is_solved_at_once():
    generator = np.random.default_rng(4)
    obstacles = np.zeros((20, 20), bool)
    cells = np.argwhere(~obstacles)[:, ::-1]
    starts, goals = generator.permutation(cells)[:320], generator.permutation(cells)[:320]
    solution = solve_lacam(obstacles, starts, goals, time_limit=math.inf, node_limit=2_000)
    assert solution.solved
    assert check_paths(obstacles, starts, goals, solution.paths) == []


def test_more_expansions_never_cost_more():
    instance = random_instance(3, 8, 0.1, 6)
    losses = [
        _losses(solve_lacam(*instance, time_limit=math.inf, node_limit=limit).paths, instance[2])
        for limit in (200, 2_000, 20_000)
    ]
    assert losses == sorted(losses, reverse=True)
    assert losses[-1] < losses[0]


def _losses(paths, goals):
    away = (paths != goals).any(axis=2)
    return int((away[:-1] | away[1:]).sum())


def test_limits_end_the_search():
    crowded = random_instance(3, 30, 0.1, 400)
    assert solve_lacam(*crowded, node_limit=3).status is SolveStatus.NODE_LIMIT
    assert solve_lacam(*crowded, time_limit=1e-9).status is SolveStatus.TIMED_OUT
    assert solve_lacam(*crowded, memory_limit=1).status is SolveStatus.MEMORY_LIMIT
    stop = StopFlag()
    threading.Timer(0.1, stop.set).start()
    ended = solve_lacam(*random_instance(3, 10, 0.1, 20), time_limit=60.0, stop=stop)
    assert ended.status in (SolveStatus.SOLVED, SolveStatus.STOPPED)
    assert ended.seconds < 30


def test_memory_that_runs_out_keeps_the_best_solution():
    instance = random_instance(7, 12, 0.2, 20)
    solution = solve_lacam(*instance, time_limit=60.0, memory_limit=2)
    assert solution.solved
    assert check_paths(*instance, solution.paths) == []


@pytest.mark.parametrize(
    ("options", "said"),
    [({"node_limit": -1}, "node_limit is -1"), ({"seed": -1}, "seed is -1"), ({"time_limit": 0}, "0")],
)
def test_bad_parameters_are_named(options, said):
    with pytest.raises(InvalidInstanceError, match=said):
        solve_lacam(*BAY, **options)
