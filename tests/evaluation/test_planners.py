# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scores are repeatable, and belong to their cases, whatever else is evaluated beside them."""

from collections.abc import Callable

from magat_evaluation.cases import SolvedCase, solved_cases
from magat_evaluation.planners import evaluate, simulator_for
from magat_sim.simulator import Rules, Simulator


def test_the_same_seed_gives_the_same_measures(solved: list[SolvedCase], small_policy: Callable) -> None:
    policy = small_policy("MAGAT-F-16")
    first = evaluate(policy, solved)
    assert evaluate(policy, solved) == first
    assert evaluate(policy, solved, seed=1) != first
    assert len({measures.flowtime for measures in first}) > 1


def test_a_case_scores_alone_as_among_others(solved: list[SolvedCase], small_policy: Callable) -> None:
    policy = small_policy("MAGAT-F-16")
    # Other sizes in the same batch.
    mixed = [*solved, *solved_cases(range(100, 104), workers=1, width=6, height=11, robots=3)]
    together = evaluate(policy, mixed)
    assert [evaluate(policy, [s])[0] for s in mixed] == together
    assert evaluate(policy, mixed[::-1]) == together[::-1]


def test_measures_come_with_the_experts_flowtime_and_its_time(solved: list[SolvedCase], small_policy: Callable) -> None:
    for s, measures in zip(solved, evaluate(small_policy("MAGAT-F-16"), solved), strict=True):
        assert measures.expert_flowtime == s.flowtime
        assert measures.t_max == s.t_max
        assert 0 < measures.ticks <= s.t_max


def test_the_streams_of_an_episode_are_those_of_its_number(solved: list[SolvedCase]) -> None:
    streams = simulator_for(solved).observe().streams
    assert len(set(streams.tolist())) == 8 * 5
    assert simulator_for(solved[3:4]).observe().streams.tolist() == streams[15:20].tolist()
    assert simulator_for(solved, seed=9).observe().streams.tolist() != streams.tolist()


def test_progress_is_told_after_each_step(solved: list[SolvedCase], small_policy: Callable) -> None:
    seen: list[Simulator] = []
    ticks: list[int] = []

    def on_step(simulator: Simulator) -> None:
        seen.append(simulator)
        ticks.append(simulator.tick)

    measures = evaluate(small_policy("MAGAT-F-16"), solved, on_step=on_step)
    assert ticks == list(range(1, max(m.ticks for m in measures) + 1))
    assert all(simulator is seen[0] for simulator in seen)


def test_a_shield_and_lost_links_are_rules_of_the_worlds(solved: list[SolvedCase], small_policy: Callable) -> None:
    policy = small_policy("MAGAT-F-16")
    measures = [evaluate(policy, solved, rules=rules) for rules in (Rules(), Rules(0.5), Rules(shield="pibt"))]
    assert measures[0] == evaluate(policy, solved)
    assert len({tuple(m.flowtime for m in one) for one in measures}) == 3
