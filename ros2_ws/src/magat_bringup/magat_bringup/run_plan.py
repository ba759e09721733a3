# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which episodes `magat run` runs, and where it writes to."""

from array import array
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from magat_interfaces.action import RunEpisode
from magat_sim.constants import EXPERT_W
from magat_sim.scenarios import Scenarios


@dataclass(frozen=True)
class RunPlan:
    """Which episodes to run."""

    episodes: int
    width: int
    height: int
    density: float
    #: Episodes are the cases ``first``, ``first + 1``, ... under ``seed``.
    seed: int
    first: int
    #: Folder for logs, results and pictures; a new one in runs/ if None.
    output: Path | None = None
    #: Whether all log lines of the processes are shown, or warnings only.
    verbose: bool = False
    #: The interface that the team is opened to, see `magat_bringup.environment.network_for`.
    interface: str = ""
    #: ROS domain; one that no other run on this machine uses if None.
    domain: int | None = None
    #: Cases to run instead of drawn ones, one for each episode.
    scenarios: Scenarios | None = None
    #: The expert's suboptimality bound, from which T_max follows.
    expert_w: float = EXPERT_W
    #: Of all episodes, to repeat them; the simulator draws one for each if None.
    secret: bytes | None = None
    #: Where the team is recorded to, see `bag`; nowhere if None.
    record: Path | None = None

    def bag(self, folder: Path | None) -> Path | None:
        """The folder of the bag in a run with the folder ``folder``; None if the team is not recorded.

        The path ``.`` stands for ``bag`` in that folder, which is None if it is not known yet.
        """
        return folder and folder / "bag" if self.record == Path() else self.record

    def case(self, index: int) -> str:
        """What episode ``index`` is run on, for messages."""
        return f"case {self.names[index]}" if self.scenarios is None else str(self.scenarios.files[index])

    @property
    def names(self) -> list[str]:
        """Of the cases: their numbers, or their files."""
        if self.scenarios is None:
            return [str(self.first + index) for index in range(self.episodes)]
        return [file.stem for file in self.scenarios.files]

    @property
    def title(self) -> str:
        """What the episodes are run on."""
        if self.scenarios is None:
            return f"Cases {self.first} to {self.first + self.episodes - 1} of seed {self.seed}"
        return f"Cases on {self.scenarios.map.name}"

    def goal(self, index: int) -> RunEpisode.Goal:
        """The request for episode ``index``, from 0."""
        goal = RunEpisode.Goal(seed=self.seed, width=self.width, height=self.height, density=self.density)
        goal.expert_w = self.expert_w
        goal.secret = self.secret or b""
        if self.scenarios is None:
            goal.number = self.first + index
        else:
            case = self.scenarios.cases[index]
            goal.number = index
            goal.obstacles = array("B", case.obstacles.astype(np.uint8).tobytes())
            goal.start_x, goal.start_y = case.starts.T.tolist()
            goal.goal_x, goal.goal_y = case.goals.T.tolist()
        return goal
