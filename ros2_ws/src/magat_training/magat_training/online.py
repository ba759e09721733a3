# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The online expert: labels states that the policy itself visits (MAGAT paper, Sec. V-D; DAgger, Ross et al. 2011)."""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from magat_evaluation.cases import SolvedCase
from magat_evaluation.planners import run_policy, simulator_for
from magat_evaluation.splits import EXPERT_W
from magat_expert import SolveStatus, solve_many
from magat_robot.policy.policy import Policy
from magat_sim.case import Case
from magat_sim.grid import IntArray
from magat_sim.measures import EpisodeMeasures
from magat_training.samples import Instants

#: Limit of a search, in high-level expansions. It is lower than that of the cases: an untrained policy reaches states
#: that take the expert a minute, and there are enough others to learn from.
NODE_LIMIT = 1_000
#: Cases in a piece of work for an executor.
PIECE = 25


@dataclass(frozen=True)
class Correction:
    """The expert's labels for one round of episodes."""

    #: None if there is nothing to correct, or the expert solves none of it.
    instants: Instants | None
    #: The policy's own measures in these episodes.
    episodes: list[EpisodeMeasures]


def correct_failures(policy: Policy, solved: Sequence[SolvedCase], chosen: Sequence[int], seed: int) -> Correction:
    """The paper's online expert: each failed episode is solved from its last state.

    Args:
        policy: runs one episode on each chosen case.
        solved: the cases.
        chosen: indices into ``solved``; the instants have the same indices.
        seed: of the episodes' random streams.
    """
    simulator = simulator_for([solved[i] for i in chosen], seed)
    run_policy(policy, simulator)
    episodes = simulator.measures([solved[i].flowtime for i in chosen])
    failed = [place for place, episode in enumerate(episodes) if not episode.success]
    cases = [chosen[place] for place in failed]
    paths = _paths(solved, cases, [simulator.position[simulator.world == place] for place in failed])
    kept = [(path, case) for path, case in zip(paths, cases, strict=True) if path is not None]
    instants = Instants.of_paths(*zip(*kept, strict=True)) if kept else None
    return Correction(instants, episodes)


def correct_states(policy: Policy, solved: Sequence[SolvedCase], chosen: Sequence[int], seed: int) -> Correction:
    """Label every state that the policy visits with the expert's next step from there.

    A solution from the middle of an episode takes a fraction of a millisecond, so every state can be labelled.
    Arguments as for `correct_failures`.
    """
    simulator = simulator_for([solved[i] for i in chosen], seed)
    positions, places = [], []

    def note() -> None:
        running = np.unique(simulator.world[simulator.active])
        places.append(running)
        positions.append(simulator.position.reshape(len(chosen), -1, 2)[running])

    note()
    run_policy(policy, simulator, lambda _: note())
    # Case by case, so that the order does not depend on which cases are run together.
    order = np.argsort(np.concatenate(places), kind="stable")
    now = np.concatenate(positions)[order]
    cases = [chosen[place] for place in np.concatenate(places)[order]]
    paths = _paths(solved, cases, list(now))
    kept = np.flatnonzero([path is not None for path in paths])
    after = [path[min(1, len(path) - 1)] for path in paths if path is not None]
    instants = None
    if len(kept):
        instants = Instants(
            np.asarray(cases, dtype=np.int32)[kept], now[kept].astype(np.int16), np.stack(after).astype(np.int16)
        )
    return Correction(instants, simulator.measures([solved[i].flowtime for i in chosen]))


#: A function such as `correct_failures`.
Correct = Callable[[Policy, Sequence[SolvedCase], Sequence[int], int], Correction]
#: Ways to ask the expert while training, by name.
CORRECTIONS: dict[str, Correct] = {
    "failures": correct_failures,
    "states": correct_states,
}


def correct_in_pieces(
    executor: Executor,
    correct: Correct,
    policy: Policy,
    solved: Sequence[SolvedCase],
    chosen: Sequence[int],
    seed: int,
) -> Correction:
    """What ``correct`` returns for the arguments after it, computed by ``executor`` in pieces of `PIECE` cases."""
    pieces = [chosen[start : start + PIECE] for start in range(0, len(chosen), PIECE)]
    work = partial(_correct_piece, correct, policy, seed)
    found = list(executor.map(work, pieces, [[solved[i] for i in piece] for piece in pieces]))
    instants = [one.instants for one in found if one.instants is not None]
    return Correction(
        Instants.join(instants) if instants else None, [episode for one in found for episode in one.episodes]
    )


def _correct_piece(
    correct: Correct, policy: Policy, seed: int, piece: Sequence[int], solved: Sequence[SolvedCase]
) -> Correction:
    found = correct(policy, solved, range(len(solved)), seed)
    if found.instants is None:
        return found
    numbers = np.asarray(piece, dtype=np.int32)[found.instants.case]
    return replace(found, instants=replace(found.instants, case=numbers))


def _paths(solved: Sequence[SolvedCase], cases: Sequence[int], starts: Sequence[IntArray]) -> list[IntArray | None]:
    """The expert's paths on ``cases`` from ``starts`` (each ``[N, 2]``); None where it reaches its limit."""
    states = (
        Case(solved[case].case.obstacles, start, solved[case].case.goals)
        for case, start in zip(cases, starts, strict=True)
    )
    solutions = solve_many(states, w=EXPERT_W, time_limit=math.inf, node_limit=NODE_LIMIT)
    return [solution.paths if solution.status is SolveStatus.SOLVED else None for solution in solutions]
