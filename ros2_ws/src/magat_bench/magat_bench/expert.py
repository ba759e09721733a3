# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat bench-expert``: the time of the expert on sets of cases, and its cost against the lower bound."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table

from magat_expert import Solution, solve_many
from magat_node.progress import tracked
from magat_sim.case import Case, draw_case

#: Share of obstacle cells of all sets.
_DENSITY = 0.1


@dataclass(frozen=True)
class ExpertSet:
    """Cases on square maps of one size with one number of robots, and the expert's suboptimality bound w."""

    side: int
    robots: int
    w: float

    @property
    def name(self) -> str:
        """Cells and robots, e.g. 20x20 (10)."""
        return f"{self.side}x{self.side} ({self.robots})"

    def cases(self, count: int, seed: int) -> Iterator[Case]:
        """The first ``count`` cases under ``seed``."""
        return (draw_case(seed, number, self.side, self.side, self.robots, _DENSITY) for number in range(count))


SETS = tuple(
    ExpertSet(side, robots, 1.1)
    for side, robots in ((20, 10), (28, 20), (35, 30), (40, 40), (50, 60), (50, 100), (65, 100))
)
LARGE_SETS = tuple(ExpertSet(side, robots, 5.0) for side, robots in ((100, 500), (200, 500), (200, 1000)))


@dataclass(frozen=True)
class ExpertSpeed:
    """Measures on the cases of one set, including unsolved ones unless stated otherwise."""

    cases: int
    #: Wall time of a search, milliseconds.
    mean: float
    median: float
    p95: float
    longest: float
    #: Space-time nodes expanded per second of search.
    expansions_per_second: float
    #: Sum of costs / sum of lower bounds over the solved cases, at most w; NaN if none is solved.
    cost_ratio: float
    #: Share of the cases that were solved within the time limit.
    solved: float


def measure(solutions: Sequence[Solution]) -> ExpertSpeed:
    """The measures of ``solutions``, at least one."""
    milliseconds = 1000.0 * np.array([solution.seconds for solution in solutions])
    solved = [solution for solution in solutions if solution.solved]
    lower_bound = sum(solution.lower_bound for solution in solved)
    return ExpertSpeed(
        cases=len(solutions),
        mean=float(milliseconds.mean()),
        median=float(np.median(milliseconds)),
        p95=float(np.quantile(milliseconds, 0.95)),
        longest=float(milliseconds.max()),
        expansions_per_second=sum(solution.expansions_low for solution in solutions) / (milliseconds.sum() / 1000.0),
        cost_ratio=sum(solution.cost for solution in solved) / lower_bound if lower_bound else float("nan"),
        solved=len(solved) / len(solutions),
    )


def bench_expert(
    counts: Sequence[tuple[ExpertSet, int]], seed: int, time_limit: float, console: Console
) -> list[ExpertSpeed]:
    """Solve cases one after another, on one core.

    Args:
        counts: the sets, each with a number of cases.
        seed: of the cases.
        time_limit: of each search, seconds.
        console: shows the progress.
    """
    speeds = []
    for which, count in counts:
        solutions = solve_many(which.cases(count, seed), w=which.w, time_limit=time_limit)
        speeds.append(measure(list(tracked(solutions, which.name, count, console))))
    return speeds


def table(counts: Sequence[tuple[ExpertSet, int]], speeds: Sequence[ExpertSpeed]) -> Table:
    """``speeds`` of the sets in ``counts`` for the terminal."""
    result = Table(title="ECBS, milliseconds of search per case", title_justify="left", box=None, pad_edge=False)
    for heading in ("set", "w", "cases", "mean", "median", "p95", "max", "Mexp/s", "cost/lb", "solved"):
        result.add_column(heading, justify="left" if heading == "set" else "right", overflow="fold")
    for (which, _), speed in zip(counts, speeds, strict=True):
        times = (speed.mean, speed.median, speed.p95, speed.longest)
        result.add_row(
            which.name,
            f"{which.w:g}",
            str(speed.cases),
            *(f"{time:.1f}" if time < 1000.0 else f"{time:.0f}" for time in times),
            f"{speed.expansions_per_second / 1e6:.2f}",
            f"{speed.cost_ratio:.3f}",
            f"{100 * speed.solved:.0f} %",
        )
    return result
