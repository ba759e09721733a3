"""Sets of cases with a name: what policies are tested on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from magat_evaluation.splits import EXPERT_W


@dataclass(frozen=True)
class StandardSet:
    """The first cases of the test split (its numbers and the default seed), on square maps of one size."""

    side: int
    robots: int
    cases: int
    density: float = 0.1
    #: The expert's suboptimality bound.
    expert_w: float = EXPERT_W

    @property
    def size(self) -> dict[str, Any]:
        """Width, height, robots, density and the expert's bound, as `evaluation.evaluate_policy` takes them."""
        square = {"width": self.side, "height": self.side}
        return square | {"robots": self.robots, "density": self.density, "expert_w": self.expert_w}


#: The paper's test sets, by name.
TEST_SETS: Mapping[str, Sequence[StandardSet]] = {
    "same-density": [
        StandardSet(side, robots, 1000)
        for side, robots in ((20, 10), (28, 20), (35, 30), (40, 40), (45, 50), (50, 60), (65, 100))
    ],
    "increasing-density": [StandardSet(50, robots, 1000) for robots in (10, 20, 30, 40, 50, 60, 100)],
    "large": [StandardSet(side, robots, 50, expert_w=5.0) for side, robots in ((100, 500), (200, 500), (200, 1000))],
}
#: What a policy's own measures are of.
STANDARD_SETS = (StandardSet(20, 10, 1000), StandardSet(50, 60, 200), StandardSet(65, 100, 100))
