"""A team of processes and the batched simulator walk the same paths."""

import numpy as np
import pytest

from magat_robot.policy.store import load
from magat_sim.measures import expert_flowtime
from magat_sim.rollout import run
from magat_training.cases import SPLITS, solved_cases
from magat_training.evaluate import simulator_for

pytestmark = pytest.mark.system

CASES = list(SPLITS["test"][:5])


@pytest.fixture(scope="module")
def batched(policy_folder):
    """Paths and measures of the five cases, simulated together in one process."""
    policy = load(policy_folder)
    solved = list(solved_cases(CASES))
    simulator = simulator_for(solved)
    positions = [simulator.position.copy()]

    def decide(o):
        return policy.decide_together(o.field_of_view, o.heard, o.streams, o.tick).primitives

    run(simulator, decide, lambda after: positions.append(after.position.copy()))
    measures = simulator.measures([expert_flowtime(s.paths, s.case.goals) for s in solved])
    paths = np.stack(positions)
    return [paths[: m.ticks + 1, simulator.world == i] for i, m in enumerate(measures)], measures


@pytest.mark.parametrize("index", range(len(CASES)))
def test_ten_processes_walk_the_paths_of_the_batched_simulator(team, batched, index):
    paths, measures = batched[0][index], batched[1][index]
    outcome = team.run(team.goal(CASES[index]))
    np.testing.assert_array_equal(outcome.recording.positions, paths)
    result = outcome.result
    assert (result.silent, result.features_missing) == (0, 0)
    for name in ("success", "success_strict", "p_rg", "makespan", "t_max", "ticks", "moves_blocked"):
        assert getattr(result, name) == getattr(measures, name), name
    assert result.delta_ft == pytest.approx(measures.delta_ft)
    assert result.delta_ft_strict == pytest.approx(measures.delta_ft_strict)
    assert result.flowtime == measures.flowtime.first_visit
    assert result.bytes_per_tick >= 4 * 128


def test_another_seed_walks_other_paths(team, batched):
    case = next(iter(solved_cases(CASES[:1]))).case
    goal = team.goal(CASES[0], seed=1, obstacles=case.obstacles.astype(np.uint8).ravel().tolist())
    goal.start_x, goal.start_y = case.starts[:, 0].tolist(), case.starts[:, 1].tolist()
    goal.goal_x, goal.goal_y = case.goals[:, 0].tolist(), case.goals[:, 1].tolist()
    positions = team.run(goal).recording.positions
    np.testing.assert_array_equal(positions[0], batched[0][0][0])
    shorter = min(len(positions), len(batched[0][0]))
    assert (positions[:shorter] != batched[0][0][:shorter]).any()
