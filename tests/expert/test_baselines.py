# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""HCA and Replan: their paths are valid, and `arrived` and the statuses are right."""

import math
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from magat_expert import InvalidInstanceError, SolveStatus, StopFlag, check_paths, solve_hca, solve_replan

EMPTY = np.zeros((5, 5), bool)
# Four robots on four cells, two of them to swap: HCA finds no order, and in Replan no robot has a free cell.
FULL = (np.zeros((2, 2), bool), [(0, 0), (1, 0), (1, 1), (0, 1)], [(1, 0), (0, 0), (1, 1), (0, 1)])
BASELINES = pytest.mark.parametrize("plan", [solve_hca, solve_replan])


def random_instance(seed, side, density, robots):
    """Obstacles, starts and goals; robots with unreachable goals are left out."""
    generator = np.random.default_rng(seed)
    obstacles = generator.random((side, side)) < density
    free = np.argwhere(~obstacles)[:, ::-1]
    robots = min(robots, len(free))
    starts, goals = generator.permutation(free)[:robots], generator.permutation(free)[:robots]
    kept = [_reachable(obstacles, start, goal) for start, goal in zip(starts, goals, strict=True)]
    return obstacles, starts[kept], goals[kept]


def _reachable(obstacles, start, goal):
    try:
        return solve_hca(obstacles, [start], [goal]).solved
    except InvalidInstanceError:
        return False


@BASELINES
@given(
    seed=st.integers(0, 2**32 - 1),
    side=st.integers(2, 14),
    density=st.sampled_from([0.0, 0.1, 0.3]),
    robots=st.integers(1, 30),
)
@hypothesis_settings(max_examples=60)
def test_paths_are_valid_repeatable_and_honest(plan, cost_of, seed, side, density, robots):
    instance = random_instance(seed, side, density, robots)
    if len(instance[1]) == 0:
        return
    solution = plan(*instance, time_limit=math.inf, seed=seed)

    again = plan(*instance, time_limit=math.inf, seed=seed)
    assert (solution.status, solution.expansions_low) == (again.status, again.expansions_low)
    assert solution.status in (SolveStatus.SOLVED, SolveStatus.INCOMPLETE, SolveStatus.NO_SOLUTION)
    assert solution.solved == bool(solution.arrived.all())
    if solution.paths is None:
        assert plan is solve_hca or solution.status is SolveStatus.NO_SOLUTION
        assert (solution.cost, solution.makespan, solution.arrived.any()) == (0, 0, False)
        return
    assert np.array_equal(solution.paths, again.paths)
    obstacles, starts, goals = instance
    assert check_paths(obstacles, starts, solution.paths[-1], solution.paths) == []
    assert solution.arrived.tolist() == (solution.paths[-1] == goals).all(axis=1).tolist()
    if solution.solved:
        assert solution.cost == cost_of(solution.paths) >= solution.lower_bound
        assert solution.makespan == len(solution.paths) - 1
    else:
        assert plan is solve_replan
        assert (solution.cost, solution.makespan) == (0, 0)


@given(seed=st.integers(0, 2**32 - 1))
@hypothesis_settings(max_examples=25)
def test_neither_beats_the_optimum(optimal_cost, seed):
    obstacles, starts, goals = random_instance(seed, 4, 0.1, 3)
    if len(starts) == 0:
        return
    optimum = optimal_cost(obstacles, [tuple(c) for c in starts.tolist()], [tuple(c) for c in goals.tolist()])
    for plan in (solve_hca, solve_replan):
        solution = plan(obstacles, starts, goals, seed=seed)
        if solution.solved:
            assert optimum is not None
            assert solution.lower_bound <= optimum <= solution.cost
        if len(starts) == 1:
            assert solution.cost == solution.lower_bound == optimum


@BASELINES
def test_robots_apart_take_shortest_paths(plan):
    solution = plan(EMPTY, [(0, 0), (0, 4)], [(4, 0), (4, 4)])
    assert (solution.cost, solution.lower_bound, solution.makespan) == (8, 8, 4)
    assert solution.paths.dtype == np.int16


def test_hca_arrives_only_when_no_robot_passes_any_more(world):
    # a crosses b's goal at time 3, where b could be at 1.
    solution = solve_hca(
        *world("""
        . . . b .
        a . . B A""")
    )
    assert solution.solved
    assert solution.paths[-1].tolist() == [[4, 0], [3, 0]]
    assert solution.paths[3].tolist()[0] == [3, 0]
    assert solution.cost == 4 + 4


def test_hca_tries_other_orders(world):
    # a, planned first, goes straight to the goal in the only passage, for ever in the way of b.
    instance = world("""
        #  #  #  #
        b  a  A  B""")
    first = solve_hca(*instance, orders=1)
    assert (first.status, first.paths, first.expansions_high) == (SolveStatus.NO_SOLUTION, None, 0)

    instance = world("""
        # . # #
        b a A B""")
    first = solve_hca(*instance, orders=1)
    assert (first.status, first.paths, first.expansions_high) == (SolveStatus.INCOMPLETE, None, 1)
    solution = solve_hca(*instance, orders=2)
    assert solution.solved
    assert solution.expansions_high == 2
    assert check_paths(*instance, solution.paths) == []


def test_replan_goes_around_a_robot_at_rest(world):
    obstacles, starts, goals = world("""
        . . .  . .
        a . bB . A""")
    solution = solve_replan(obstacles, starts, goals)
    assert check_paths(obstacles, starts, goals, solution.paths) == []
    assert (solution.cost, solution.expansions_high) == (6, 1)


def test_replan_waits_without_a_detour_and_says_which_robots_arrived(world):
    obstacles, starts, goals = world("""
        # # #  # .
        a . bB A .
        c C #  # #""")
    solution = solve_replan(obstacles, starts, goals)
    assert solution.status is SolveStatus.INCOMPLETE
    assert solution.arrived.tolist() == [False, True, True]
    assert check_paths(obstacles, starts, [(1, 1), (2, 1), (1, 0)], solution.paths) == []
    assert len(solution.paths) <= 4, "it ends when no robot can move"


def test_replan_lets_robots_follow_each_other():
    row = [(x, 0) for x in range(4)]
    steps = [solve_replan(np.zeros((1, 8), bool), row, [(x + 4, 0) for x in range(4)], seed=s) for s in range(20)]
    assert all(s.solved for s in steps)
    assert min(s.makespan for s in steps) < 10


def test_replan_ends_at_t_max():
    solution = solve_replan(EMPTY, [(0, 0), (0, 4)], [(4, 0), (2, 4)], max_steps=3)
    assert solution.status is SolveStatus.INCOMPLETE
    assert solution.paths[-1].tolist() == [[3, 0], [2, 4]]
    assert solution.arrived.tolist() == [False, True]
    assert solve_replan(EMPTY, [(0, 0)], [(4, 0)], max_steps=0).paths.tolist() == [[[0, 0]]]


@BASELINES
def test_what_is_beyond_them_is_incomplete(plan):
    assert plan(*FULL).status is SolveStatus.INCOMPLETE


def test_the_time_limit_of_hca_holds():
    started = time.perf_counter()
    solution = solve_hca(*FULL, time_limit=0.05, orders=2**31 - 1)
    assert solution.status is SolveStatus.TIMED_OUT
    assert 0.05 <= solution.seconds <= time.perf_counter() - started < 0.5


def test_the_time_limit_of_replan_leaves_the_paths_so_far():
    cells = [(x, y) for x in range(60) for y in range(60)]
    generator = np.random.default_rng(3)
    starts, goals = (generator.permutation(cells)[:1200] for _ in range(2))
    solution = solve_replan(np.zeros((60, 60), bool), starts, goals, time_limit=0.05)
    assert solution.status is SolveStatus.TIMED_OUT
    assert solution.seconds < 0.5
    assert check_paths(np.zeros((60, 60), bool), starts, solution.paths[-1], solution.paths) == []


@BASELINES
def test_a_stop_flag_ends_it(plan):
    stop = StopFlag()
    stop.set()
    assert plan(*FULL, stop=stop).status is SolveStatus.STOPPED


def test_a_stop_flag_ends_hca_in_another_thread():
    stop, found = StopFlag(), []
    search = {"time_limit": math.inf, "orders": 2**31 - 1, "stop": stop}
    thread = threading.Thread(target=lambda: found.append(solve_hca(*FULL, **search)), daemon=True)
    thread.start()
    stop.set()
    thread.join(timeout=10.0)
    assert [solution.status for solution in found] == [SolveStatus.STOPPED]


@pytest.mark.parametrize(
    ("plan", "limits", "message"),
    [
        (solve_hca, {"orders": 0}, "orders is 0: give 1 or more"),
        (solve_hca, {"orders": 1.5}, "orders is 1.5: give a whole number"),
        (solve_hca, {"seed": -1}, "seed is -1: give 0 or more"),
        (solve_hca, {"seed": 2**64}, "seed is 18446744073709551616: give at most"),
        (solve_hca, {"time_limit": 0}, "time_limit is 0"),
        (solve_replan, {"max_steps": -1}, "max_steps is -1: give 0 or more"),
        (solve_replan, {"max_steps": 10**7}, "max_steps is 10000000: give at most 1000000"),
        (solve_replan, {"time_limit": math.nan}, "time_limit is NaN"),
    ],
)
def test_senseless_limits_are_refused(plan, limits, message):
    with pytest.raises(InvalidInstanceError, match=message):
        plan(EMPTY, [(0, 0)], [(1, 1)], **limits)


@BASELINES
def test_an_invalid_instance_is_refused(plan):
    with pytest.raises(InvalidInstanceError, match="the same goal"):
        plan(EMPTY, [(0, 0), (1, 0)], [(1, 1), (1, 1)])
