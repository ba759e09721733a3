# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Training samples are what the simulator shows to robots on the expert's paths, or wherever else they are."""

from dataclasses import replace

import numpy as np
import pytest

from magat_evaluation.cases import SolvedCase, solved_cases
from magat_evaluation.planners import simulator_for
from magat_sim.grid import DELTAS
from magat_sim.rollout import run_recorded
from magat_sim.simulator import Observation
from magat_training import symmetry
from magat_training.samples import Batch, Instants, Sampler

ROBOTS = 5


def walked(solved: SolvedCase) -> list[tuple[np.ndarray, list[list[int]], np.ndarray]]:
    """What the simulator shows at each instant of the expert's way, whom each hears, what each does next."""
    simulator = simulator_for([solved])
    steps = []
    for now, then in zip(solved.paths[:-1], solved.paths[1:], strict=True):
        observation = simulator.observe()
        assert simulator.position.tolist() == now.tolist()
        actions = primitives(now, then)
        steps.append((observation.field_of_view, neighbour_lists(observation.heard, 0), np.array(actions)))
        assert not simulator.step(actions).blocked.any()
    assert simulator.done
    return steps


def primitives(now: np.ndarray, then: np.ndarray) -> list[int]:
    return [DELTAS.tolist().index((b - a).tolist()) for a, b in zip(now, then, strict=True)]


def neighbour_lists(heard: np.ndarray, first: int) -> list[list[int]]:
    return [sorted(int(j) - first for j in row if j >= 0) for row in heard]


def everything(solved: list[SolvedCase]) -> Instants:
    return Instants.of_paths([s.paths for s in solved], range(len(solved)))


def drawn(solved: list[SolvedCase], seed: int, *shares: tuple[Instants, int]) -> Batch:
    """A batch with so many instants of each share."""
    sampler = Sampler(solved)
    return sampler.batch(np.random.default_rng(seed), [(sampler.pool(instants), count) for instants, count in shares])


def underway(solved: SolvedCase) -> np.ndarray:
    """How many robots are not on their goals, instant by instant."""
    return np.array([(cells != solved.case.goals).any(axis=1).sum() for cells in solved.paths])


def attitudes(view: np.ndarray) -> list[bytes]:
    """What is seen, in each of the eight attitudes."""
    return [np.ascontiguousarray(symmetry.turn_arrays(view, turn)).tobytes() for turn in range(8)]


def seen(batch: Batch) -> list[bytes]:
    """What is seen at each instant of ``batch``."""
    return [view.tobytes() for view in np.ascontiguousarray(batch.view).reshape(-1, ROBOTS, 3, 11, 11)]


def contents(instants: Instants) -> list[list]:
    return [instants.case.tolist(), instants.now.tolist(), instants.next.tolist()]


def test_every_instant_of_a_path_is_one_and_the_last_repeats_itself() -> None:
    first, second = np.arange(12).reshape(3, 2, 2), 100 + np.arange(8).reshape(2, 2, 2)
    instants = Instants.of_paths([first, second], [4, 0])
    assert len(instants) == 5
    assert contents(instants) == [
        [4, 4, 4, 0, 0],
        [*first.tolist(), *second.tolist()],
        [first[1].tolist(), first[2].tolist(), first[2].tolist(), second[1].tolist(), second[1].tolist()],
    ]
    # Millions of them are kept.
    assert (instants.case.dtype, instants.now.dtype, instants.next.dtype) == (np.int32, np.int16, np.int16)


def test_a_team_that_begins_on_its_goals_has_one_instant(solved: list[SolvedCase]) -> None:
    at_home = solved[0].paths[-1:]
    assert contents(Instants.of_paths([at_home], [3])) == [[3], at_home.tolist(), at_home.tolist()]


def test_joined_instants_are_those_of_all_parts_in_order(solved: list[SolvedCase]) -> None:
    parts = [Instants.of_paths([solved[i].paths], [i]) for i in (2, 0, 5)]
    joined = Instants.join(parts)
    assert len(joined) == sum(map(len, parts))
    assert contents(joined) == contents(Instants.of_paths([solved[i].paths for i in (2, 0, 5)], [2, 0, 5]))
    for name, array in vars(joined).items():
        assert array.dtype == getattr(parts[0], name).dtype
    assert contents(Instants.join(parts[:1])) == contents(parts[0])


def test_instants_are_taken_by_their_places_more_than_once_and_in_any_order(solved: list[SolvedCase]) -> None:
    instants = everything(solved)
    taken = instants.take(np.array([7, 0, 7]))
    for name, array in vars(taken).items():
        whole = getattr(instants, name)
        assert array.tolist() == [whole[7].tolist(), whole[0].tolist(), whole[7].tolist()]
        assert array.dtype == whole.dtype
    assert len(instants.take(np.array([], dtype=np.int64))) == 0


def test_a_sample_is_an_instant_of_the_experts_way_turned_by_a_symmetry(solved: list[SolvedCase]) -> None:
    # Each instant in each of its eight attitudes, keyed by what is seen.
    known = {}
    for s in solved:
        for view, heard, action in walked(s):
            for turn, key in enumerate(attitudes(view)):
                known[key] = (heard, symmetry.PRIMITIVES[turn, action].tolist())
    batch = drawn(solved, 0, (everything(solved), 600))
    assert batch.view.shape == (600 * ROBOTS, 3, 11, 11)
    assert (batch.view.dtype, batch.action.dtype) == (np.uint8, np.int64)
    unknown = 0
    for i, key in enumerate(seen(batch)):
        rows = slice(i * ROBOTS, (i + 1) * ROBOTS)
        if key in known:
            heard, action = known[key]
            assert neighbour_lists(batch.heard[rows], rows.start) == heard
            assert batch.action[rows].tolist() == action
        else:
            # The last instant: all have arrived, and rest.
            assert batch.view[rows, 2, 5, 5].all()
            assert not batch.action[rows].any()
            unknown += 1
    expected = 600 * len(solved) / sum((underway(s) + 1).sum() for s in solved)
    assert abs(unknown - expected) < 5 * np.sqrt(expected)


def test_a_sample_off_the_experts_way_is_what_the_simulator_shows_there(solved: list[SolvedCase]) -> None:
    rng = np.random.default_rng(5)
    for index, s in enumerate(solved):
        free = np.argwhere(~s.case.obstacles)[:, ::-1]
        place = rng.permutation(free)[:ROBOTS]
        simulator = simulator_for([replace(s, case=replace(s.case, starts=place))])
        shown: Observation = simulator.observe()
        moved = simulator.step(rng.integers(5, size=ROBOTS)).moved
        instant = Instants(
            np.array([index], dtype=np.int32),
            place[None].astype(np.int16),
            simulator.position[None].astype(np.int16),
        )
        batch = drawn(solved, index, (instant, 60))
        keys = attitudes(shown.field_of_view)
        assert set(seen(batch)) == set(keys)
        for i, key in enumerate(seen(batch)):
            rows = slice(i * ROBOTS, (i + 1) * ROBOTS)
            assert batch.action[rows].tolist() == symmetry.PRIMITIVES[keys.index(key), moved].tolist()
            assert neighbour_lists(batch.heard[rows], rows.start) == neighbour_lists(shown.heard, 0)


def test_instants_come_by_their_robots_underway_and_every_symmetry_equally_often() -> None:
    (solved,) = solved_cases([2], workers=1, width=9, height=9, robots=ROBOTS, density=0.15)
    places = {
        key: (instant, turn)
        for instant, (view, _, _) in enumerate(walked(solved))
        for turn, key in enumerate(attitudes(view))
    }
    instants = len(solved.paths)
    assert len(places) == 8 * (instants - 1)
    both = everything([solved])
    # Two shares of the same: neither has attitudes or instants of its own.
    keys = seen(drawn([solved], 1, (both, 2500), (both, 1500)))
    shares = (underway(solved) + 1) / (underway(solved) + 1).sum()
    assert shares.max() > 2 * shares.min()
    for part in (keys, keys[:2500], keys[2500:]):
        counts = np.zeros((instants, 8))
        for key in part:
            if key in places:
                counts[places[key]] += 1
        expected = len(part) * shares[:-1, None] / 8
        assert (np.abs(counts[:-1] - expected) < 5 * np.sqrt(expected)).all()


def test_every_instant_of_a_long_share_comes_beside_a_short_one(solved: list[SolvedCase]) -> None:
    long = Instants.of_paths([solved[1].paths[:-1]], [1])
    short = Instants.of_paths([solved[6].paths[:1]], [6])
    way = [set(attitudes(view)) for view, _, _ in walked(solved[1])]
    for shares in ([(long, 300), (short, 20)], [(short, 20), (long, 300)]):
        keys = set(seen(drawn(solved, 3, *shares)))
        assert all(keys & instant for instant in way)


@pytest.mark.parametrize("counts", [(12, 20), (1, 7), (0, 6), (5, 0)])
def test_a_batch_has_as_many_instants_of_each_share_as_it_was_told(
    solved: list[SolvedCase], counts: tuple[int, int]
) -> None:
    shares = [Instants.of_paths([solved[i].paths[:-1]], [i]) for i in (1, 6)]
    ways = [{key for view, _, _ in walked(solved[i]) for key in attitudes(view)} for i in (1, 6)]
    assert not ways[0] & ways[1]
    batch = drawn(solved, 2, *zip(shares, counts, strict=True))
    keys = seen(batch)
    assert len(keys) == sum(counts)
    assert len(batch.action) == len(batch.heard) == len(batch.view) == ROBOTS * sum(counts)
    assert all(key in ways[0] for key in keys[: counts[0]])
    assert all(key in ways[1] for key in keys[counts[0] :])


def test_batches_depend_on_the_generator_and_on_nothing_else(solved: list[SolvedCase]) -> None:
    def made(sampler: Sampler, seed: int) -> list[bytes]:
        batch = sampler.batch(np.random.default_rng(seed), [(sampler.pool(instants), 10), (sampler.pool(part), 6)])
        return [array.tobytes() for array in (batch.view, batch.heard, batch.action)]

    instants, part = everything(solved), Instants.of_paths([solved[3].paths], [3])
    before = contents(instants), contents(part)
    sampler = Sampler(solved)
    first = made(sampler, 3)
    assert made(sampler, 4)[0] != first[0]
    np.random.seed(99)  # noqa: NPY002  # what somebody else may do in the same process
    assert made(sampler, 3) == made(Sampler(solved), 3) == first
    assert (contents(instants), contents(part)) == before


def test_robots_hear_nobody_of_another_instant(solved: list[SolvedCase]) -> None:
    shares = [(everything(solved), 30), (Instants.of_paths([solved[3].paths], [3]), 34)]
    heard = drawn(solved, 0, *shares).heard
    row, place = np.nonzero(heard >= 0)
    assert len(row) > 64
    assert (heard[row, place] // ROBOTS == row // ROBOTS).all()


def test_following_the_labels_leads_the_expert_to_its_goals(solved: list[SolvedCase]) -> None:
    for s in solved:
        actions = iter([action for _, _, action in walked(s)])
        paths = run_recorded(simulator_for([s]), lambda _, actions=actions: next(actions))
        assert paths.tolist() == s.paths.tolist()


def test_without_cases_there_is_nothing_to_learn() -> None:
    with pytest.raises(ValueError, match="nothing to learn"):
        Sampler([])
