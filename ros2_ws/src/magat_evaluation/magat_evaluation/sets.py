# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sets of cases that policies are evaluated on. Quick to import."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from magat_evaluation.splits import EXPERT_W, FIRST_RESULT, SET_SEED, SPLITS
from magat_node.errors import MagatError


def set_name(width: int, height: int, robots: int) -> str:
    """The name of a set of cases in tables: cells and robots, e.g. 20x20 (10)."""
    return f"{width}x{height} ({robots})"


@dataclass(frozen=True)
class CaseSet:
    """Consecutive cases of a split, drawn on maps of one size.

    Raises:
        MagatError: the split has fewer cases.
    """

    #: Of the maps, cells.
    width: int
    height: int
    robots: int
    #: How many cases.
    cases: int
    #: Share of obstacle cells.
    density: float = 0.1
    #: The expert's suboptimality bound.
    expert_w: float = EXPERT_W
    #: One of `SPLITS`.
    split: str = "test"
    #: Of the cases, and of the random streams of an evaluation.
    seed: int = SET_SEED
    #: How many cases at the beginning of the split are left out.
    skip: int = 0

    def __post_init__(self) -> None:
        """Check the number of cases."""
        most = len(SPLITS[self.split]) - self.skip
        if self.cases > most:
            raise MagatError(f"the split {self.split} has {most} cases, not {self.cases}: ask for fewer")

    @classmethod
    def square(cls, side: int, robots: int, cases: int, **more: Any) -> "CaseSet":
        """A set on square maps."""
        return cls(side, side, robots, cases, **more)

    @classmethod
    def result(cls, side: int, robots: int, cases: int, **more: Any) -> "CaseSet":
        """A set on square maps for results: test cases from `FIRST_RESULT` on."""
        return cls.square(side, robots, cases, skip=FIRST_RESULT - SPLITS["test"].start, **more)

    @property
    def numbers(self) -> range:
        """Numbers of the cases."""
        return SPLITS[self.split][self.skip : self.skip + self.cases]

    @property
    def name(self) -> str:
        """Cells and robots, e.g. 20x20 (10)."""
        return set_name(self.width, self.height, self.robots)

    @property
    def size(self) -> dict[str, Any]:
        """Width, height, robots, density and the expert's bound, as `solved_cases` takes them."""
        return {name: getattr(self, name) for name in ("width", "height", "robots", "density", "expert_w")}


#: The paper's test sets, by name, with fewer cases than the paper's 1,000 a map.
TEST_SETS: Mapping[str, Sequence[CaseSet]] = {
    "same-density": [
        CaseSet.result(side, robots, 200)
        for side, robots in ((20, 10), (28, 20), (35, 30), (40, 40), (45, 50), (50, 60), (65, 100))
    ],
    "increasing-density": [CaseSet.result(50, robots, 200) for robots in (10, 20, 30, 40, 50, 60, 100)],
    "large": [CaseSet.result(side, robots, 50, expert_w=5.0) for side, robots in ((100, 500), (200, 500), (200, 1000))],
}
#: On these maps the paper's 1,000 cases are measured for the policies of `family.REPEATED`.
FULL_CASES = 1000
FULL_MAPS = ("20x20 (10)", "50x50 (60)", "65x65 (100)")
#: The sets of `magat measure`.
STANDARD_SETS = (CaseSet.result(20, 10, 1000), CaseSet.result(50, 60, 200), CaseSet.result(65, 100, 100))
