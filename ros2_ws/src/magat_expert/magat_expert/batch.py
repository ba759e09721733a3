# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Many instances at once, on several cores."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Protocol

import numpy.typing as npt

from magat_expert.instance import (
    DEFAULT_MEMORY_LIMIT,
    DEFAULT_W,
    InvalidInstanceError,
    validate_limits,
    validate_memory_limit,
)
from magat_expert.solver import Solution, StopFlag, solve


class Case(Protocol):
    """An object that holds an instance for `solve`."""

    @property
    def obstacles(self) -> npt.ArrayLike:
        """``[H, W]`` bool, indexed ``[y, x]``."""

    @property
    def starts(self) -> npt.ArrayLike:
        """``[N, 2]`` int."""

    @property
    def goals(self) -> npt.ArrayLike:
        """``[N, 2]`` int."""


def solve_many(
    cases: Iterable[Case],
    workers: int = 1,
    w: float = DEFAULT_W,
    time_limit: float = 10.0,
    node_limit: int | None = None,
    memory_limit: int = DEFAULT_MEMORY_LIMIT,
) -> Iterator[Solution]:
    """Solve cases in threads, and yield their solutions in the order of the cases.

    The number of workers changes only the `seconds` of a solution, as long as no search reaches its time limit;
    `node_limit` and `memory_limit` end searches at the same point on every machine. Cases are taken from the iterable
    as they are needed, so it may be a generator of any length. Leaving the loop early ends all searches.

    Args:
        cases: the instances.
        workers: threads, at least 1. The search releases the GIL, so one per core is best.
        w: as in `solve`.
        time_limit: as in `solve`, seconds for each case.
        node_limit: as in `solve`, for each case.
        memory_limit: as in `solve`, MiB for each case.

    Raises:
        InvalidInstanceError: a case is invalid (the message begins with its number), or a parameter is.
        ValueError: workers is below 1.
    """
    if workers < 1:
        raise ValueError(f"workers is {workers}: give at least 1")
    validate_limits(w, time_limit, node_limit)
    validate_memory_limit(memory_limit)
    stop = StopFlag()
    search = partial(solve, w=w, time_limit=time_limit, node_limit=node_limit, stop=stop, memory_limit=memory_limit)
    return _solutions(cases, workers, search, stop)


def _solutions(
    cases: Iterable[Case], workers: int, search: Callable[..., Solution], stop: StopFlag
) -> Iterator[Solution]:

    def solve_one(number: int, case: Case) -> Solution:
        try:
            return search(case.obstacles, case.starts, case.goals)
        except InvalidInstanceError as error:
            raise InvalidInstanceError(f"case {number}: {error}") from error

    pending: deque[Future[Solution]] = deque()
    with ThreadPoolExecutor(workers, thread_name_prefix="expert") as pool:
        try:
            for number, case in enumerate(cases):
                pending.append(pool.submit(solve_one, number, case))
                # A few cases are queued for each worker, so that none idles while the first case takes long.
                if len(pending) >= 8 * workers:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)
