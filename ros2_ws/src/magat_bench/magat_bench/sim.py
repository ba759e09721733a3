# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat bench-sim``: the speed of the batched simulator with a policy, and the time of each part of a step."""

import cProfile
import pstats
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from rich.table import Table

from magat_evaluation.planners import run_policy
from magat_evaluation.splits import SET_SEED
from magat_node.progress import progress_bars
from magat_robot.policy.network import PolicyNetwork
from magat_robot.policy.policy import Policy
from magat_robot.policy.store import load
from magat_sim.case import draw_case
from magat_sim.field_of_view import field_of_view
from magat_sim.radio import neighbours
from magat_sim.shield import SHIELDS
from magat_sim.simulator import Rules, Simulator
from magat_sim.streams import episode_streams

#: The functions that compute each part of a step; `MOVE` is the rest.
PARTS: dict[str, Sequence[Callable[..., Any]]] = {
    "observation": [field_of_view],
    "radio graph": [neighbours],
    "CNN": [PolicyNetwork.perceive],
    "rest of the policy": [Policy.decide_together],
    "shield": list(SHIELDS.values()),
}
MOVE = "move"


@dataclass(frozen=True)
class SimSet:
    """Worlds that are simulated together: square maps of one size, with equal numbers of robots and steps."""

    side: int
    robots: int
    worlds: int
    steps: int

    @property
    def map_name(self) -> str:
        """Cells and robots of one of the worlds, e.g. 20x20 (10)."""
        return f"{self.side}x{self.side} ({self.robots})"

    @property
    def name(self) -> str:
        """Name of the whole set."""
        return f"{self.worlds} of {self.map_name}"

    def simulator(self, rules: Rules) -> Simulator:
        """A simulator with all worlds at their start."""
        numbers = range(self.worlds)
        return Simulator(
            [draw_case(SET_SEED, number, self.side, self.side, self.robots, 0.1) for number in numbers],
            [self.steps] * self.worlds,
            [episode_streams(SET_SEED, number, self.robots) for number in numbers],
            rules,
        )


#: About three times the expert's makespan each, as in an evaluation.
SETS = (
    SimSet(20, 10, 100, 90),
    SimSet(50, 60, 16, 240),
    SimSet(65, 100, 10, 310),
    SimSet(100, 500, 1, 160),
    SimSet(200, 500, 1, 330),
    SimSet(200, 1000, 1, 330),
)


@dataclass(frozen=True)
class SimSpeed:
    """Measures on one set."""

    which: SimSet
    seconds: float
    steps: int
    #: Steps of all robots in worlds that were not done.
    robot_steps: int
    #: Share of the time by part.
    shares: dict[str, float]


def bench_sim(folder: Path, sets: Sequence[SimSet], rules: Rules, threads: int, console: Console) -> Iterator[SimSpeed]:
    """Run each set once, every robot by the policy in ``folder``.

    Args:
        folder: of the policy.
        sets: run one after the other.
        rules: of all worlds.
        threads: for torch.
        console: shows the progress.

    Raises:
        ModelError: the policy cannot be used.
    """
    torch.set_num_threads(threads)
    policy = load(folder)
    with progress_bars(console) as progress:
        for which in sets:
            simulator = which.simulator(rules)
            task = progress.add_task(which.name, total=which.steps)
            counted = len(simulator.active)

            def note(after: Simulator, task: Any = task) -> None:
                nonlocal counted
                counted += len(after.active)
                progress.advance(task)

            profile = cProfile.Profile()
            started = time.perf_counter()
            profile.runcall(run_policy, policy, simulator, note)
            seconds = time.perf_counter() - started
            progress.remove_task(task)
            yield SimSpeed(which, seconds, simulator.tick, counted, _shares(profile))


def _shares(profile: cProfile.Profile) -> dict[str, float]:
    """Share of each part in the profiled time; a part does not include the parts within it."""
    stats = pstats.Stats(profile)

    def spent(function: Callable[..., Any]) -> float:
        code = function.__code__
        entry = stats.stats.get((code.co_filename, code.co_firstlineno, code.co_name))  # type: ignore[attr-defined]
        return 0.0 if entry is None else float(entry[3])

    seconds = {name: sum(map(spent, functions)) for name, functions in PARTS.items()}
    seconds["rest of the policy"] -= seconds["CNN"]
    seconds[MOVE] = (
        spent(Simulator.observe)
        + spent(Simulator.step)
        - sum(seconds[name] for name in ("observation", "radio graph", "shield"))
    )
    total = sum(seconds.values())
    return {name: part / total for name, part in seconds.items()}


def table(policy: str, speeds: Sequence[SimSpeed]) -> Table:
    """The speeds for the terminal."""
    result = Table(title=f"{policy} in the batched simulator", title_justify="left", box=None, pad_edge=False)
    for heading in ("worlds", "steps", "seconds", "steps/s", "robot-steps/s", *PARTS, MOVE):
        result.add_column(heading, justify="left" if heading == "worlds" else "right", overflow="fold")
    for speed in speeds:
        result.add_row(
            speed.which.name,
            str(speed.steps),
            f"{speed.seconds:.1f}",
            f"{speed.steps / speed.seconds:.1f}",
            f"{speed.robot_steps / speed.seconds:,.0f}",
            *(f"{share:.0%}" for share in speed.shares.values()),
        )
    return result
