# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cases drawn from a seed and a number."""

import hashlib
from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_sim.case import Case, InvalidCaseError, draw_case, make_case


def fingerprint(case: Case) -> str:
    """SHA-256 over everything in a case, the same on machines of any byte order."""
    parts = [case.obstacles.astype("u1"), case.starts.astype("<i8"), case.goals.astype("<i8")]
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


def reachable(obstacles: np.ndarray, start: tuple[int, int]) -> set[tuple[int, int]]:
    """Cells that can be reached from ``start``, by breadth-first search."""
    height, width = obstacles.shape
    seen, queue = {start}, deque([start])
    while queue:
        x, y = queue.popleft()
        for cell in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
            on_map = 0 <= cell[0] < width and 0 <= cell[1] < height
            if on_map and not obstacles[cell[1], cell[0]] and cell not in seen:
                seen.add(cell)
                queue.append(cell)
    return seen


@pytest.mark.parametrize(
    ("size", "expected"),
    [
        ({}, "af7d406d7676ddd172dd2ddf9980f8bfd637fe92a13e22d0f58e505504f17a7b"),
        (
            {"width": 7, "height": 5, "robots": 4, "density": 0.3},
            "5bf5d83aa78475baf5a146ce84677e30c0415e080383166ea8724dde72660e12",
        ),
    ],
)
def test_every_machine_draws_the_same_case(size: dict, expected: str) -> None:
    assert fingerprint(draw_case(2021, 7, **size)) == expected


def test_one_seed_and_number_always_give_one_case() -> None:
    assert fingerprint(draw_case(5, 11)) == fingerprint(draw_case(5, 11))


def test_numbers_and_seeds_give_cases_of_their_own() -> None:
    pairs = [(seed, number) for seed in range(6) for number in range(50)]
    assert len({fingerprint(draw_case(*pair)) for pair in pairs}) == len(pairs)


@settings(max_examples=150)
@given(
    seed=st.integers(0, 2**63 - 1),
    number=st.integers(0, 2**40),
    width=st.integers(1, 14),
    height=st.integers(1, 14),
    density=st.floats(0, 0.7),
    share=st.floats(0, 1),
)
def test_drawn_cases_have_the_exact_density_and_every_goal_can_be_reached(
    seed: int, number: int, width: int, height: int, density: float, share: float
) -> None:
    count = round(density * width * height)
    robots = 1 + int(share * (width * height - count - 1))
    if count + robots > width * height:
        return
    case = draw_case(seed, number, width, height, robots, density)
    assert case.obstacles.shape == (height, width)
    assert case.obstacles.sum() == count
    assert case.robots == robots == len(case.goals)
    starts, goals = (list(map(tuple, cells.tolist())) for cells in (case.starts, case.goals))
    assert len(set(starts)) == robots == len(set(goals))
    for start, goal in zip(starts, goals, strict=True):
        assert not case.obstacles[start[1], start[0]]
        assert goal in reachable(case.obstacles, start)
    checked = make_case(case.obstacles, case.starts, case.goals)
    assert fingerprint(checked) == fingerprint(case)


def test_obstacles_starts_and_goals_are_spread_evenly_over_the_map() -> None:
    cases = [draw_case(1, number, 8, 6, 3, 0.25) for number in range(3000)]
    obstacles = np.mean([case.obstacles for case in cases], axis=0)
    assert np.abs(obstacles - 0.25).max() < 0.035  # more than four standard deviations
    for cells in ([case.starts for case in cases], [case.goals for case in cases]):
        x, y = np.concatenate(cells).T
        counts = np.histogram2d(x, y, bins=[range(9), range(7)])[0]
        expected = 3000 * 3 / 48
        # Chi-square of 47 degrees of freedom: 47 on average, above 95 once in 20,000 tries.
        assert ((counts - expected) ** 2 / expected).sum() < 95


@pytest.mark.parametrize(
    ("size", "said"),
    [
        ({"robots": 401, "density": 0.0}, "robots do not fit"),
        ({"robots": 361}, "robots do not fit"),
        ({"density": 1.0}, "robots do not fit"),
        ({"robots": 0}, "a case of 0 robots: ask for at least 1"),
        ({"width": 0}, "a map of 0x20 cells has no cells"),
        ({"height": -3}, "a map of 20x-3 cells has no cells"),
        ({"density": -0.1}, "the obstacle density is -0.1: give a share of the cells"),
        ({"density": 1.5}, "the obstacle density is 1.5"),
        ({"density": float("nan")}, "the obstacle density is nan"),
        ({"density": float("inf")}, "the obstacle density is inf"),
    ],
)
def test_a_case_that_cannot_be_drawn_is_refused(size: dict, said: str) -> None:
    with pytest.raises(InvalidCaseError, match=said):
        draw_case(0, 0, **size)


def test_a_map_that_would_fill_the_memory_is_refused() -> None:
    with pytest.raises(InvalidCaseError, match="65535x65535 cells is too large to be drawn: ask for at most 1048576"):
        draw_case(seed=1, number=2, width=65535, height=65535)
