# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Episodes of a policy or of another planner on a set of cases, in the batched simulator."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from magat_evaluation.cases import SolvedCase
from magat_evaluation.splits import SET_SEED
from magat_robot.policy.computed import ComputedPolicy
from magat_robot.policy.sampling import uniform
from magat_robot.policy.visit_memory import VisitMemory
from magat_sim.grid import DELTAS
from magat_sim.measures import EpisodeMeasures
from magat_sim.rollout import Decide, run
from magat_sim.simulator import DEFAULT_RULES, Actions, Observation, Rules, Simulator
from magat_sim.streams import episode_streams

#: Given solved cases and a simulator with a world for each, makes the function that decides for all robots.
Planner = Callable[[Sequence[SolvedCase], Simulator], Decide]


def simulator_for(
    solved: Sequence[SolvedCase],
    seed: int = SET_SEED,
    rules: Rules = DEFAULT_RULES,
    secret: bytes | None = None,
) -> Simulator:
    """A simulator with a world for each case; ``seed`` and the number of a case select its random streams.

    With the ``secret`` of an episode of a team, the streams are those of that episode, see `episode_streams`.
    """
    return Simulator(
        [s.case for s in solved],
        [s.t_max for s in solved],
        [episode_streams(seed, s.number, s.case.robots, secret) for s in solved],
        rules,
    )


def evaluate(
    policy: ComputedPolicy,
    solved: Sequence[SolvedCase],
    seed: int = SET_SEED,
    on_step: Callable[[Simulator], None] | None = None,
    rules: Rules = DEFAULT_RULES,
    secret: bytes | None = None,
) -> list[EpisodeMeasures]:
    """Run one episode on each case in lockstep, every robot by ``policy``; see `evaluate_planner`."""
    return evaluate_planner(policy_planner(policy), solved, seed, on_step, rules, secret)


def evaluate_planner(
    planner: Planner,
    solved: Sequence[SolvedCase],
    seed: int = SET_SEED,
    on_step: Callable[[Simulator], None] | None = None,
    rules: Rules = DEFAULT_RULES,
    secret: bytes | None = None,
) -> list[EpisodeMeasures]:
    """Run one episode on each case in lockstep.

    Args:
        planner: decides for all robots.
        solved: the cases, with the expert's solutions.
        seed: of the episodes' random streams.
        on_step: called after each step, e.g. to show progress.
        rules: of the worlds.
        secret: see `simulator_for`.

    Returns:
        The measures of each case, in order.
    """
    simulator = simulator_for(solved, seed, rules, secret)
    run(simulator, planner(solved, simulator), on_step)
    return simulator.measures([s.flowtime for s in solved])


def policy_planner(policy: ComputedPolicy) -> Planner:
    """The planner by which every robot runs ``policy``; it can be pickled if the policy can."""
    return partial(_plan_by_policy, policy)


def run_policy(
    policy: ComputedPolicy, simulator: Simulator, on_step: Callable[[Simulator], None] | None = None
) -> None:
    """Step ``simulator`` to its end, every robot by ``policy``; ``on_step`` is called after each step."""
    run(simulator, _decide_by(policy, simulator), on_step)


def _plan_by_policy(policy: ComputedPolicy, _: Sequence[SolvedCase], simulator: Simulator) -> Decide:
    return _decide_by(policy, simulator)


def _decide_by(policy: ComputedPolicy, simulator: Simulator) -> Decide:
    """The decisions of all robots in ``simulator``, which is at its start."""
    memory = VisitMemory(len(simulator.world)) if policy.config.visit_memory else None

    def decide(seen: Observation) -> Actions:
        visits = None
        if memory is not None:
            visits = memory.observe(simulator.active, 0, seen.tick, seen.moved, seen.field_of_view)
        decision = policy.decide_together(seen.field_of_view, seen.heard, seen.streams, seen.tick, visits)
        return Actions(decision.primitives, decision.log_probabilities)

    return decide


def prefer_near(distances: npt.NDArray[np.floating], observation: Observation) -> Actions:
    """Prefer the primitives that lead nearest to the goal; break ties by the robots' own random streams.

    Args:
        distances: ``[R, 5]`` steps to the goal from where each primitive leads.
        observation: of the R robots.
    """
    preference = -distances.astype(np.float64)
    for primitive in range(len(DELTAS)):
        draws = uniform(observation.streams, observation.tick * len(DELTAS) + primitive)
        preference[:, primitive] -= 0.5 * draws  # less than the difference between two distances
    return Actions(preference.argmax(axis=1), preference)
