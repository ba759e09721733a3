"""Training samples are what the simulator shows to robots that walk along the expert's paths."""

import numpy as np
import pytest

from magat_sim.grid import DELTAS
from magat_sim.rollout import run_recorded
from magat_training import symmetry
from magat_training.cases import SolvedCase, solved_cases
from magat_training.evaluate import simulator_for
from magat_training.samples import Batch, Samples


def walked(solved: SolvedCase) -> list[tuple[np.ndarray, list[list[int]], np.ndarray]]:
    """What the simulator shows at each instant of the expert's way, whom each hears, what each does next."""
    simulator = simulator_for([solved])
    steps = []
    for now, then in zip(solved.paths[:-1], solved.paths[1:], strict=True):
        observation = simulator.observe()
        assert simulator.position.tolist() == now.tolist()
        wanted = [DELTAS.tolist().index((b - a).tolist()) for a, b in zip(now, then, strict=True)]
        steps.append((observation.field_of_view, neighbour_lists(observation.heard, 0), np.array(wanted)))
        assert not simulator.step(wanted).blocked.any()
    assert simulator.done
    return steps


def neighbour_lists(heard: np.ndarray, first: int) -> list[list[int]]:
    return [sorted(int(j) - first for j in row if j >= 0) for row in heard]


def test_every_instant_is_a_sample(solved: list[SolvedCase]) -> None:
    assert len(Samples(solved)) == sum(len(s.paths) for s in solved)


def test_a_sample_is_an_instant_of_the_experts_way_turned_by_a_symmetry(solved: list[SolvedCase]) -> None:
    robots = 5
    # Each instant in each of its eight attitudes, keyed by what is seen.
    known = {}
    for s in solved:
        for view, heard, action in walked(s):
            for turn in range(8):
                seen = symmetry.turn_arrays(view, turn)
                known[seen.tobytes()] = (heard, symmetry.PRIMITIVES[turn, action].tolist())
    batch = Samples(solved).batch(np.random.default_rng(0), 600)
    assert batch.view.shape == (600 * robots, 3, 11, 11)
    assert (batch.view.dtype, batch.action.dtype) == (np.uint8, np.int64)
    unknown = 0
    for i in range(600):
        rows = slice(i * robots, (i + 1) * robots)
        key = np.ascontiguousarray(batch.view[rows]).tobytes()
        if key in known:
            heard, action = known[key]
            assert neighbour_lists(batch.heard[rows], rows.start) == heard
            assert batch.action[rows].tolist() == action
        else:
            # The last instant: all have arrived, and rest.
            assert batch.view[rows, 2, 5, 5].all()
            assert not batch.action[rows].any()
            unknown += 1
    expected = 600 * len(solved) / sum(len(s.paths) for s in solved)
    assert abs(unknown - expected) < 5 * np.sqrt(expected)


def test_every_instant_and_every_symmetry_comes_equally_often() -> None:
    (solved,) = solved_cases([2], workers=1, width=9, height=9, robots=5, density=0.15)
    attitudes = {
        symmetry.turn_arrays(view, turn).tobytes(): (instant, turn)
        for instant, (view, _, _) in enumerate(walked(solved))
        for turn in range(8)
    }
    instants = len(solved.paths)
    assert len(attitudes) == 8 * (instants - 1)
    batch = Samples([solved]).batch(np.random.default_rng(1), 4000)
    counts = np.zeros((instants, 8))
    for view in batch.view.reshape(4000, 5, 3, 11, 11):
        if (found := attitudes.get(np.ascontiguousarray(view).tobytes())) is not None:
            counts[found] += 1
    expected = 4000 / (8 * instants)
    assert np.abs(counts[:-1] - expected).max() < 5 * np.sqrt(expected)


def test_batches_are_repeatable_and_follow_the_generator(solved: list[SolvedCase]) -> None:
    samples = Samples(solved)
    first, second, other = (samples.batch(np.random.default_rng(seed), 16) for seed in (3, 3, 4))
    for name in ("view", "heard", "action"):
        assert getattr(first, name).tolist() == getattr(second, name).tolist()
    assert first.view.tolist() != other.view.tolist()


def test_robots_hear_nobody_of_another_instant(solved: list[SolvedCase]) -> None:
    heard = Samples(solved).batch(np.random.default_rng(0), 64).heard
    row, place = np.nonzero(heard >= 0)
    assert len(row) > 64
    assert (heard[row, place] // 5 == row // 5).all()


def test_following_the_labels_leads_the_expert_to_its_goals(solved: list[SolvedCase]) -> None:
    for s in solved:
        actions = iter([action for _, _, action in walked(s)])
        paths = run_recorded(simulator_for([s]), lambda _, actions=actions: next(actions))
        assert paths.tolist() == s.paths.tolist()


def test_joined_batches_keep_their_neighbourhoods(solved: list[SolvedCase]) -> None:
    samples = Samples(solved)
    left, right = (samples.batch(np.random.default_rng(seed), size) for seed, size in ((0, 3), (1, 7)))
    narrow = Batch(left.view, left.heard[:, :0], left.action)  # as if nobody heard anybody
    for first, second in ((left, right), (right, left), (narrow, right), (right, narrow)):
        joined = first.join(second)
        rows = len(first.action)
        assert joined.view.tolist() == [*first.view.tolist(), *second.view.tolist()]
        assert joined.action.tolist() == [*first.action.tolist(), *second.action.tolist()]
        assert neighbour_lists(joined.heard[:rows], 0) == neighbour_lists(first.heard, 0)
        assert neighbour_lists(joined.heard[rows:], rows) == neighbour_lists(second.heard, 0)


def test_without_cases_there_is_nothing_to_learn() -> None:
    with pytest.raises(ValueError, match="nothing to learn"):
        Samples([])
