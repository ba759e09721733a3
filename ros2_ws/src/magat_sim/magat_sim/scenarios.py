# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cases from MovingAI's files, for evaluations and teams."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from magat_sim.case import Case, InvalidCaseError
from magat_sim.movingai import read_case


@dataclass(frozen=True)
class Scenarios:
    """Cases on one map, one from each ``.scen`` file."""

    map: Path
    files: tuple[Path, ...]
    cases: tuple[Case, ...]

    @classmethod
    def read(cls, map_path: Path | None, files: Sequence[Path] | None, robots: int) -> "Scenarios":
        """The cases of the first ``robots`` lines of each file.

        Raises:
            InvalidCaseError: a map or file is missing, cannot be read or is malformed, or a case is invalid; the
                message says which and why.
        """
        if map_path is None or not files:
            raise InvalidCaseError("--map and --scen belong together: give a .map file and one or more .scen files")
        try:
            cases = tuple(read_case(map_path, file, robots) for file in files)
        except OSError as error:
            raise InvalidCaseError(f"{error.filename} cannot be read: {error.strerror}") from error
        return cls(map_path, tuple(files), cases)

    @property
    def size(self) -> dict[str, float]:
        """Width, height, number of robots and share of obstacle cells, with the keys of reports."""
        height, width = self.cases[0].obstacles.shape
        density = float(self.cases[0].obstacles.mean())
        return {"width": width, "height": height, "robots": self.cases[0].robots, "density": density}
