# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Policies in POGEMA, the environment in which others compare theirs (Skrynnik et al., 2022).

Observations, messages and decisions are the same as in our simulator: `field_of_view`, `neighbours`, `ComputedPolicy`.
Only the world differs. In POGEMA a cell is ``(row, column)``, rows are counted from the top, and the map has a border
of `obs_radius` cells. Its actions have the numbers of our primitives; up is the row before.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from magat_evaluation.cases import SolvedCase
from magat_evaluation.splits import SET_SEED
from magat_robot.policy.computed import ComputedPolicy
from magat_robot.policy.visit_memory import VisitMemory
from magat_sim.case import Case
from magat_sim.field_of_view import RADIUS, Uint8Array, field_of_view, pad
from magat_sim.grid import DELTAS, BoolArray, IntArray
from magat_sim.radio import neighbours
from magat_sim.streams import episode_streams

#: POGEMA's observation of a robot under the observation type MAPF: values by name.
MapfObservation = Mapping[str, Any]


class PogemaPolicy:
    """All robots of one episode, each with its own copy of a policy: ``act`` is what POGEMA's benchmarks call."""

    def __init__(self, policy: ComputedPolicy, seed: int = SET_SEED, number: int = 0) -> None:
        """Begin the episode ``number`` under ``seed``, which select the random streams, see `episode_streams`."""
        self._policy, self._seed = policy, seed
        self.reset(number)

    def reset(self, number: int) -> None:
        """Begin another episode."""
        self._number, self._tick = number, 0
        self._memory: VisitMemory | None = None
        self._before: IntArray | None = None

    def act(self, observations: Sequence[MapfObservation]) -> list[int]:
        """The next actions of all robots.

        Args:
            observations: of N robots, of the type MAPF; the type POMAPF lacks the distances between robots, which the
                radio needs.

        Raises:
            ValueError: observations of another type.
        """
        obstacles, position, goal = world_of(observations)
        world = np.zeros(len(position), dtype=np.int64)
        robots = np.zeros(obstacles.shape, dtype=np.uint8)
        robots[position[:, 1], position[:, 0]] = 1
        view = field_of_view(pad(obstacles[None], 1), pad(robots[None], 0), world, position, goal)
        streams = episode_streams(self._seed, self._number, len(position)).robots
        visits = self._visits(position, view) if self._policy.config.visit_memory else None
        decision = self._policy.decide_together(view, neighbours(world, position), streams, self._tick, visits)
        self._tick += 1
        return [int(primitive) for primitive in decision.primitives]

    def _visits(self, position: IntArray, view: Uint8Array) -> IntArray:
        """What the robots remember, by the moves that they made since the call before."""
        if self._memory is None or self._before is None:
            self._memory, self._before = VisitMemory(len(position)), position
        step = position - self._before
        moved = (step[:, None] == DELTAS).all(axis=2).argmax(axis=1)
        self._before = position
        return self._memory.observe(np.arange(len(position)), 0, self._tick, moved, view)


def world_of(observations: Sequence[MapfObservation]) -> tuple[BoolArray, IntArray, IntArray]:
    """Obstacles (``[H, W]``, indexed ``[y, x]``, y up), positions and goals (``[N, 2]`` cells ``(x, y)``).

    Raises:
        ValueError: observations of another type than MAPF.
    """
    if not observations or not isinstance(observations[0], Mapping) or "global_xy" not in observations[0]:
        raise ValueError("the observations are of another type: create the environment with observation_type='MAPF'")
    rim = len(observations[0]["obstacles"]) // 2
    grid = np.asarray(observations[0]["global_obstacles"])[rim:-rim, rim:-rim] != 0
    ends = (np.array([one[name] for one in observations]) - rim for name in ("global_xy", "global_target_xy"))
    position, goal = (_converted(cells, len(grid)) for cells in ends)
    return grid[::-1], position, goal


def environment(case: Case, t_max: int) -> Any:
    """POGEMA's environment for ``case``, with ``soft`` collision rules; robots stay on their goals.

    The rules are those of the shield ``idle``, except that the robot that gets a cell which several want is not drawn.
    An episode ends when all robots are on their goals, or after ``t_max`` steps.

    Raises:
        ModuleNotFoundError: POGEMA is not installed, see requirements-pogema.txt.
    """
    from pogema import GridConfig, pogema_v0

    height = len(case.obstacles)
    return pogema_v0(
        GridConfig(
            map=case.obstacles[::-1].astype(int).tolist(),
            agents_xy=_converted(case.starts, height, back=True).tolist(),
            targets_xy=_converted(case.goals, height, back=True).tolist(),
            num_agents=case.robots,
            obs_radius=RADIUS,
            max_episode_steps=t_max,
            observation_type="MAPF",
            collision_system="soft",
            on_target="nothing",
        )
    )


def score(
    policy: ComputedPolicy,
    solved: Sequence[SolvedCase],
    seed: int = SET_SEED,
    on_case: Callable[[], None] | None = None,
) -> list[dict[str, float]]:
    """Run an episode on each case, with as many steps as in our simulator, and return POGEMA's metrics.

    Args:
        policy: of all robots.
        solved: the cases, with the expert's solutions, which determine the number of steps.
        seed: of the robots' random streams.
        on_case: called after each case, e.g. to show progress.

    Returns:
        For each case: ``CSR`` (1 if all robots are on their goals at the end), ``ISR`` (the share of robots on their
        goals), ``SoC``, ``makespan`` and ``ep_length``.

    Raises:
        ModuleNotFoundError: POGEMA is not installed, see requirements-pogema.txt.
    """
    team, metrics = PogemaPolicy(policy, seed), []
    for one in solved:
        team.reset(one.number)
        world = environment(one.case, one.t_max)
        observations, _ = world.reset()
        infos: list[dict[str, Any]] = [{}]
        while "metrics" not in infos[0]:
            observations, _, _, _, infos = world.step(team.act(observations))
        metrics.append(infos[0]["metrics"])
        if on_case is not None:
            on_case()
    return metrics


def _converted(cells: npt.ArrayLike, height: int, back: bool = False) -> IntArray:
    """Convert cells ``(row, column)``, rows counted from the top, to ``(x, y)``, y up; the other way with ``back``."""
    first, second = np.asarray(cells, dtype=np.int64).T
    return np.stack([height - 1 - second, first] if back else [second, height - 1 - first], axis=1)
