# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Worlds in lockstep go as each goes alone, the same seeds give the same episode, and each world ends."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_sim.case import Case
from magat_sim.grid import Primitive
from magat_sim.measures import Flowtime
from magat_sim.rollout import run, run_recorded
from magat_sim.simulator import Observation, Rules, Simulator
from magat_sim.streams import episode_streams

IDLE, UP, DOWN, LEFT, RIGHT = Primitive


def decide(observation: Observation) -> np.ndarray:
    """Actions that hang on all a robot knows, and on nothing else."""
    heard = (observation.heard >= 0).sum(axis=1).astype(np.uint64)
    place = np.arange(1, 3 * 121 + 1, dtype=np.uint64).reshape(3, 11, 11)
    seen = (observation.field_of_view * place).sum(axis=(1, 2, 3)).astype(np.uint64)
    mixed = (observation.streams >> np.uint64(20)) + heard * np.uint64(77) + seen * np.uint64(13)
    return ((mixed + np.uint64(observation.tick)) * np.uint64(2654435761) >> np.uint64(7)) % np.uint64(5)


def simulator_of(cases: list[Case], t_max: list[int], numbers: list[int]) -> Simulator:
    streams = [episode_streams(3, number, case.robots) for number, case in zip(numbers, cases, strict=True)]
    return Simulator(cases, t_max, streams)


def pushed_together(rng: np.random.Generator, random_case: Callable) -> Case:
    """A small world, in which robots often reach their goals."""
    return random_case(rng, int(rng.integers(1, 9)), int(rng.integers(2, 9)), int(rng.integers(1, 7)), 0.1)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), worlds=st.integers(2, 6))
def test_ragged_worlds_in_one_batch_go_as_each_goes_alone(random_case: Callable, seed: int, worlds: int) -> None:
    rng = np.random.default_rng(seed)
    cases = [pushed_together(rng, random_case) for _ in range(worlds)]
    t_max = rng.integers(0, 25, size=worlds).tolist()
    together = simulator_of(cases, t_max, list(range(worlds)))
    alone = [simulator_of([case], [t], [n]) for n, (case, t) in enumerate(zip(cases, t_max, strict=True))]
    while not together.done:
        observation = together.observe()
        actions = decide(observation)
        step = together.step(actions)
        row = 0
        for world, single in enumerate(alone):
            if not single.done:
                theirs = single.observe()
                rows = slice(row, row + cases[world].robots)
                assert observation.field_of_view[rows].tolist() == theirs.field_of_view.tolist()
                assert observation.streams[rows].tolist() == theirs.streams.tolist()
                assert observation.tick == theirs.tick
                assert heard_lists(observation.heard[rows], row) == heard_lists(theirs.heard, 0)
                assert actions[rows].tolist() == decide(theirs).tolist()
                single_step = single.step(actions[rows])
                assert step.moved[rows].tolist() == single_step.moved.tolist()
                assert step.blocked[rows].tolist() == single_step.blocked.tolist()
                row = rows.stop
            assert together.position[together.world == world].tolist() == single.position.tolist()
        assert row == len(actions)
    assert all(single.done for single in alone)
    best = [Flowtime(5, 6)] * worlds
    assert together.measures(best) == [single.measures(best[:1])[0] for single in alone]


def heard_lists(heard: np.ndarray, first: int) -> list[list[int]]:
    return [[int(j) - first for j in row if j >= 0] for row in heard]


def test_the_same_seed_gives_the_same_episode_and_another_number_another(random_case: Callable) -> None:
    case = random_case(np.random.default_rng(0), 7, 7, 20, 0.1)
    first, second, other = (run_recorded(simulator_of([case], [40], [n]), decide) for n in (4, 4, 5))
    assert first.tolist() == second.tolist()
    assert first.tolist() != other.tolist()


def test_recorded_paths_begin_on_the_starts_and_have_every_step() -> None:
    case = Case(np.zeros((2, 3), dtype=bool), np.array([[0, 0], [2, 0]]), np.array([[1, 1], [2, 0]]))
    chosen = iter([[RIGHT, UP], [UP, DOWN]])
    paths = run_recorded(simulator_of([case], [9], [0]), lambda _: next(chosen))
    assert paths.tolist() == [[[0, 0], [2, 0]], [[1, 0], [2, 1]], [[1, 1], [2, 0]]]


def test_the_shield_draws_from_the_streams_of_the_episode(arena: Callable) -> None:
    def winners(number: int) -> list[list[int]]:
        simulators = [arena(3, 1, [(0, 0), (2, 0)], number=number * 100 + i) for i in range(30)]
        return [simulator.step([RIGHT, LEFT]).moved.tolist() for simulator in simulators]

    assert winners(0) == winners(0) != winners(1)


def test_a_world_ends_when_all_stand_on_their_goals_and_the_others_go_on() -> None:
    open_map = np.zeros((3, 6), dtype=bool)
    quick = Case(open_map, np.array([[0, 0]]), np.array([[1, 0]]))
    slow = Case(open_map, np.array([[0, 0], [0, 1]]), np.array([[3, 0], [0, 1]]))
    simulator = simulator_of([quick, slow], [9, 9], [0, 1])
    assert simulator.active.tolist() == [0, 1, 2]
    simulator.step([RIGHT, RIGHT, IDLE])
    assert simulator.active.tolist() == [1, 2]
    assert simulator.observe().field_of_view.shape == (2, 3, 11, 11)
    simulator.step([RIGHT, IDLE])
    assert not simulator.done
    simulator.step([RIGHT, IDLE])
    assert simulator.done
    assert simulator.position.tolist() == [[1, 0], [3, 0], [0, 1]]
    assert [m.ticks for m in simulator.measures([None, None])] == [1, 3]


def test_a_world_ends_after_its_own_t_max_with_its_robots_where_they_were() -> None:
    case = Case(np.zeros((2, 9), dtype=bool), np.array([[0, 0]]), np.array([[8, 1]]))
    simulator = simulator_of([case, case], [2, 5], [0, 1])
    ticks = []
    run(simulator, lambda observation: [RIGHT] * len(observation.streams), lambda s: ticks.append(s.tick))
    assert ticks == [1, 2, 3, 4, 5]
    assert simulator.position.tolist() == [[2, 0], [5, 0]]


def test_a_team_that_visits_all_goals_but_never_at_once_goes_on() -> None:
    case = Case(np.zeros((2, 3), dtype=bool), np.array([[0, 0], [2, 1]]), np.array([[0, 0], [1, 1]]))
    simulator = simulator_of([case], [3], [0])
    simulator.step([UP, LEFT])  # one leaves its goal as the other arrives
    assert simulator.visited.all()
    assert not simulator.done
    simulator.step([IDLE, IDLE])
    simulator.step([IDLE, IDLE])
    assert simulator.done


def test_nothing_is_left_to_see_or_to_do_in_worlds_that_are_done() -> None:
    case = Case(np.zeros((2, 2), dtype=bool), np.array([[0, 0]]), np.array([[0, 0]]))
    simulator = simulator_of([case], [7], [0])
    assert simulator.done
    assert simulator.observe().field_of_view.shape == (0, 3, 11, 11)
    with pytest.raises(ValueError, match="actions"):
        simulator.step([UP])
    assert run_recorded(simulator, decide).tolist() == [[[0, 0]]]


@pytest.mark.parametrize("actions", [[0], [0, 0, 0], [[0, 0]], [0, 5], [-1, 0], []])
def test_actions_that_are_not_primitives_are_refused_and_change_nothing(arena: Callable, actions: list) -> None:
    simulator = arena(4, 4, [(0, 0), (2, 2)])
    with pytest.raises(ValueError, match="actions"):
        simulator.step(actions)
    assert simulator.tick == 0
    assert simulator.position.tolist() == [[0, 0], [2, 2]]


def test_cases_t_max_and_streams_must_fit_together() -> None:
    case = Case(np.zeros((2, 2), dtype=bool), np.array([[0, 0]]), np.array([[1, 1]]))
    with pytest.raises(ValueError, match="streams for 2 robots"):
        Simulator([case], [3], [episode_streams(0, 0, 2)])
    with pytest.raises(ValueError, match="1 cases, 2 t_max, 1 streams"):
        Simulator([case], [3, 4], [episode_streams(0, 0, 1)])
    with pytest.raises(ValueError, match="0 cases"):
        Simulator([], [], [])


@pytest.mark.parametrize("loss", [-0.1, 1.1, float("nan")])
def test_a_loss_outside_0_to_1_is_refused(loss: float) -> None:
    with pytest.raises(ValueError, match=f"link loss {loss}"):
        Rules(loss)


def test_stepping_leaves_the_case_as_it_was() -> None:
    case = Case(np.zeros((1, 3), dtype=bool), np.array([[0, 0]]), np.array([[2, 0]]))
    simulator = simulator_of([case], [5], [0])
    simulator.step([RIGHT])
    assert case.starts.tolist() == [[0, 0]]


def test_robots_of_one_world_neither_see_nor_hear_those_of_another(random_case: Callable) -> None:
    rng = np.random.default_rng(8)
    cases = [random_case(rng, 9, 9, 10) for _ in range(2)]
    crowd, empty = cases[0], Case(cases[1].obstacles, cases[1].starts[:1], cases[1].goals[:1])
    both = simulator_of([crowd, empty], [5, 5], [0, 1]).observe()
    assert both.field_of_view[-1, 1].sum() == 1
    assert (both.heard[-1] == -1).all()
