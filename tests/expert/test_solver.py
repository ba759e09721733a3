# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Small instances, each for one property, and the limits of a search."""

import dataclasses
import math
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from magat_expert import SolveStatus, StopFlag, check_paths, solve

# Four robots on four cells can only turn in a ring, so exchanging two neighbours has no solution. The search
# cannot know: it is the instance for every test in which a search must not end by itself.
HOPELESS = (np.zeros((2, 2), bool), [(0, 0), (1, 0), (1, 1), (0, 1)], [(1, 0), (0, 0), (1, 1), (0, 1)])

SOLVABLE = {
    "one robot": """
        . . # B
        b . # .
        # . . .""",
    "a robot on its goal": """
        aA . .
        .  b B""",
    "a robot on its goal, in the way": """
        # .  #
        b aA B""",
    "the goal of one is the start of another": """
        a Ab B .""",
    "passing in the open": """
        aB . . . bA
        .  . . . .""",
    "passing in a corridor with a bay": """
        #  # . # #
        aB . . . bA""",
    "a bay at the far end": """
        #  # . #  #
        aB . . bA .""",
    "three reverse their order around a block": """
        .  .  .  .
        aC bB cA #""",
    "two ways to one cell, one of them a swap": """
        # a . #
        B . A b""",
    "a full ring turns": """
        aD bA
        dC cB""",
    "a full map at rest": """
        aA bB
        cC dD""",
    "two components": """
        aB bA # cD dC
        .  .  # .  .""",
}


@pytest.mark.parametrize("w", [1.0, 1.1, 2.0])
@pytest.mark.parametrize("name", SOLVABLE)
def test_solves_within_the_bound(name, w, world, optimal_cost, cost_of):
    obstacles, starts, goals = world(SOLVABLE[name])
    optimum = optimal_cost(obstacles, starts, goals)

    solution = solve(obstacles, starts, goals, w)

    assert solution.status is SolveStatus.SOLVED
    assert check_paths(obstacles, starts, goals, solution.paths) == []
    assert solution.cost == cost_of(solution.paths)
    assert solution.lower_bound <= optimum <= solution.cost <= w * solution.lower_bound


def test_a_solution_says_what_the_docstring_promises(world):
    obstacles, starts, goals = world(SOLVABLE["passing in a corridor with a bay"])
    solution = solve(obstacles, starts, goals)

    assert solution.solved
    assert solution.paths.dtype == np.int16
    assert solution.paths.shape == (solution.makespan + 1, 2, 2)
    assert solution.seconds > 0.0
    assert solution.expansions_high > 0
    assert solution.expansions_low > solution.expansions_high
    with pytest.raises(dataclasses.FrozenInstanceError):
        solution.cost = 0


def test_nothing_to_do_costs_nothing():
    solution = solve(np.zeros((1, 1), bool), [(0, 0)], [(0, 0)])

    assert (solution.cost, solution.lower_bound, solution.makespan) == (0, 0, 0)
    assert solution.paths.tolist() == [[[0, 0]]]


def test_a_visit_of_the_goal_is_not_the_arrival(world):
    # b has to pass over a's goal, where a stands: a must step aside and come back.
    obstacles, starts, goals = world(SOLVABLE["a robot on its goal, in the way"])
    solution = solve(obstacles, starts, goals, w=1.0)

    assert solution.paths[:, 0].tolist() == [[1, 0], [1, 1], [1, 0]]
    assert solution.cost == 4  # two steps of each


def test_x_is_right_and_y_is_up():
    obstacles = np.array([[False, True], [False, False], [False, True]])  # [y, x]
    solution = solve(obstacles, [(0, 0)], [(1, 1)])

    assert solution.paths[:, 0].tolist() == [[0, 0], [0, 1], [1, 1]]


@pytest.mark.parametrize(
    "drawing",
    [
        "aB . . . bA",
        "aA bC . cB",
        """
        #  #  dD
        aB #  cC
        bA #  #""",
        """
        #  aB #
        bC cD dA""",
    ],
    ids=["a corridor", "a part of a corridor", "one corridor of two", "a full tree"],
)
def test_recognises_that_there_is_no_solution(drawing, world, optimal_cost):
    obstacles, starts, goals = world(drawing)
    assert optimal_cost(obstacles, starts, goals) is None

    solution = solve(obstacles, starts, goals)

    assert solution.status is SolveStatus.NO_SOLUTION
    assert solution.paths is None
    assert not solution.solved


def test_a_corridor_in_the_right_order_is_solved(world):
    obstacles, starts, goals = world("a b A . B")
    assert solve(obstacles, starts, goals).solved


@pytest.mark.parametrize("limit", [0.01, 0.1, 0.5])
def test_the_time_limit_holds(limit):
    start = time.perf_counter()
    solution = solve(*HOPELESS, time_limit=limit)
    elapsed = time.perf_counter() - start

    assert solution.status is SolveStatus.TIMED_OUT
    assert solution.paths is None
    assert limit <= solution.seconds <= elapsed < limit + 0.2  # a few ms, and some for a machine with other work


def test_the_time_limit_holds_on_a_large_map():
    side, robots = 150, 400
    generator = np.random.default_rng(1)
    cells = [(int(c) % side, int(c) // side) for c in generator.permutation(side * side)[: 2 * robots]]

    start = time.perf_counter()
    solution = solve(np.zeros((side, side), bool), cells[:robots], cells[robots:], w=1.0, time_limit=0.05)

    assert solution.status is SolveStatus.TIMED_OUT
    assert time.perf_counter() - start < 0.3


def test_a_lower_bound_is_known_even_without_a_solution():
    early = solve(*HOPELESS, node_limit=10)
    late = solve(*HOPELESS, node_limit=1000)

    assert early.status is late.status is SolveStatus.NODE_LIMIT
    assert (early.expansions_high, late.expansions_high) == (10, 1000)
    assert 2 <= early.lower_bound < late.lower_bound


def test_a_node_limit_of_zero_suffices_without_conflicts(world):
    obstacles, starts, goals = world("a A # b B")
    assert solve(obstacles, starts, goals, node_limit=0).solved


def test_a_stop_flag_ends_a_search_in_another_thread():
    stop = StopFlag()
    found = []
    thread = threading.Thread(
        target=lambda: found.append(solve(*HOPELESS, time_limit=math.inf, stop=stop)), daemon=True
    )
    thread.start()
    assert not stop.is_set()

    stop.set()  # that this thread gets here shows that a search leaves Python's lock to others
    thread.join(timeout=10.0)

    assert stop.is_set()
    assert [solution.status for solution in found] == [SolveStatus.STOPPED]


def test_a_signal_handler_can_end_a_search():
    class Alarm(Exception):  # noqa: N818
        pass

    def ring(*_):
        raise Alarm

    before = signal.signal(signal.SIGALRM, ring)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with pytest.raises(Alarm):
            solve(*HOPELESS, time_limit=math.inf)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def test_the_package_needs_no_ros():
    code = "import sys, magat_expert; print(*(m for m in sys.modules if m in ('rclpy', 'magat_interfaces')))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == []
