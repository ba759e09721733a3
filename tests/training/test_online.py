# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The online expert: it says what to do next where the policy itself led, and only there."""

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pytest

from magat_evaluation.cases import SolvedCase
from magat_evaluation.executor import executor
from magat_evaluation.planners import evaluate, simulator_for
from magat_evaluation.splits import EXPERT_W
from magat_expert import SolveStatus, check_paths, solve
from magat_robot.policy.config import PolicyConfig
from magat_robot.policy.interface import Decision
from magat_sim.case import Case
from magat_sim.grid import DELTAS, Primitive
from magat_sim.rollout import run_recorded
from magat_training import online
from magat_training.online import (
    CORRECTIONS,
    NODE_LIMIT,
    Correction,
    correct_failures,
    correct_in_pieces,
    correct_states,
)
from magat_training.samples import Instants

IDLE, UP, _, _, RIGHT = Primitive

BOTH = pytest.mark.parametrize("correct", [correct_failures, correct_states])
#: Places in the list of cases, not their numbers.
CHOSEN = [5, 0, 3, 2]


class Follower:
    """Carried by robots that walk along the expert's paths; which robot it is, its stream tells. Others never move."""

    config = PolicyConfig()

    def __init__(self, solved: Sequence[SolvedCase], seed: int) -> None:
        self._way = {
            int(stream): s.paths[:, robot]
            for s in solved
            for robot, stream in enumerate(simulator_for([s], seed).observe().streams)
        }

    def decide_together(self, view: object, heard: object, streams: np.ndarray, tick: int, *_: object) -> Decision:
        actions = [self._wanted(int(stream), tick) for stream in streams]
        return Decision(np.ones((len(streams), 5)), np.array(actions))

    def _wanted(self, stream: int, tick: int) -> int:
        if stream not in self._way:
            return IDLE
        return DELTAS.tolist().index((self._way[stream][tick + 1] - self._way[stream][tick]).tolist())


class Scripted:
    """PolicySlot by two robots: one walks away from its goal, the other reaches its own, and both stay."""

    config = PolicyConfig()

    def decide_together(self, view: object, heard: object, streams: object, tick: int, *_: object) -> Decision:
        return Decision(np.ones((2, 5)), np.array([UP, RIGHT] if tick == 0 else [IDLE, IDLE]))


def walk(policy: object, solved: SolvedCase, seed: int) -> np.ndarray:
    """``[ticks + 1, N, 2]``, the way of a team that is alone in its simulator."""
    return run_recorded(
        simulator_for([solved], seed),
        lambda seen: policy.decide_together(seen.field_of_view, seen.heard, seen.streams, seen.tick).primitives,
    )


def solution(solved: SolvedCase, start: np.ndarray) -> np.ndarray | None:
    """The expert's paths from ``start`` on."""
    found = solve(solved.case.obstacles, start, solved.case.goals, EXPERT_W, math.inf, NODE_LIMIT)
    return found.paths if found.status is SolveStatus.SOLVED else None


def rows(instants: Instants | None) -> Iterator[tuple[int, list, list]]:
    assert instants is not None
    return zip(instants.case.tolist(), instants.now.tolist(), instants.next.tolist(), strict=True)


@pytest.fixture(scope="module")
def episodes(solved: list[SolvedCase], small_policy: Callable) -> dict[int, np.ndarray]:
    """The ways of a policy that knows nothing, each stepped alone."""
    return {i: walk(small_policy(), solved[i], seed=3) for i in CHOSEN}


@pytest.fixture(scope="module")
def correction(solved: list[SolvedCase], small_policy: Callable) -> Correction:
    """What the expert has to say about every state of those episodes."""
    return correct_states(small_policy(), solved, CHOSEN, seed=3)


def test_every_state_that_an_episode_comes_through_is_corrected_once(
    correction: Correction, episodes: dict[int, np.ndarray]
) -> None:
    # Each world ends at a time of its own. Where it has come to then, there is nothing left to decide.
    assert len({len(way) for way in episodes.values()}) > 1
    expected = [(i, state) for i, way in episodes.items() for state in way[:-1].tolist()]
    assert sorted((case, now) for case, now, _ in rows(correction.instants)) == sorted(expected)


def test_a_label_is_the_first_step_of_a_solution_from_that_very_state(
    solved: list[SolvedCase], correction: Correction
) -> None:
    moved = 0
    for case, now, after in rows(correction.instants):
        paths = solution(solved[case], np.array(now))
        assert paths is not None
        assert paths[1].tolist() == after
        # And a step that robots can make: what is left of the way is valid if it begins with it.
        s = solved[case].case
        assert check_paths(s.obstacles, np.array(now), s.goals, np.concatenate([[now], [after], paths[2:]])) == []
        moved += now != after
    assert moved > len(correction.instants or []) / 2


def test_states_of_finished_worlds_are_not_there(solved: list[SolvedCase]) -> None:
    # Some arrive long before others, and one has not far to go.
    at_home = SolvedCase(9, Case(solved[1].case.obstacles, *[solved[1].case.goals] * 2), solved[1].paths)
    cases = [*solved, at_home]
    follower = Follower(solved, seed=4)
    chosen = [8, *range(8)]
    correction = correct_states(follower, cases, chosen, seed=4)
    assert all(episode.success_strict for episode in correction.episodes)
    assert len({episode.ticks for episode in correction.episodes}) > 3
    expected = [(i, state) for i in range(8) for state in solved[i].paths[:-1].tolist()]
    assert sorted((case, now) for case, now, _ in rows(correction.instants)) == sorted(expected)
    assert correct_states(follower, cases, [8], seed=4).instants is None


def test_failed_episodes_are_solved_from_their_last_states_to_the_goals(
    solved: list[SolvedCase], small_policy: Callable, episodes: dict[int, np.ndarray]
) -> None:
    correction = correct_failures(small_policy(), solved, CHOSEN, seed=3)
    failed = [i for i, episode in zip(CHOSEN, correction.episodes, strict=True) if not episode.success]
    assert failed
    paths = []
    for i in failed:
        assert episodes[i][-1].tolist() != solved[i].case.starts.tolist()
        path = solution(solved[i], episodes[i][-1])
        assert path is not None
        assert path[-1].tolist() == solved[i].case.goals.tolist()
        paths.append(path)
    assert list(rows(correction.instants)) == list(rows(Instants.of_paths(paths, failed)))


def test_successes_teach_nothing_where_only_failures_are_corrected(solved: list[SolvedCase]) -> None:
    # Half of the cases are walked to the end, in the other half nobody moves.
    correction = correct_failures(Follower(solved[::2], seed=4), solved, range(8), seed=4)
    assert [episode.success for episode in correction.episodes] == [True, False] * 4
    failed = [1, 3, 5, 7]
    expected = Instants.of_paths([solution(solved[i], solved[i].case.starts) for i in failed], failed)
    assert list(rows(correction.instants)) == list(rows(expected))
    assert correct_failures(Follower(solved, seed=4), solved, range(8), seed=4).instants is None


def test_goals_that_were_visited_and_left_again_are_no_failure() -> None:
    case = Case(np.zeros((2, 4), dtype=bool), np.array([[0, 0], [2, 0]]), np.array([[0, 0], [3, 0]]))
    origin = SolvedCase(0, case, np.array([case.starts, case.goals]))
    (episode,) = evaluate(Scripted(), [origin])
    assert episode.success
    assert not episode.success_strict
    assert correct_failures(Scripted(), [origin], [0], seed=3).instants is None
    # Its states are states as any: at the start, and twice beside the goal.
    states = correct_states(Scripted(), [origin], [0], seed=3).instants
    assert [now for _, now, _ in rows(states)] == [[[0, 0], [2, 0]], [[0, 1], [3, 0]], [[0, 1], [3, 0]]]
    assert [after for _, _, after in rows(states)] == [[[0, 0], [3, 0]]] * 3


@BOTH
def test_what_the_expert_gives_up_on_is_left_out(correct: Callable) -> None:
    corridor = np.zeros((1, 6), dtype=bool)
    ends, apart, together = np.array([[[0, 0], [5, 0]], [[1, 0], [4, 0]], [[2, 0], [3, 0]]])
    # How long an episode lasts, and what it is measured by, comes from paths; here they need not be true.
    passing = SolvedCase(1, Case(corridor, ends, ends[::-1]), np.array([ends, ends[::-1]]))
    closing = SolvedCase(2, Case(corridor, apart, together), np.array([apart, together]))
    assert solution(passing, ends) is None
    correction = correct(Follower([], seed=0), [passing, closing, passing], [0, 1, 2], seed=0)
    assert [episode.success for episode in correction.episodes] == [False] * 3
    corrected = list(rows(correction.instants))
    assert corrected[0] == (1, [[1, 0], [4, 0]], [[2, 0], [3, 0]])
    assert {case for case, _, _ in corrected} == {1}
    nothing = correct(Follower([], seed=0), [passing, closing], [0, 0], seed=0)
    assert nothing.instants is None
    assert len(nothing.episodes) == 2


@BOTH
def test_a_correction_comes_with_the_measures_of_its_episodes(
    solved: list[SolvedCase], small_policy: Callable, correct: Callable
) -> None:
    correction = correct(small_policy(), solved, CHOSEN, seed=3)
    assert correction.episodes == evaluate(small_policy(), [solved[i] for i in CHOSEN], seed=3)


@BOTH
def test_a_correction_is_repeatable_and_follows_the_seed(
    solved: list[SolvedCase], small_policy: Callable, correct: Callable
) -> None:
    first, again, other = (
        list(rows(correct(small_policy(), solved, CHOSEN[:2], seed=seed).instants)) for seed in (3, 3, 4)
    )
    assert first == again != other


@BOTH
def test_corrections_are_kept_as_compactly_as_the_experts_own_paths(
    solved: list[SolvedCase], small_policy: Callable, correct: Callable
) -> None:
    instants = correct(small_policy(), solved, CHOSEN[:1], seed=3).instants
    assert {name: array.dtype for name, array in vars(instants).items()} == {
        "case": np.int32,
        "now": np.int16,
        "next": np.int16,
    }


@BOTH
def test_a_correction_in_pieces_is_that_of_the_whole(
    solved: list[SolvedCase], small_policy: Callable, correct: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(online, "PIECE", 3)
    whole = correct(small_policy(), solved, CHOSEN, 3)
    with executor(1) as pool:
        pieces = correct_in_pieces(pool, correct, small_policy(), solved, CHOSEN, 3)
    assert pieces.episodes == whole.episodes
    for name, array in vars(whole.instants).items():
        assert getattr(pieces.instants, name).dtype == array.dtype
        assert np.array_equal(getattr(pieces.instants, name), array)


def test_the_ways_to_ask_have_names() -> None:
    assert {"failures": correct_failures, "states": correct_states} == CORRECTIONS
