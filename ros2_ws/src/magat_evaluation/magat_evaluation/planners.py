"""Scoring a policy, or what plans in its place, on a set of cases, in the batched simulator."""

from collections.abc import Callable, Sequence
from functools import partial

from magat_evaluation.cases import SolvedCase
from magat_evaluation.splits import SET_SEED
from magat_robot.policy.policy import Policy
from magat_sim.measures import EpisodeMeasures
from magat_sim.rollout import Decide, run
from magat_sim.simulator import DEFAULT_RULES, Actions, Observation, Rules, Simulator
from magat_sim.streams import episode_streams

#: How the robots of a simulator, which has a world for each of the cases, decide.
Planner = Callable[[Sequence[SolvedCase], Simulator], Decide]


def simulator_for(
    solved: Sequence[SolvedCase],
    seed: int = SET_SEED,
    rules: Rules = DEFAULT_RULES,
) -> Simulator:
    """A simulator with a world for each case; ``seed`` and each case's number name the random streams."""
    return Simulator(
        [s.case for s in solved],
        [s.t_max for s in solved],
        [episode_streams(seed, s.number, s.case.robots) for s in solved],
        rules,
    )


def evaluate(
    policy: Policy,
    solved: Sequence[SolvedCase],
    seed: int = SET_SEED,
    on_step: Callable[[Simulator], None] | None = None,
    rules: Rules = DEFAULT_RULES,
) -> list[EpisodeMeasures]:
    """One episode on each case, all in lockstep, every robot carrying ``policy``; see `evaluate_planner`."""
    return evaluate_planner(partial(carried, policy), solved, seed, on_step, rules)


def evaluate_planner(
    planner: Planner,
    solved: Sequence[SolvedCase],
    seed: int = SET_SEED,
    on_step: Callable[[Simulator], None] | None = None,
    rules: Rules = DEFAULT_RULES,
) -> list[EpisodeMeasures]:
    """One episode on each case, all in lockstep.

    Args:
        planner: how the robots decide.
        solved: the cases, with the expert's solutions.
        seed: of the episodes' random streams.
        on_step: called after each step, e.g. to show progress.
        rules: of the worlds.

    Returns:
        The measures of each case, in order.
    """
    simulator = simulator_for(solved, seed, rules)
    run(simulator, planner(solved, simulator), on_step)
    return simulator.measures([s.flowtime for s in solved])


def carried(policy: Policy, _: Sequence[SolvedCase], __: Simulator) -> Decide:
    """Once ``policy`` is given, the `Planner` by which every robot carries it."""
    return partial(_decide, policy)


def run_policy(policy: Policy, simulator: Simulator, on_step: Callable[[Simulator], None] | None = None) -> None:
    """Step ``simulator`` to its end, every robot carrying ``policy``; ``on_step`` is called after each step."""
    run(simulator, partial(_decide, policy), on_step)


def _decide(policy: Policy, observation: Observation) -> Actions:
    decision = policy.decide_together(
        observation.field_of_view, observation.heard, observation.streams, observation.tick
    )
    return Actions(decision.primitives, decision.log_probabilities)
