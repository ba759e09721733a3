"""What is recalled has the bits of what would be computed, and is not computed."""

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
    views = random_team(rng, 30).field_of_view
    asked: list[int] = []

    def perceive(view: np.ndarray) -> LatentState:
        asked.append(len(view))
        return policy.perceive(view)

    cache = LatentCache(perceive)
    before: set[bytes] = set()
    for _ in range(6):
        # Other robots each time, of which some see what was seen before, and some see the same.
        now = views[rng.integers(30, size=rng.integers(1, 25))]
        keys = [view.tobytes() for view in now]
        known = cache.perceive(now)
        assert bits(known) == bits(policy.perceive(now))
        assert asked.pop() == sum(key not in before for key in keys)
        before = set(keys)


def test_where_nothing_has_changed_nothing_is_computed(random_team: Callable, small_policy: Callable) -> None:
    policy = small_policy("MAGAT-F-16")
    views = random_team(np.random.default_rng(0), 12).field_of_view
    computed: list[int] = []

    def perceive(view: np.ndarray) -> LatentState:
        computed.append(len(view))
        return policy.perceive(view)

    cache = LatentCache(perceive)
    first = bits(cache.perceive(views))
    assert bits(cache.perceive(views[::-1])) != first
    assert bits(cache.perceive(views)) == first
    assert sum(computed) == 12
