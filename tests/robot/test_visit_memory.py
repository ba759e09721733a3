# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The visit memory: trails from observations alone, and what they do to a decision."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from magat_robot.crew import Answer, Crew, ReceivedObservation
from magat_robot.policy.backends import load_policy
from magat_robot.policy.config import ModelError, PolicyConfig
from magat_robot.policy.grids import exp_table
from magat_robot.policy.models import find_policy
from magat_robot.policy.policy import Policy
from magat_robot.policy.store import load, save
from magat_robot.policy.visit_memory import LENGTH, Trails, VisitMemory, count_visits, lowered
from magat_sim.case import Case
from magat_sim.grid import Primitive
from magat_sim.simulator import Simulator
from magat_sim.streams import episode_streams

IDLE, UP, DOWN, LEFT, RIGHT = Primitive
HERE = np.array([0])


class Walker:
    """A robot on an empty map, with its memory."""

    def __init__(self, start: tuple[int, int], goal: tuple[int, int], obstacles: np.ndarray | None = None) -> None:
        obstacles = np.zeros((9, 9), dtype=bool) if obstacles is None else obstacles
        case = Case(obstacles, np.array([start]), np.array([goal]))
        self.simulator = Simulator([case], [500], [episode_streams(1, 0, 1)])
        self.memory = VisitMemory(1)

    def sees(self, episode: int = 7) -> list[int]:
        seen = self.simulator.observe()
        return self.memory.observe(HERE, episode, seen.tick, seen.moved, seen.field_of_view)[0].tolist()

    def walk(self, *primitives: Primitive) -> list[list[int]]:
        """Visits up, down, left and right after each primitive."""
        result = []
        for primitive in primitives:
            self.simulator.step([primitive])
            result.append(self.sees())
        return result


def test_a_visit_begins_when_a_robot_enters_a_cell_and_waiting_adds_nothing() -> None:
    walker = Walker((4, 4), (8, 8))
    assert walker.sees() == [0, 0, 0, 0]
    assert walker.walk(IDLE, IDLE, RIGHT, IDLE, UP, LEFT, DOWN, RIGHT) == [
        [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0], [0, 0, 1, 0],
        [0, 1, 0, 0], [0, 1, 0, 1], [1, 0, 0, 1], [1, 0, 2, 0],
    ]  # fmt: skip


def test_a_move_that_was_blocked_is_no_visit() -> None:
    obstacles = np.zeros((9, 9), dtype=bool)
    obstacles[4, 5] = True
    walker = Walker((4, 4), (8, 8), obstacles)
    walker.sees()
    assert walker.walk(LEFT, RIGHT, RIGHT, RIGHT)[1:] == [[0, 0, 1, 1]] * 3, "an obstacle counts as the most visited"


def test_a_goal_clears_the_trail() -> None:
    walker = Walker((4, 4), (5, 4))
    walker.sees()
    walker.simulator._strict[:] = False
    assert walker.walk(UP, DOWN, UP) == [[0, 1, 0, 0], [1, 0, 0, 0], [0, 2, 0, 0]]
    other = Walker((3, 4), (4, 4))
    other.memory.observe(HERE, 7, 0, np.array([IDLE]), view(goal=False))
    assert other.memory.observe(HERE, 7, 1, np.array([RIGHT]), view(goal=True)).tolist() == [[0, 0, 0, 0]]
    assert other.memory.observe(HERE, 7, 2, np.array([RIGHT]), view(goal=False)).tolist() == [[0, 0, 0, 0]]
    assert other.memory.observe(HERE, 7, 3, np.array([RIGHT]), view(goal=False)).tolist() == [[0, 0, 1, 0]]


def view(goal: bool) -> np.ndarray:
    """A field of view with nothing in it but perhaps the goal under the robot."""
    result = np.zeros((1, 3, 11, 11), dtype=np.uint8)
    result[0, 2, 5, 5] = goal
    return result


@pytest.mark.parametrize(
    ("episode", "tick"), [(7, 3), (8, 2), (8, 0), (7, 0)], ids=["a tick missed", "another episode", "new", "restarted"]
)
def test_a_gap_and_an_episode_begin_a_new_trail(episode: int, tick: int) -> None:
    memory = VisitMemory(1)
    for at, moved in enumerate((IDLE, RIGHT)):
        visits = memory.observe(HERE, 7, at, np.array([moved]), view(False))
    assert visits.tolist() == [[0, 0, 1, 0]]
    assert memory.observe(HERE, episode, tick, np.array([UP]), view(False)).tolist() == [[0, 0, 0, 0]]
    assert memory.observe(HERE, episode, tick + 1, np.array([UP]), view(False)).tolist() == [[0, 1, 0, 0]]


def test_robots_remember_apart_and_in_any_batch() -> None:
    rng = np.random.default_rng(3)
    steps = rng.integers(5, size=(60, 4))
    steps[0] = IDLE
    views = (rng.random((60, 4, 3, 11, 11)) < 0.05).astype(np.uint8)
    together, alone = VisitMemory(4), [VisitMemory(1) for _ in range(4)]
    for tick, moved in enumerate(steps):
        order = rng.permutation(4)[: 4 if tick < 40 else 3]
        visits = together.observe(order, 1, tick, moved[order], views[tick][order])
        for row, robot in enumerate(order):
            one = alone[robot].observe(HERE, 1, tick, moved[[robot]], views[tick][[robot]])
            assert visits[row].tolist() == one[0].tolist()


def test_the_oldest_visits_are_forgotten() -> None:
    trails = Trails(2, 3)
    for cell in range(5):
        trails.enter(np.array([1]), np.array([cell]))
    assert count_visits(trails.cells, np.array([[3, 4], [4, 1]])).tolist() == [[0, 0], [1, 0]]
    assert sorted(trails.cells[1].tolist()) == [2, 3, 4]
    memory = VisitMemory(1)
    memory.observe(HERE, 1, 0, np.array([IDLE]), view(False))
    for tick in range(1, LENGTH + 2):
        visits = memory.observe(HERE, 1, tick, np.array([UP if tick % 2 else DOWN]), view(False))
    assert visits.tolist() == [[0, LENGTH // 2, 0, 0]]


def weights_of(probabilities: list) -> np.ndarray:
    table = np.array(exp_table(), dtype=float)
    steps = np.rint(-256 * np.log(np.array(probabilities) / np.max(probabilities))).astype(int)
    return table[np.minimum(steps, len(table) - 1)]


def test_each_visit_subtracts_the_penalty_among_moves_and_waiting_stays_as_likely() -> None:
    before = weights_of([[0.1, 0.2, 0.1, 0.0001, 0.5999]])
    after = lowered(before, np.array([[0, 0, 1, 3]]), 1.5)
    shares, expected = (values / values.sum() for values in (after[0], before[0]))
    assert shares[0] == pytest.approx(expected[0], abs=1e-6)
    moves = expected[1:] * np.exp([0, 0, -1.5, -4.5])
    np.testing.assert_allclose(shares[1:], (1 - expected[0]) * moves / moves.sum(), rtol=2e-3, atol=1e-6)
    assert (after == np.rint(after)).all()


def test_without_visits_or_penalty_the_weights_stay_as_they_are() -> None:
    rng = np.random.default_rng(0)
    weights = weights_of(rng.dirichlet(np.ones(5) / 3, size=50))
    some = np.zeros((50, 4), dtype=np.int64)
    assert lowered(weights, None, 1.0) is weights
    assert lowered(weights, some, 1.0) is weights
    assert lowered(weights, some + 1, 0.0) is weights
    some[::2, 1] = 2
    after = lowered(weights, some, 1.0)
    assert (after[1::2] == weights[1::2]).all()
    assert (after[::2] != weights[::2]).any(axis=1).all()


def test_the_result_does_not_depend_on_the_batch_and_is_never_empty() -> None:
    rng = np.random.default_rng(1)
    weights = weights_of(rng.dirichlet(np.ones(5) / 10, size=300))
    visits = rng.integers(200, size=(300, 4))
    together = lowered(weights, visits, 3.7)
    for row in range(300):
        alone = lowered(weights[row : row + 1], visits[row : row + 1], 3.7)
        assert alone.tobytes() == together[row : row + 1].tobytes()
    assert (together.sum(axis=1) > 0).all()
    assert (together < 2**50).all()


def test_every_backend_applies_it_alike() -> None:
    folder = find_policy("MAGAT-F-32-P4")
    rng = np.random.default_rng(5)
    views = (rng.random((6, 3, 11, 11)) < 0.2).astype(np.uint8)
    visits = rng.integers(4, size=(6, 4))
    found = {}
    for backend in ("torch", "onnx", "echo"):
        policy = load_policy(folder, backend, visit_memory=0.8)
        own = policy.perceive(views)
        heard = np.repeat(own.messages[None], 6, axis=0)
        own = policy.hear(own, heard, np.ones((6, 6), dtype=bool))
        streams = np.arange(6, dtype=np.uint64)
        found[backend] = [policy.decide(own, streams, 3, seen) for seen in (visits, None)]
    remembering, forgetful = found["torch"]
    assert remembering.weights.tobytes() == found["onnx"][0].weights.tobytes()
    assert (remembering.weights != forgetful.weights).any(axis=1).all()
    sums = np.exp(remembering.log_probabilities).sum(axis=1)
    assert sums == pytest.approx(np.ones(6), abs=1e-5)
    echo = np.exp(found["echo"][0].log_probabilities)
    assert echo[:, 0] == pytest.approx(np.full(6, 0.2), abs=1e-5)
    assert (echo[:, 1:].argmax(axis=1) == visits.argmin(axis=1)).all()


def test_it_may_be_changed_after_training(random_network: Callable, tmp_path: Path) -> None:
    save(random_network("MAGAT-F-16", visit_memory=0.5), tmp_path, "")
    assert load(tmp_path).config.visit_memory == 0.5
    assert load(tmp_path, visit_memory=2).config.visit_memory == 2
    with pytest.raises(ModelError, match="visit_memory -1 is not within 0 and 100"):
        load(tmp_path, visit_memory=-1)


def test_older_configurations_have_none() -> None:
    values = PolicyConfig().to_json()
    del values["visit_memory"]
    assert PolicyConfig.from_json(values).visit_memory == 0
    for wrong in ("much", None, True):
        with pytest.raises(ModelError, match="visit_memory numbers"):
            PolicyConfig.from_json(values | {"visit_memory": wrong})
    with pytest.raises(ModelError, match="visit_memory nan is not within"):
        PolicyConfig(visit_memory=float("nan"))


def crew_of(policy: Policy, robots: int) -> tuple[Crew, list[Answer]]:
    """A crew, and its answers in order of time and robot."""
    answers: list[Answer] = []
    return Crew(policy, robots, lambda *_: None, lambda _, answer: answers.append(answer)), answers


def observation(tick: int, moved: int) -> ReceivedObservation:
    return ReceivedObservation(9, tick, 4, 1, frozenset(), view(False).tobytes(), moved)


def test_a_crew_decides_by_the_trails_of_its_robots_and_one_that_misses_an_observation_begins_anew(
    small_policy: Callable,
) -> None:
    policy = small_policy("MAGAT-F-16", visit_memory=2.0)
    crew, answers = crew_of(policy, 2)
    nobody = np.zeros((1, 0, 16), dtype=np.float32), np.zeros((1, 0), dtype=bool)
    own = policy.hear(policy.perceive(view(False)), *nobody)
    expected = {  # by tick and robot: visits up, down, left, right
        0: {0: [0, 0, 0, 0], 1: [0, 0, 0, 0]},
        1: {0: [0, 0, 1, 0], 1: [0, 1, 0, 0]},
        2: {0: [0, 0, 0, 1]},
        3: {0: [0, 0, 2, 0], 1: [0, 0, 0, 0]},
    }
    moves = {0: [IDLE, RIGHT, LEFT, RIGHT], 1: [IDLE, UP, DOWN, UP]}
    for tick, seen in expected.items():
        for robot in seen:
            crew.see(robot, observation(tick, moves[robot][tick]))
        crew.overdue()
        for answer, visits in zip(answers, seen.values(), strict=True):
            decision = policy.decide(own, np.array([4], dtype=np.uint64), tick, np.array([visits]))
            assert answer.log_probabilities.tolist() == decision.log_probabilities[0].tolist()
            assert answer.primitive == decision.primitives[0]
        answers.clear()


def test_a_crew_drops_an_observation_with_a_move_that_does_not_exist(small_policy: Callable) -> None:
    crew, answers = crew_of(small_policy("MAGAT-F-16"), 1)
    assert not crew.see(0, observation(0, 5))
    assert "the primitive 5" in crew.exchange.last_drop
    assert not answers
