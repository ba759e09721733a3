# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The PIBT shields: no collisions with any input, and the same moves as a plain implementation of the algorithm."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from magat_robot.policy.visit_memory import NO_CELL
from magat_sim.case import Case
from magat_sim.grid import DELTAS, Primitive
from magat_sim.shield import (
    MEMORY,
    NO_ROBOT,
    RETURN_PENALTY,
    SHIELDS,
    Scene,
    pibt_memory_shield,
    pibt_shield,
    ranking,
)
from magat_sim.simulator import Actions, Rules, Simulator
from magat_sim.streams import episode_streams

IDLE, UP, DOWN, LEFT, RIGHT = Primitive
PIBT = Rules(shield="pibt")
seeds = st.integers(0, 2**32 - 1)
sides = st.integers(1, 9)
ALIKE = (0.0,) * 5


def reference(scene: Scene, memory: bool) -> list[int]:
    """PIBT as Okumura et al. write it down: recursive, on sets."""

    def rank(i: int, a: int) -> tuple[bool, float, int]:
        returns = int(scene.returns[i, a]) if memory and not scene.silent[i] else 0
        return a != scene.actions[i] or returns > 0, RETURN_PENALTY * returns - float(scene.log_probabilities[i, a]), a

    ranked = [sorted(range(5), key=lambda a, i=i: rank(i, a)) for i in range(len(scene.place))]
    order = sorted(range(len(scene.place)), key=lambda i: (not scene.silent[i], -scene.waited[i], scene.draw[i]))
    now = {int(place): i for i, place in enumerate(scene.place)}
    following: dict[int, int] = {}
    made: dict[int, int] = {}

    def pibt(i: int) -> bool:
        for primitive in ranked[i]:
            to = int(scene.leads[i, primitive])
            if not scene.free[i, primitive] or to in following.values():
                continue
            other = now.get(to)
            if other is not None and following.get(other) == scene.place[i]:
                continue
            following[i], made[i] = to, primitive
            if other is not None and other not in following and not pibt(other):
                continue
            return True
        following[i], made[i] = int(scene.place[i]), IDLE
        return False

    for i in order:
        if i not in following:
            pibt(i)
    return [made[i] for i in range(len(scene.place))]


def random_scene(rng: np.random.Generator, side: int, robots: int, density: float) -> Scene:
    """A crowd on one map with a rim."""
    grid = np.ones((side + 2, side + 2), dtype=bool)
    grid[1:-1, 1:-1] = rng.random((side, side)) < density
    free = np.flatnonzero(~grid)
    place = rng.permutation(free)[: max(1, robots)]
    if len(place) == 0:
        grid[1, 1] = False
        place = np.flatnonzero(~grid)
    leads = place[:, None] + np.array([0, side + 2, -(side + 2), -1, 1])
    occupant = np.full(grid.size, NO_ROBOT)
    occupant[place] = np.arange(len(place))
    silent = rng.random(len(place)) < 0.1
    return Scene(
        place=place,
        leads=leads,
        free=~grid.reshape(-1)[leads],
        ahead=occupant[leads],
        actions=np.where(silent, IDLE, rng.integers(5, size=len(place))),
        log_probabilities=rng.choice([-0.1, -1.0, -2.5, -20.0], size=(len(place), 5)).astype(np.float32),
        silent=silent,
        waited=rng.integers(4, size=len(place)),
        trail=np.where(rng.random((len(place), 8)) < 0.3, NO_CELL, rng.choice(leads, 8, axis=1)),
        draw=rng.random(len(place)),
    )


def assert_legal(scene: Scene, made: np.ndarray) -> None:
    robots = np.arange(len(made))
    to = scene.leads[robots, made]
    assert scene.free[robots, made].all()
    assert len(set(to.tolist())) == len(to), "two in one place"
    ahead = scene.ahead[robots, made]
    swaps = (ahead != NO_ROBOT) & (ahead != robots) & (to[ahead] == scene.place)
    assert not swaps.any()
    assert (made[scene.silent] == IDLE).all()


@settings(max_examples=400)
@given(seed=seeds, side=sides, share=st.floats(0.05, 1), density=st.floats(0, 0.4))
def test_it_decides_as_the_published_recursion_does(seed: int, side: int, share: float, density: float) -> None:
    scene = random_scene(np.random.default_rng(seed), side, int(share * side * side), density)
    for memory, shield in ((False, pibt_shield), (True, pibt_memory_shield)):
        made = shield(scene)
        assert made.tolist() == reference(scene, memory)
        assert_legal(scene, made)


@settings(max_examples=80)
@given(seed=seeds, side=sides, share=st.floats(0.05, 1))
def test_whatever_robots_send_they_never_collide(seed: int, side: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, side, int(share * side * side), 0.1)
    odd = np.array([np.nan, np.inf, -np.inf, 1e38, -1e38, 0.0, 7.0, -1.0], dtype=np.float32)
    sent = rng.choice(odd, size=scene.log_probabilities.shape)
    scene = dataclasses.replace(scene, log_probabilities=sent)
    assert_legal(scene, pibt_shield(scene))
    assert_legal(scene, pibt_memory_shield(scene))


@pytest.mark.parametrize(
    ("sent", "ranked"),
    [
        pytest.param([-3, -1, -2, -5, -4], [LEFT, UP, DOWN, IDLE, RIGHT], id="by falling probability"),
        pytest.param([0, 0, 0, 0, 0], [LEFT, IDLE, UP, DOWN, RIGHT], id="equal ones as they are numbered"),
        pytest.param([np.nan, -9, np.nan, -1, -8], [LEFT, RIGHT, UP, IDLE, DOWN], id="no numbers last"),
        pytest.param([-np.inf, np.nan, -5, 0, np.inf], [LEFT, RIGHT, DOWN, IDLE, UP], id="infinities are the ends"),
        pytest.param([5, 400, -5, -90, 3e38], [LEFT, RIGHT, UP, IDLE, DOWN], id="no probabilities at all"),
        pytest.param([np.nan] * 5, [LEFT, IDLE, UP, DOWN, RIGHT], id="nothing but no numbers"),
    ],
)
def test_the_primitive_drawn_comes_first_and_the_rest_has_a_defined_order(sent: list, ranked: list) -> None:
    assert ranking(np.array([LEFT]), [sent]).tolist() == [ranked]


@pytest.mark.parametrize(
    ("returns", "ranked"),
    [
        ([0, 0, 0, 0, 0], [LEFT, UP, DOWN, IDLE, RIGHT]),
        ([0, 0, 0, 0, 3], [LEFT, UP, DOWN, IDLE, RIGHT]),
        ([0, 0, 0, 1, 0], [UP, DOWN, IDLE, LEFT, RIGHT]),  # -1.5 - 2 is less than -3.3
        ([2, 0, 0, 2, 0], [UP, DOWN, LEFT, IDLE, RIGHT]),
    ],
)
def test_a_return_has_no_precedence_and_each_costs(returns: list, ranked: list) -> None:
    assert ranking(np.array([LEFT]), [[-3.3, -1.0, -2.6, -1.5, -9.0]], [returns]).tolist() == [ranked]


class Scenes(list[Scene]):
    """Keeps what a shield is shown."""

    def __call__(self, scene: Scene) -> np.ndarray:
        self.append(scene)
        return scene.actions


def test_what_counts_as_a_return(monkeypatch: pytest.MonkeyPatch) -> None:
    scenes = Scenes()
    monkeypatch.setitem(SHIELDS, "pibt", scenes)
    simulator = line([(1, 0), (4, 0)], [(3, 0), (4, 0)], height=2)
    for primitive in (IDLE, RIGHT, LEFT, RIGHT, LEFT, IDLE, RIGHT, RIGHT, LEFT, IDLE):
        simulator.step([primitive, UP if simulator.tick == 0 else IDLE])
    returns = [scene.returns[0].tolist() for scene in scenes]
    # To idle, up, down, left, right. It stands at x = 1, 1, 2, 1, 2, 1, 1, 2, its goal, 2.
    assert returns[:4] == [[0, 0, 0, 0, 0]] * 4, "waiting is no visit, and the first visit of a cell is no return"
    assert returns[4:7] == [[MEMORY, 0, 0, 1, 0], [0, 0, 0, 0, 1], [MEMORY, 0, 0, 0, 1]], "it has come back once, twice"
    assert returns[7] == [0, 0, 0, 2, 0]
    assert returns[8:] == [[0, 0, 0, 0, 0]] * 2, "it has been on its goal"


def test_the_oldest_visits_are_forgotten_and_waiting_forgets_none(monkeypatch: pytest.MonkeyPatch) -> None:
    scenes = Scenes()
    monkeypatch.setitem(SHIELDS, "pibt", scenes)
    case = Case(np.zeros((2, 9), dtype=bool), np.array([(0, 0)]), np.array([(8, 0)]))
    simulator = Simulator([case], [3 * MEMORY], [episode_streams(1, 0, 1)], PIBT)
    # Three visits of the start, then it goes up and down beside it.
    for primitive in (RIGHT, LEFT, RIGHT, LEFT, RIGHT, *[IDLE] * MEMORY, *[UP, DOWN] * (MEMORY // 2), IDLE):
        simulator.step([primitive])
    left = [int(scene.returns[0, LEFT]) for scene in scenes]
    assert left[5 : 5 + MEMORY] == [2] * MEMORY
    assert left[-1] == 0


def test_a_robot_that_waits_is_not_pushed() -> None:
    case = Case(np.zeros((5, 5), dtype=bool), np.array([(1, 2)]), np.array([(4, 2)]))
    simulator = Simulator([case], [50], [episode_streams(1, 0, 1)], Rules(shield="pibt-memory"))
    for primitive in (RIGHT, LEFT, RIGHT, LEFT):  # where it has been before, too
        simulator.step(Actions([primitive], [np.where(np.arange(5) == primitive, -0.1, -9.0)]))
    while not simulator.done:
        step = simulator.step(Actions([IDLE], [np.log([0.8, 0.05, 0.05, 0.05, 0.05])]))
        assert step.moved.tolist() == [IDLE]


@pytest.mark.parametrize(("depth", "half"), [(1, 1), (3, 1), (2, 2)])
@pytest.mark.parametrize("pull", [1, 3])
def test_with_memory_a_robot_leaves_a_pocket_that_it_would_go_to_and_fro_in(depth: int, half: int, pull: float) -> None:
    middle = half + 1
    obstacles = np.zeros((2 * half + 3, 8), dtype=bool)
    obstacles[1:-1, 5] = obstacles[[1, -2], 5 - depth : 5] = True  # open to the left
    ticks = {}
    for shield in ("pibt", "pibt-memory"):
        case = Case(obstacles, np.array([(0, middle)]), np.array([(7, middle)]))
        simulator = Simulator([case], [150], [episode_streams(1, 0, 1)], Rules(shield=shield))
        rng = np.random.default_rng(1)
        while not simulator.done:
            x, y = (simulator.position[0] + DELTAS).T
            weights = np.exp(-pull * np.abs(np.stack([x, y], axis=1) - simulator.goal[0]).sum(axis=1))
            weights *= np.where(np.arange(5) == IDLE, 0.2, 1.0)
            # It sees the obstacles around it.
            weights *= np.where(np.pad(obstacles, 1, constant_values=True)[y + 1, x + 1], 1e-6, 1.0)
            weights /= weights.sum()
            simulator.step(Actions([rng.choice(5, p=weights)], [np.log(weights)]))
        ticks[shield] = simulator.tick
    assert ticks["pibt"] == 150
    assert ticks["pibt-memory"] < 120


@settings(max_examples=60)
@given(seed=seeds, width=sides, height=sides, share=st.floats(0.05, 1), density=st.floats(0, 0.5))
def test_in_the_simulator_no_robots_collide(
    random_case: Callable, judge: Callable, seed: int, width: int, height: int, share: float, density: float
) -> None:
    rng = np.random.default_rng(seed)
    case = random_case(rng, width, height, max(1, int(share * width * height)), density)
    simulator = Simulator([case], [15], [episode_streams(seed, 0, case.robots)], PIBT)
    while not simulator.done:
        before = simulator.position.copy()
        actions, log_probabilities = rng.integers(5, size=case.robots), rng.normal(size=(case.robots, 5))
        silent = rng.random(case.robots) < 0.2
        step = simulator.step(Actions(actions, log_probabilities, silent))
        # Checked as if each robot's move were its action: waiting is allowed, any other fault is not.
        assert [f for f in judge(case.obstacles, before, step.moved, simulator.position) if "was kept" not in f] == []
        moved = (before != simulator.position).any(axis=1)
        assert ((step.moved != IDLE) == moved).all()
        assert not moved[silent].any()
        said = np.where(silent, IDLE, actions)
        assert step.blocked.tolist() == ((said != IDLE) & (said != step.moved)).tolist()


def line(starts: list, goals: list, width: int = 5, height: int = 1) -> Simulator:
    """A small world with this shield."""
    case = Case(np.zeros((height, width), dtype=bool), np.array(starts), np.array(goals))
    return Simulator([case], [50], [episode_streams(1, 0, len(starts))], PIBT)


def test_a_robot_on_its_goal_is_pushed_aside_by_one_that_has_not_arrived() -> None:
    simulator = line([(0, 0), (1, 0)], [(4, 0), (1, 0)])
    simulator.step([IDLE, IDLE])
    step = simulator.step(Actions([RIGHT, IDLE], [[-9, -9, -9, -9, 0], ALIKE]))
    assert step.moved.tolist() == [RIGHT, RIGHT]
    assert step.blocked.tolist() == [False, False], "it drew no move that was blocked"


def test_the_robot_that_has_been_away_from_its_goal_longest_goes_first() -> None:
    # Both want the cell between them; one has just been on its goal.
    for late, starts in (([RIGHT, IDLE], [(0, 0), (2, 0)]), ([IDLE, LEFT], [(0, 0), (2, 0)])):
        goals = [(4, 0), (2, 0)] if late[0] == RIGHT else [(0, 0), (4, 0)]
        simulator = line(starts, goals)
        simulator.step([IDLE, IDLE])
        log_probabilities = [[-1, -9, -9, -9, 0], [-1, -9, -9, 0, -9]]
        assert simulator.step(Actions([RIGHT, LEFT], log_probabilities)).moved.tolist() == late


def test_among_equals_the_episodes_generator_decides() -> None:
    winners = set()
    for number in range(30):
        case = Case(np.zeros((1, 3), dtype=bool), np.array([(0, 0), (2, 0)]), np.array([(2, 0), (0, 0)]))
        simulator = Simulator([case], [9], [episode_streams(1, number, 2)], PIBT)
        winners.add(tuple(simulator.step([RIGHT, LEFT]).moved.tolist()))
    assert winners == {(RIGHT, IDLE), (IDLE, LEFT)}


def test_of_two_that_would_swap_one_gives_way_into_a_bay() -> None:
    obstacles = np.ones((2, 3), dtype=bool)
    obstacles[0] = obstacles[1, 1] = False
    case = Case(obstacles, np.array([(0, 0), (1, 0)]), np.array([(2, 0), (1, 0)]))
    simulator = Simulator([case], [9], [episode_streams(1, 0, 2)], PIBT)
    simulator.step([IDLE, IDLE])
    step = simulator.step(Actions([RIGHT, LEFT], [[-2, -9, -9, -9, 0], [-3, -4, -9, 0, -5]]))
    assert step.moved.tolist() == [RIGHT, UP]
    assert step.blocked.tolist() == [False, True]


def test_a_silent_robot_is_not_pushed_and_those_behind_it_look_for_another_way() -> None:
    simulator = line([(0, 0), (1, 0)], [(4, 0), (1, 0)], height=2)
    simulator.step([IDLE, IDLE])  # now the other one has waited for longer
    log_probabilities = [[-2, -1, -9, -9, 0], ALIKE]
    step = simulator.step(Actions([RIGHT, IDLE], log_probabilities, [False, True]))
    assert step.moved.tolist() == [UP, IDLE]
    assert step.blocked.tolist() == [True, False]


def test_a_chain_of_a_thousand_robots_does_not_overflow_the_stack() -> None:
    count = 1000
    simulator = line([(x, 0) for x in range(count)], [(x + 1, 0) for x in range(count)], width=count + 1)
    assert simulator.step([RIGHT] * count).moved.tolist() == [RIGHT] * count


def test_without_log_probabilities_all_are_alike() -> None:
    given = [RIGHT, IDLE]
    moved = [
        line([(0, 0), (1, 0)], [(4, 0), (1, 0)]).step(one).moved.tolist()
        for one in (given, Actions(given, [ALIKE] * 2))
    ]
    assert moved[0] == moved[1]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (Actions([0, 0], [[0] * 5]), r"log-probabilities of shape \(1, 5\)"),
        (Actions([0, 0], [[0] * 4] * 2), r"log-probabilities of shape \(2, 4\)"),
        (Actions([0, 0], None, [True]), r"silent of shape \(1,\)"),
    ],
)
def test_actions_of_another_shape_are_refused(given: Actions, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        line([(0, 0), (1, 0)], [(4, 0), (1, 0)]).step(given)


def test_a_shield_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ValueError, match=f"no shield 'none': it is one of {', '.join(SHIELDS)}"):
        Rules(shield="none")
