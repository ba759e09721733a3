"""What decisions must not depend on, to the last bit: numbering, time, company, the order of messages."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_robot.policy.policy import Decision, Encoding, Policy
from magat_sim.simulator import Observation

seeds = st.integers(0, 2**32 - 1)
names = st.sampled_from(["MAGAT-F-16", "MAGAT-B-8", "MAGAT-F-8-P4", "MAGAT-B-16-P3"])


def bits(*arrays: np.ndarray) -> list[bytes]:
    return [array.tobytes() for array in arrays]


def decided(policy: Policy, observation: Observation, tick: int = 0) -> Decision:
    return policy.decide_together(observation.field_of_view, observation.heard, observation.streams, tick)


def alone(own: Encoding, robot: int) -> Encoding:
    """What one robot of a team knows after looking."""
    return Encoding(own.features[robot : robot + 1], own.messages[robot : robot + 1])


def reordered(observation: Observation, order: np.ndarray) -> Observation:
    """The same robots, numbered anew: row i is what was row ``order[i]``."""
    new_number = np.append(np.argsort(order), -1)
    return Observation(
        observation.field_of_view[order],
        new_number[observation.heard[order]],
        observation.streams[order],
        observation.tick,
    )


@settings(max_examples=40)
@given(seed=seeds, name=names)
def test_numbering_the_robots_anew_only_renumbers_the_decisions(
    random_team: Callable, small_policy: Callable, seed: int, name: str
) -> None:
    rng = np.random.default_rng(seed)
    observation = random_team(rng, int(rng.integers(1, 25)))
    policy = small_policy(name)
    order = rng.permutation(len(observation.streams))
    before, after = decided(policy, observation), decided(policy, reordered(observation, order))
    assert bits(after.weights, after.primitives) == bits(before.weights[order], before.primitives[order])


@settings(max_examples=20)
@given(seed=seeds, name=names, ticks=st.lists(st.integers(0, 100_000), min_size=2, max_size=2, unique=True))
def test_the_same_situation_at_another_time_weighs_the_same(
    random_team: Callable, small_policy: Callable, seed: int, name: str, ticks: list[int]
) -> None:
    rng = np.random.default_rng(seed)
    then, meanwhile = random_team(rng, 12), random_team(rng, 9)
    policy = small_policy(name)
    first = decided(policy, then, ticks[0])
    decided(policy, meanwhile, ticks[0] + 1)  # leaves nothing behind
    again = decided(policy, then, ticks[1])
    assert bits(first.weights) == bits(again.weights)
    assert bits(first.primitives) == bits(decided(policy, then, ticks[0]).primitives)


@settings(max_examples=40)
@given(seed=seeds, name=names, network=st.integers(0, 3))
def test_a_robot_that_computes_alone_gets_the_bits_of_the_whole_team(
    random_team: Callable, small_policy: Callable, seed: int, name: str, network: int
) -> None:
    rng = np.random.default_rng(seed)
    observation = random_team(rng, *rng.integers(1, 16, size=2))
    policy = small_policy(name, network)
    together = policy.encode(observation.field_of_view)
    decisions = decided(policy, observation, 3)
    for robot, heard in enumerate(observation.heard):
        own = policy.encode(observation.field_of_view[robot : robot + 1])
        assert bits(own.features.numpy(), own.messages) == bits(
            together.features[robot : robot + 1].numpy(), together.messages[robot : robot + 1]
        )
        # It hears its neighbours in some order, and knows nothing of places that stay empty.
        messages = together.messages[rng.permutation(heard[heard >= 0])][None]
        decision = policy.decide(
            own, messages, np.ones(messages.shape[:2], bool), observation.streams[robot : robot + 1], 3
        )
        assert bits(decision.weights, decision.primitives) == bits(
            decisions.weights[robot : robot + 1], decisions.primitives[robot : robot + 1]
        )


def test_a_team_of_more_than_one_chunk_gets_the_bits_of_its_parts(
    random_team: Callable, small_policy: Callable
) -> None:
    observation = random_team(np.random.default_rng(5), *[60] * 5)
    view = observation.field_of_view
    assert len(view) == 300
    policy = small_policy("MAGAT-B-16-P3")
    whole, parts = policy.encode(view), [policy.encode(part) for part in np.split(view, [7, 256, 260])]
    assert bits(whole.messages) == bits(np.concatenate([part.messages for part in parts]))
    assert bits(whole.features.numpy()) == bits(np.concatenate([part.features.numpy() for part in parts]))


def test_the_full_size_network_is_exact_too(random_team: Callable, random_network: Callable) -> None:
    policy = Policy(random_network("MAGAT-F-128", channels=(32, 64, 128), hidden=128))
    observation = random_team(np.random.default_rng(2), 20)
    together, decisions = policy.encode(observation.field_of_view), decided(policy, observation)
    for robot, heard in enumerate(observation.heard):
        own = policy.encode(observation.field_of_view[robot : robot + 1])
        assert bits(own.messages) == bits(together.messages[robot : robot + 1])
        messages = together.messages[heard[heard >= 0]][None, ::-1]
        weights = policy.weights(own, messages, np.ones(messages.shape[:2], bool))
        assert bits(weights) == bits(decisions.weights[robot : robot + 1])


def test_the_number_of_threads_changes_nothing(random_team: Callable, small_policy: Callable) -> None:
    observation = random_team(np.random.default_rng(6), 40, 40)
    policy = small_policy("MAGAT-B-16-P3")
    one = decided(policy, observation)
    try:
        torch.set_num_threads(3)
        three = decided(policy, observation)
    finally:
        torch.set_num_threads(1)
    assert bits(one.weights, one.primitives) == bits(three.weights, three.primitives)


@settings(max_examples=40)
@given(seed=seeds, name=names)
def test_neither_the_order_of_messages_nor_empty_places_matter(
    random_team: Callable, small_policy: Callable, seed: int, name: str
) -> None:
    rng = np.random.default_rng(seed)
    policy = small_policy(name)
    observation = random_team(rng, 20)
    own = policy.encode(observation.field_of_view)
    heard = own.messages[rng.integers(20, size=8)]
    robot = alone(own, int(rng.integers(20)))
    plain = policy.weights(robot, heard[None], np.ones((1, 8), bool))
    places = rng.permutation(13)[:8]
    scattered = np.full((1, 13, policy.config.features), np.nan, np.float32)  # what stands in empty places is not read
    scattered[0, places] = heard
    present = np.zeros((1, 13), bool)
    present[0, places] = True
    assert bits(policy.weights(robot, scattered, present)) == bits(plain)


@pytest.mark.parametrize("name", ["MAGAT-F-16", "MAGAT-B-8", "MAGAT-F-8-P4"])
def test_a_robot_that_hears_nobody_still_decides(random_team: Callable, small_policy: Callable, name: str) -> None:
    policy = small_policy(name)
    own = policy.encode(random_team(np.random.default_rng(1), 6).field_of_view)
    nobody = np.zeros((6, 0, policy.config.features), np.float32)
    weights = policy.weights(own, nobody, np.zeros((6, 0), bool))
    assert weights.shape == (6, 5)
    assert (weights.max(axis=1) == 2**24).all()
    absent = np.full((6, 3, policy.config.features), np.nan, np.float32)
    assert bits(policy.weights(own, absent, np.zeros((6, 3), bool))) == bits(weights)
    # Hearing somebody is something else.
    messages = np.broadcast_to(own.messages[None], (6, *own.messages.shape))
    assert (policy.weights(own, messages, np.ones((6, 6), bool)) != weights).any(axis=1).all()


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
    view = np.repeat(observation.field_of_view, 400, axis=0)
    nobody = np.zeros((400, 0), np.int64)
    shared = policy.decide_together(view, nobody, np.full(400, 9, np.uint64), 0)
    assert len(set(shared.primitives.tolist())) == 1
    own = policy.decide_together(view, nobody, np.arange(400, dtype=np.uint64), 0)
    later = policy.decide_together(view, nobody, np.arange(400, dtype=np.uint64), 1)
    share = own.weights[0] / own.weights[0].sum()
    for decision in (own, later):
        counts = np.bincount(decision.primitives, minlength=5)
        assert np.abs(counts - 400 * share).max() < 4 * np.sqrt(400 * 0.25)
    assert own.primitives.tolist() != later.primitives.tolist()
