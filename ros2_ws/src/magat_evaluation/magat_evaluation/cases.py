# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cases for training, validation and tests, with the expert's solutions."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from magat_evaluation.splits import EXPERT_NODE_LIMIT, EXPERT_W, SET_SEED, SPLITS
from magat_expert import SolveStatus, solve_many
from magat_sim.case import Case, InvalidCaseError, draw_case
from magat_sim.constants import T_MAX_FACTOR
from magat_sim.grid import IntArray
from magat_sim.measures import Flowtime, expert_flowtime

#: Version of drawing and solving cases. Raise it with every change after which a seed gives other cases or other paths:
#: older data sets (`magat_training.data`) are then refused, and older reports are stale.
GENERATOR_VERSION = 1


@dataclass(frozen=True)
class SolvedCase:
    """A case and the expert's solution."""

    #: Its number under the seed, which also selects the random streams of its episode.
    number: int
    case: Case
    #: ``[T + 1, N, 2]`` int16 cells; T is the expert's makespan.
    paths: IntArray

    @property
    def flowtime(self) -> Flowtime:
        """The expert's flowtime, FT*."""
        return expert_flowtime(self.paths, self.case.goals)

    @property
    def t_max(self) -> int:
        """Steps at most in an episode on this case."""
        return T_MAX_FACTOR * (len(self.paths) - 1)


def first_cases(count: int) -> dict[str, range]:
    """Numbers of ``count`` of the 30,000 cases by split, 70 / 15 / 15 %.

    They are the first numbers of each split, so a case is in the same split of every data set.

    Raises:
        InvalidCaseError: fewer than 3 cases, which leave a split empty, or more than 30,000.
    """
    most = sum(map(len, SPLITS.values()))
    if not 3 <= count <= most:
        raise InvalidCaseError(f"{count} cases cannot be split in three: ask for 3 to {most}")
    held_out = -(-count * 15 // 100)  # rounded up, at the expense of the training split
    counts = {"train": count - 2 * held_out, "valid": held_out, "test": held_out}
    return {split: SPLITS[split][: counts[split]] for split in SPLITS}


def solved_cases(
    numbers: Sequence[int],
    seed: int = SET_SEED,
    workers: int = 2,
    expert_w: float = EXPERT_W,
    expert_time: float = math.inf,
    **size: float,
) -> Iterator[SolvedCase]:
    """Draw and solve the cases ``numbers`` under ``seed``, in order; cases that the expert does not solve are left out.

    Args:
        numbers: of the cases.
        seed: of the series of cases.
        workers: solver threads.
        expert_w: the expert's suboptimality bound.
        expert_time: time limit of each search, seconds; without one, `EXPERT_NODE_LIMIT` ends it.
        size: width, height, robots, density, as `draw_case` takes them.
    """
    cases = (draw_case(seed, number, **size) for number in numbers)  # type: ignore[arg-type]
    return solve_cases(cases, numbers, workers, expert_w, expert_time)


def solve_cases(
    cases: Iterable[Case],
    numbers: Sequence[int],
    workers: int = 2,
    expert_w: float = EXPERT_W,
    expert_time: float = math.inf,
) -> Iterator[SolvedCase]:
    """Solve ``cases`` with the given ``numbers``, as `solved_cases` does."""
    taken: list[Case] = []

    def take() -> Iterator[Case]:
        for case in cases:
            taken.append(case)
            yield case

    node_limit = EXPERT_NODE_LIMIT if math.isinf(expert_time) else None
    solutions = solve_many(take(), workers=workers, w=expert_w, time_limit=expert_time, node_limit=node_limit)
    for index, (number, solution) in enumerate(zip(numbers, solutions, strict=True)):
        if solution.status is SolveStatus.SOLVED and solution.paths is not None:
            yield SolvedCase(number, taken[index], solution.paths)
