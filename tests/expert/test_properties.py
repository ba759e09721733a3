# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Properties of the search on random instances, against an oracle that shares nothing with it."""

import numpy as np
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st

from magat_expert import SolveStatus, check_paths, solve

BOUNDS = st.sampled_from([1.0, 1.05, 1.1, 1.5, 3.0])
SETTINGS = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}


def largest_component(obstacles):
    """Free cells (x, y) of the largest connected part."""
    left = {(int(x), int(y)) for y, x in np.argwhere(~obstacles)}
    largest = []
    while left:
        component = [left.pop()]
        for x, y in component:
            for cell in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
                if cell in left:
                    left.remove(cell)
                    component.append(cell)
        largest = max(largest, component, key=len)
    return sorted(largest)


@st.composite
def tiny_instances(draw):
    """Two or three robots on a few cells, where most paths conflict."""
    # All but the sizes comes from a generator: drawn one by one, cells would mostly be the simplest ones.
    width, height, robots = draw(st.integers(2, 5)), draw(st.integers(1, 4)), draw(st.integers(2, 3))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    obstacles = generator.random((height, width)) < generator.choice([0.0, 0.2, 0.4])
    cells = largest_component(obstacles)
    assume(len(cells) >= robots)
    starts, goals = ([cells[i] for i in generator.permutation(len(cells))[:robots]] for _ in range(2))
    return obstacles, starts, goals


@given(tiny_instances(), BOUNDS)
@settings(max_examples=800, **SETTINGS)
@example((np.zeros((1, 2), bool), [(0, 0), (1, 0)], [(1, 0), (0, 0)]), 1.1)
def test_agrees_with_brute_force(optimal_cost, cost_of, instance, w):
    optimum = optimal_cost(*instance)
    if optimum is None:
        hopeless = solve(*instance, w, node_limit=200)
        assert hopeless.status in (SolveStatus.NO_SOLUTION, SolveStatus.NODE_LIMIT)
        return

    solution = solve(*instance, w, time_limit=60.0)

    assert solution.status is SolveStatus.SOLVED
    assert check_paths(*instance, solution.paths) == []
    assert solution.cost == cost_of(solution.paths)
    assert solution.lower_bound <= optimum <= solution.cost <= w * solution.lower_bound


@given(
    seed=st.integers(0, 2**32 - 1),
    side=st.integers(8, 24),
    density=st.sampled_from([0.0, 0.1, 0.25]),
    share=st.floats(0.01, 0.15),
    w=st.sampled_from([1.1, 1.3, 2.0, 5.0]),
)
@settings(max_examples=200, **SETTINGS)
def test_paths_are_valid_bounded_and_repeatable(cost_of, seed, side, density, share, w):
    generator = np.random.default_rng(seed)
    obstacles = generator.random((side, side)) < density
    cells = np.array(largest_component(obstacles))
    robots = max(1, int(share * len(cells)))
    instance = (obstacles, generator.permutation(cells)[:robots], generator.permutation(cells)[:robots])

    solution = solve(*instance, w, time_limit=60.0, node_limit=2000)
    again = solve(*instance, w, time_limit=60.0, node_limit=2000)

    assert solution.status is again.status
    assert solution.lower_bound == again.lower_bound
    assert solution.expansions_high == again.expansions_high
    assert solution.expansions_low == again.expansions_low
    if not solution.solved:  # a crowd in narrow passages may take more nodes
        assert solution.status is SolveStatus.NODE_LIMIT
        return
    assert np.array_equal(solution.paths, again.paths)
    assert check_paths(*instance, solution.paths) == []
    assert solution.cost == cost_of(solution.paths)
    assert solution.cost <= w * solution.lower_bound
    assert solution.makespan == len(solution.paths) - 1
    assert solution.makespan == 0 or (solution.paths[-1] != solution.paths[-2]).any()


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, **SETTINGS)
def test_cases_of_the_training_set_are_solved_at_once(seed):
    generator = np.random.default_rng(seed)
    obstacles = generator.random((20, 20)) < 0.1
    cells = np.array(largest_component(obstacles))
    instance = (obstacles, generator.permutation(cells)[:10], generator.permutation(cells)[:10])

    assert solve(*instance, w=1.1, node_limit=1000).solved
