# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What became of each case of an evaluation: what paired comparisons need."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from magat_sim.measures import EpisodeMeasures

#: delta_FT is kept in units of 1 / PARTS; what rounding adds is far below any interval.
PARTS = 1000


@dataclass(frozen=True)
class Outcomes:
    """The outcomes of the cases that were measured, in the order of their numbers.

    A set that asks for fewer cases than another one with the same first case has the beginning of its outcomes.
    """

    #: Robots that never reached their goals.
    stranded: tuple[int, ...]
    #: 1 if all robots stood on their goals at one instant, else 0.
    strict: tuple[int, ...]
    #: delta_FT by first visits, in units of 1 / `PARTS`.
    delta_ft: tuple[int, ...]
    #: delta_FT by last arrivals, in units of 1 / `PARTS`.
    delta_ft_strict: tuple[int, ...]
    #: Steps.
    makespan: tuple[int, ...]

    @classmethod
    def of(cls, episodes: Sequence[EpisodeMeasures]) -> "Outcomes":
        """The outcomes of ``episodes``."""
        return cls(
            tuple(one.stranded for one in episodes),
            tuple(int(one.success_strict) for one in episodes),
            tuple(round(PARTS * one.delta_ft) for one in episodes),
            tuple(round(PARTS * one.delta_ft_strict) for one in episodes),
            tuple(one.makespan for one in episodes),
        )

    @classmethod
    def from_row(cls, row: Mapping[str, str | None]) -> "Outcomes":
        """The outcomes that `to_row` made.

        Raises:
            ValueError: a value is missing or no number, or there are fewer values of one kind than of another.
        """
        columns = [tuple(int(value) for value in (row.get(field.name) or "").split()) for field in fields(cls)]
        if len({len(column) for column in columns}) != 1:
            raise ValueError("the outcomes are incomplete")
        return cls(*columns)

    def to_row(self) -> dict[str, str]:
        """The outcomes as cells of a CSV file: numbers with spaces between them."""
        return {field.name: " ".join(map(str, getattr(self, field.name))) for field in fields(self)}

    def values(self, measure: str, robots: int) -> npt.NDArray[np.float64]:
        """``[cases]`` a measure of each case.

        Args:
            measure: alpha, alpha_strict, delta_ft, delta_ft_strict, p_rg or makespan.
            robots: in each case.
        """
        stranded = np.array(self.stranded, dtype=np.float64)
        if measure == "alpha":
            return (stranded == 0).astype(np.float64)
        if measure == "p_rg":
            return 1.0 - stranded / robots
        kept = np.array(self.strict if measure == "alpha_strict" else getattr(self, measure), dtype=np.float64)
        return kept / PARTS if measure.startswith("delta_ft") else kept
