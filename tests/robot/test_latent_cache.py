# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cached latent states equal computed ones to the last bit, and are not computed again."""

from collections.abc import Callable

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_robot.policy.interface import LatentState
from magat_robot.policy.latent_cache import LatentCache


def bits(own: LatentState) -> list[bytes]:
    values = [own.state.features, own.state.x, own.state.total]
    assert (own.state.rounds, own.state.aggregated) == (0, None)
    return [own.messages.tobytes(), *(value.numpy().tobytes() for value in values)]


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_recalled_or_computed_the_bits_are_the_same(
    random_team: Callable, small_policy: Callable, variant: dict, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    policy = small_policy(**variant)
    fields_of_view = random_team(rng, 30).field_of_view
    asked: list[int] = []

    def perceive(field_of_view: np.ndarray) -> LatentState:
        asked.append(len(field_of_view))
        return policy.perceive(field_of_view)

    cache = LatentCache(perceive)
    before: set[bytes] = set()
    for _ in range(6):
        # Other robots each time; some of their fields of view repeat, within the call or from the call before.
        now = fields_of_view[rng.integers(30, size=rng.integers(1, 25))]
        keys = [field_of_view.tobytes() for field_of_view in now]
        known = cache.perceive(now)
        assert bits(known) == bits(policy.perceive(now))
        assert asked.pop() == sum(key not in before for key in keys)
        before = set(keys)


def test_where_nothing_has_changed_nothing_is_computed(random_team: Callable, small_policy: Callable) -> None:
    policy = small_policy("MAGAT-F-16")
    fields_of_view = random_team(np.random.default_rng(0), 12).field_of_view
    computed: list[int] = []

    def perceive(field_of_view: np.ndarray) -> LatentState:
        computed.append(len(field_of_view))
        return policy.perceive(field_of_view)

    cache = LatentCache(perceive)
    first = bits(cache.perceive(fields_of_view))
    assert bits(cache.perceive(fields_of_view[::-1])) != first
    assert bits(cache.perceive(fields_of_view)) == first
    assert sum(computed) == 12
