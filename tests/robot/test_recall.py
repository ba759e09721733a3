"""What is recalled has the bits of what would be computed, and is not computed."""

from collections.abc import Callable

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_robot.policy.interface import Encoding
from magat_robot.policy.recall import Recall


def bits(own: Encoding) -> list[bytes]:
    values = [own.thought.features, own.thought.x, own.thought.total]
    assert (own.thought.rounds, own.thought.brought) == (0, None)
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

    def encode(view: np.ndarray) -> Encoding:
        asked.append(len(view))
        return policy.encode(view)

    recall = Recall(encode)
    before: set[bytes] = set()
    for _ in range(6):
        # Other robots each time, of which some see what was seen before, and some see the same.
        now = views[rng.integers(30, size=rng.integers(1, 25))]
        keys = [view.tobytes() for view in now]
        known = recall.encode(now)
        assert bits(known) == bits(policy.encode(now))
        assert asked.pop() == sum(key not in before for key in keys)
        before = set(keys)


def test_where_nothing_has_changed_nothing_is_computed(random_team: Callable, small_policy: Callable) -> None:
    policy = small_policy("MAGAT-F-16")
    views = random_team(np.random.default_rng(0), 12).field_of_view
    computed: list[int] = []

    def encode(view: np.ndarray) -> Encoding:
        computed.append(len(view))
        return policy.encode(view)

    recall = Recall(encode)
    first = bits(recall.encode(views))
    assert bits(recall.encode(views[::-1])) != first
    assert bits(recall.encode(views)) == first
    assert sum(computed) == 12
