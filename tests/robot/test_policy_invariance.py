# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Decisions are the same to the last bit for any numbering, time, batch and order of messages."""

import itertools
from collections.abc import Callable
from dataclasses import fields

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_robot.policy.interface import Decision, LatentState
from magat_robot.policy.network import NodeState
from magat_robot.policy.policy import Policy
from magat_sim.simulator import Observation

seeds = st.integers(0, 2**32 - 1)


def bits(*arrays: np.ndarray) -> list[bytes]:
    return [array.tobytes() for array in arrays]


def known(own: LatentState) -> list[bytes]:
    """The latent states and messages of robots as bytes."""
    values = [getattr(own.state, field.name) for field in fields(NodeState)]
    return bits(own.messages, *(value.numpy() for value in values if isinstance(value, torch.Tensor)))


def decided(policy: Policy, observation: Observation, tick: int = 0) -> Decision:
    return policy.decide_together(observation.field_of_view, observation.heard, observation.streams, tick)


def exchanged(policy: Policy, observation: Observation) -> list[LatentState]:
    """The latent states of a team before the first round of messages and after each round."""
    result = [policy.perceive(observation.field_of_view)]
    for _ in range(policy.rounds):
        messages = result[-1].messages[np.maximum(observation.heard, 0)]
        result.append(policy.hear(result[-1], messages, observation.heard >= 0))
    return result


def part(own: LatentState, rows: slice | np.ndarray) -> LatentState:
    """The latent states of some robots of a team."""
    values = {field.name: getattr(own.state, field.name) for field in fields(NodeState)}
    rows_of = {name: value[rows] if isinstance(value, torch.Tensor) else value for name, value in values.items()}
    return LatentState(NodeState(**rows_of), own.messages[rows])


def reordered(observation: Observation, order: np.ndarray) -> Observation:
    """The same robots in another order: row i is the former row ``order[i]``."""
    new_number = np.append(np.argsort(order), -1)
    return Observation(
        observation.field_of_view[order],
        new_number[observation.heard[order]],
        observation.streams[order],
        observation.tick,
        observation.moved[order],
    )


@settings(max_examples=20)
@given(seed=seeds)
def test_numbering_the_robots_anew_only_renumbers_the_decisions(
    random_team: Callable, small_policy: Callable, variant: dict, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    observation = random_team(rng, int(rng.integers(1, 25)))
    policy = small_policy(**variant)
    order = rng.permutation(len(observation.streams))
    before, after = decided(policy, observation), decided(policy, reordered(observation, order))
    assert bits(after.weights, after.primitives) == bits(before.weights[order], before.primitives[order])


@settings(max_examples=10)
@given(seed=seeds, ticks=st.lists(st.integers(0, 100_000), min_size=2, max_size=2, unique=True))
def test_the_same_situation_at_another_time_weighs_the_same(
    random_team: Callable, small_policy: Callable, variant: dict, seed: int, ticks: list[int]
) -> None:
    rng = np.random.default_rng(seed)
    then, meanwhile = random_team(rng, 12), random_team(rng, 9)
    policy = small_policy(**variant)
    first = decided(policy, then, ticks[0])
    decided(policy, meanwhile, ticks[0] + 1)  # must not leave any state
    again = decided(policy, then, ticks[1])
    assert bits(first.weights) == bits(again.weights)
    assert bits(first.primitives) == bits(decided(policy, then, ticks[0]).primitives)


@settings(max_examples=20)
@given(seed=seeds, network=st.integers(0, 3))
def test_a_robot_that_computes_alone_from_messages_alone_gets_the_bits_of_the_whole_team(
    random_team: Callable, small_policy: Callable, variant: dict, seed: int, network: int
) -> None:
    rng = np.random.default_rng(seed)
    observation = random_team(rng, *rng.integers(1, 12, size=2))
    policy = small_policy(seed=network, **variant)
    team, decisions = exchanged(policy, observation), decided(policy, observation, 3)
    for robot, row in enumerate(observation.heard):
        here, heard = slice(robot, robot + 1), row[row >= 0]
        own = policy.perceive(observation.field_of_view[here])
        for before, after in itertools.pairwise(team):
            assert known(own) == known(part(before, here))
            # It hears its neighbours in another order each time, and without the empty places of the batch.
            messages = before.messages[rng.permutation(heard)][None]
            own = policy.hear(own, messages, np.ones(messages.shape[:2], bool))
            assert known(own) == known(part(after, here))
        decision = policy.decide(own, observation.streams[here], 3)
        assert bits(decision.weights, decision.primitives) == bits(decisions.weights[here], decisions.primitives[here])


def test_a_team_of_more_than_one_chunk_gets_the_bits_of_its_parts(
    random_team: Callable, small_policy: Callable, variant: dict
) -> None:
    field_of_view = random_team(np.random.default_rng(5), *[60] * 5).field_of_view
    assert len(field_of_view) == 300
    policy = small_policy(**variant)
    whole = policy.perceive(field_of_view)
    for begin, end in ((0, 7), (7, 256), (256, 260), (260, 300)):
        assert known(part(whole, slice(begin, end))) == known(policy.perceive(field_of_view[begin:end]))


@pytest.mark.parametrize("name", ["MAGAT-F-128", "GAT-B-64-P2", "GNN_baseline-F-128"])
def test_networks_of_full_size_are_exact_too(random_team: Callable, random_network: Callable, name: str) -> None:
    policy = Policy(random_network(name, channels=(32, 64, 128), hidden=128, taps=3))
    observation = random_team(np.random.default_rng(2), 20)
    team, decisions = exchanged(policy, observation), decided(policy, observation)
    for robot in (0, 7, 19):
        row, here = observation.heard[robot], slice(robot, robot + 1)
        own = policy.perceive(observation.field_of_view[here])
        for before, after in itertools.pairwise(team):
            messages = before.messages[row[row >= 0]][None, ::-1]
            own = policy.hear(own, messages, np.ones(messages.shape[:2], bool))
            assert known(own) == known(part(after, here))
        assert bits(policy.weights(own)) == bits(decisions.weights[here])


def test_the_number_of_threads_changes_nothing(
    random_team: Callable, small_policy: Callable, random_network: Callable, variant: dict
) -> None:
    observation = random_team(np.random.default_rng(6), 40, 40)
    policy = small_policy(**variant)
    one = decided(policy, observation)
    try:
        torch.set_num_threads(3)
        three = decided(policy, observation)
        anew = decided(Policy(random_network(**variant)), observation)  # converted to fixed point with three threads
    finally:
        torch.set_num_threads(1)
    assert bits(one.weights, one.primitives) == bits(three.weights, three.primitives)
    assert bits(one.weights, one.primitives) == bits(anew.weights, anew.primitives)


@settings(max_examples=20)
@given(seed=seeds)
def test_neither_the_order_of_messages_nor_empty_places_matter_in_any_round(
    random_team: Callable, small_policy: Callable, variant: dict, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    policy = small_policy(**variant)
    observation = random_team(rng, 20)
    for own in exchanged(policy, observation)[:-1]:
        robot = part(own, rng.integers(20, size=1))
        heard = own.messages[rng.integers(20, size=8)]  # sometimes two equal messages
        plain = policy.hear(robot, heard[None], np.ones((1, 8), bool))
        places = rng.permutation(13)[:8]
        scattered = np.full((1, 13, heard.shape[1]), np.nan, np.float32)  # empty places are not read
        scattered[0, places] = heard
        present = np.zeros((1, 13), bool)
        present[0, places] = True
        assert known(policy.hear(robot, scattered, present)) == known(plain)


def test_a_robot_that_hears_nobody_still_decides(random_team: Callable, small_policy: Callable, variant: dict) -> None:
    policy = small_policy(**variant)
    seen = policy.perceive(random_team(np.random.default_rng(1), 6).field_of_view)

    def weights(places: int, present: bool) -> np.ndarray:
        own = seen
        for size in policy.config.message_sizes:
            # All hear all, or all places are empty and hold NaN.
            messages = own.messages[None].repeat(6, axis=0) if present else np.full((6, places, size), np.nan)
            own = policy.hear(own, messages.astype(np.float32), np.full((6, places), present))
        return policy.weights(own)

    nobody = weights(0, present=False)
    assert nobody.shape == (6, 5)
    assert (nobody.max(axis=1) == 2**24).all()
    assert bits(weights(3, present=False)) == bits(nobody)
    # Messages change the result, unless the policy sends none.
    differs = (weights(6, present=True) != nobody).any(axis=1)
    assert differs.all() if policy.config.taps > 1 else not differs.any()


def test_what_a_robot_sees_reaches_as_far_as_there_are_hops_and_no_further(
    random_team: Callable, small_policy: Callable, variant: dict
) -> None:
    policy = small_policy(**variant)
    # Teams in which each robot hears its predecessor and its successor.
    teams, robots = 40, 8
    field_of_view = random_team(np.random.default_rng(4), *[20] * 16).field_of_view[: teams * robots]
    numbers = np.arange(teams * robots)
    heard = np.stack([numbers - 1, numbers + 1], axis=1)
    heard[::robots, 0] = heard[robots - 1 :: robots, 1] = -1
    streams = np.zeros(teams * robots, np.uint64)
    before = policy.decide_together(field_of_view, heard, streams, 0).weights
    field_of_view = field_of_view.copy()
    field_of_view[::robots] = 1 - field_of_view[::robots]  # the first robot of each team sees something else
    after = policy.decide_together(field_of_view, heard, streams, 0).weights
    changed = (after != before).any(axis=1).reshape(teams, robots).any(axis=0)
    hops = policy.config.layers * (policy.config.taps - 1)
    assert changed.tolist() == [distance <= hops for distance in range(robots)]


def test_nothing_reaches_a_robot_but_its_own_view_and_what_it_hears(
    random_team: Callable, small_policy: Callable
) -> None:
    policy = small_policy("MAGAT-F-16")
    observation = random_team(np.random.default_rng(4), 10, side=20)
    before = decided(policy, observation).weights
    changed = observation.field_of_view.copy()
    changed[3] = 1 - changed[3]
    after = policy.decide_together(changed, observation.heard, observation.streams, 0).weights
    reached = (observation.heard == 3).any(axis=1)
    reached[3] = True
    assert 1 < reached.sum() < 10
    assert bits(after[~reached]) == bits(before[~reached])
    assert (after[reached] != before[reached]).any(axis=1).all()


def test_each_robot_draws_from_its_own_stream_and_anew_in_each_tick(
    random_team: Callable, small_policy: Callable
) -> None:
    policy = small_policy("MAGAT-F-16")
    observation = random_team(np.random.default_rng(7), 1)
    field_of_view = np.repeat(observation.field_of_view, 400, axis=0)
    nobody = np.zeros((400, 0), np.int64)
    shared = policy.decide_together(field_of_view, nobody, np.full(400, 9, np.uint64), 0)
    assert len(set(shared.primitives.tolist())) == 1
    own = policy.decide_together(field_of_view, nobody, np.arange(400, dtype=np.uint64), 0)
    later = policy.decide_together(field_of_view, nobody, np.arange(400, dtype=np.uint64), 1)
    share = own.weights[0] / own.weights[0].sum()
    for decision in (own, later):
        counts = np.bincount(decision.primitives, minlength=5)
        assert np.abs(counts - 400 * share).max() < 4 * np.sqrt(400 * 0.25)
    assert own.primitives.tolist() != later.primitives.tolist()
