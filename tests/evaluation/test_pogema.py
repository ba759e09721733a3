# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""POGEMA's world and ours: the same sights, the same decisions, and the same ways where the rules agree."""

import json
import sys
from collections.abc import Callable

import numpy as np
import pytest

from magat_cli.main import main
from magat_evaluation.cases import solved_cases
from magat_evaluation.planners import evaluate, policy_planner, simulator_for
from magat_evaluation.pogema.world import PogemaPolicy, environment, score, world_of
from magat_evaluation.splits import SET_SEED, SPLITS
from magat_robot.policy.models import find_policy
from magat_robot.policy.store import load
from magat_sim.case import draw_case
from magat_sim.grid import DELTAS, IntArray
from magat_sim.simulator import Actions, Simulator

SIZE = {"width": 14, "height": 11, "robots": 12, "density": 0.15}


@pytest.fixture
def pogema() -> None:
    """POGEMA is an extra, see requirements-pogema.txt."""
    pytest.importorskip("pogema", reason="pogema is not installed: see requirements-pogema.txt")


def contested(simulator: Simulator, actions: IntArray) -> bool:
    """Two robots want one cell: there, a drawn one gets it here, and one by its number in POGEMA."""
    targets = (simulator.position + DELTAS[actions]).tolist()
    return len(set(map(tuple, targets))) < len(targets)


@pytest.mark.usefixtures("pogema")
def test_worlds_are_alike() -> None:
    case = draw_case(1, 3, **SIZE)
    observations, _ = environment(case, 9).reset()
    obstacles, position, goal = world_of(observations)
    assert obstacles.tolist() == case.obstacles.tolist()
    assert (position.tolist(), goal.tolist()) == (case.starts.tolist(), case.goals.tolist())


@pytest.mark.usefixtures("pogema")
@pytest.mark.parametrize("visit_memory", [0.0, 1.5])
def test_a_team_sees_decides_and_walks_as_here_until_two_want_one_cell(visit_memory: float) -> None:
    policy, steps = load(find_policy("MAGAT-F-128"), visit_memory=visit_memory), 0
    for one in solved_cases(range(6), **SIZE):
        simulator, world = simulator_for([one]), environment(one.case, one.t_max)
        decide, team = policy_planner(policy)([one], simulator), PogemaPolicy(policy, SET_SEED, one.number)
        observations, _ = world.reset()
        while not simulator.done:
            wishes = decide(simulator.observe())
            assert isinstance(wishes, Actions)
            assert team.act(observations) == list(wishes.primitives)
            if contested(simulator, np.asarray(wishes.primitives)):
                break
            simulator.step(wishes)
            observations, *_ = world.step(list(wishes.primitives))
            assert world_of(observations)[1].tolist() == simulator.position.tolist()
            steps += 1
    assert steps > 30


@pytest.mark.usefixtures("pogema")
@pytest.mark.parametrize("seed", range(8))
def test_whatever_robots_want_they_walk_as_here_where_no_two_want_one_cell(seed: int) -> None:
    rng = np.random.default_rng(seed)
    (one,) = solved_cases([seed], **SIZE)
    simulator, world = simulator_for([one]), environment(one.case, one.t_max)
    world.reset()
    moved, kept = 0, 0
    while not simulator.done:
        actions = rng.integers(5, size=len(simulator.position))
        while contested(simulator, actions):
            actions[rng.integers(len(actions))] = rng.integers(5)
        step = simulator.step(actions)
        observations, *_ = world.step(actions.tolist())
        assert world_of(observations)[1].tolist() == simulator.position.tolist()
        moved, kept = moved + int((step.moved > 0).sum()), kept + int(step.blocked.sum())
    assert min(moved, kept) > 20, "walls and swaps, too"


@pytest.mark.usefixtures("pogema")
def test_the_score_is_about_that_of_the_batched_simulator() -> None:
    policy, solved = load(find_policy("MAGAT-F-128")), list(solved_cases(range(30, 36), **SIZE))
    cases: list[int] = []
    metrics = score(policy, solved, on_case=lambda: cases.append(1))
    assert len(metrics) == len(cases) == len(solved)
    here = evaluate(policy, solved)
    assert abs(sum(one["CSR"] for one in metrics) - sum(one.success_strict for one in here)) <= 1
    # Where nobody ever wants another's cell, both count the same.
    alone = list(solved_cases(range(5), **SIZE | {"robots": 1}))
    assert [one["makespan"] for one in score(policy, alone)] == [one.makespan for one in evaluate(policy, alone)]


@pytest.mark.usefixtures("pogema")
def test_the_command_prints_the_means(capfd: pytest.CaptureFixture) -> None:
    size = ["--width", "14", "--height", "11", "--robots", "4"]
    assert main(["pogema", "--cases", "5", "--json", *size]) == 0
    report = json.loads(capfd.readouterr().out)
    solved = list(solved_cases(SPLITS["test"][:5], width=14, height=11, robots=4, density=0.1))
    metrics = score(load(find_policy("MAGAT-F-128")), solved)
    for name in ("CSR", "ISR", "SoC", "makespan"):
        assert report[name] == pytest.approx(np.mean([one[name] for one in metrics])), name
    assert (report["cases"], report["robots"], report["first_case"]) == (5, 4, SPLITS["test"].start)


def test_without_pogema_the_command_says_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture
) -> None:
    monkeypatch.setitem(sys.modules, "pogema", None)
    assert main(["pogema", "--cases", "1"]) == 1
    assert "requirements-pogema.txt" in capfd.readouterr().err


def test_observations_that_do_not_say_where_robots_are_are_refused(random_network: Callable) -> None:
    from magat_robot.policy.policy import Policy

    team = PogemaPolicy(Policy(random_network("MAGAT-F-16")))
    for wrong in ([], [{"obstacles": np.zeros((9, 9)), "xy": (0, 0)}], [np.zeros((3, 9, 9))]):
        with pytest.raises(ValueError, match="observation_type='MAPF'"):
            team.act(wrong)
