# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A team of processes and the batched simulator walk the same paths, whatever the radio, the crews and the encoding."""

import collections
import json
import os
import shutil
import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from team_secret import SECRET

from magat_evaluation.cases import solved_cases
from magat_evaluation.planners import policy_planner, simulator_for
from magat_evaluation.splits import SPLITS
from magat_interfaces.msg import Observation, Preference
from magat_node import qos
from magat_robot.policy.store import load, save
from magat_sim.measures import EpisodeMeasures, expert_flowtime
from magat_sim.rollout import run
from magat_sim.simulator import DEFAULT_RULES, Rules

pytestmark = pytest.mark.system

CASES = list(SPLITS["test"][:5])


@dataclass(frozen=True)
class Walk:
    """A case as the batched simulator walks it."""

    paths: np.ndarray
    measures: EpisodeMeasures
    #: By tick: the log-probabilities of each robot's primitives, in some order, bit by bit.
    weighed: list[list[bytes]]


@pytest.fixture(scope="module")
def batched() -> Callable[..., list[Walk]]:
    """Walks cases, simulated together in one process."""
    made: dict[tuple, list[Walk]] = {}

    def walks(folder: Path, encoding: str = "float32", rules: Rules = DEFAULT_RULES, **size: int) -> list[Walk]:
        key = (folder, encoding, rules, *size.items())
        if key not in made:
            made[key] = walk(folder, encoding, rules, **size)
        return made[key]

    def walk(folder: Path, encoding: str, rules: Rules, **size: int) -> list[Walk]:
        policy = load(folder, encoding=encoding)
        solved = list(solved_cases(CASES, **size))
        simulator = simulator_for(solved, rules=rules, secret=SECRET)
        positions = [simulator.position.copy()]
        weighed: list[list[list[bytes]]] = [[] for _ in solved]

        decide_together = policy_planner(policy)(solved, simulator)

        def decide(seen):
            actions = decide_together(seen)
            world = simulator.world[simulator.active]
            for number in np.unique(world):
                weighed[number].append(sorted(row.tobytes() for row in actions.log_probabilities[world == number]))
            return actions

        run(simulator, decide, lambda after: positions.append(after.position.copy()))
        measures = simulator.measures([expert_flowtime(s.paths, s.case.goals) for s in solved])
        paths = np.stack(positions)
        return [Walk(paths[: m.ticks + 1, simulator.world == i], m, weighed[i]) for i, m in enumerate(measures)]

    return walks


def assert_same(outcome, walk: Walk, feature_bytes: int) -> None:
    np.testing.assert_array_equal(outcome.recording.positions, walk.paths)
    result, measures = outcome.result, walk.measures
    assert (result.silent, result.features_missing) == (0, 0)
    for name in ("success", "success_strict", "p_rg", "makespan", "t_max", "ticks", "moves_blocked"):
        assert getattr(result, name) == getattr(measures, name), name
    assert result.delta_ft == pytest.approx(measures.delta_ft, nan_ok=True)
    assert result.delta_ft_strict == pytest.approx(measures.delta_ft_strict, nan_ok=True)
    assert result.flowtime == measures.flowtime.first_visit
    assert result.bytes_per_tick == feature_bytes


def weighed_by(team, processes: int) -> dict[int, dict[int, list[bytes]]]:
    """By episode and tick, as `Walk.weighed`: what the robots of a team say from now on. Some of it may be lost."""
    weighed: dict[int, dict[int, list[bytes]]] = collections.defaultdict(lambda: collections.defaultdict(list))

    def note(preference: Preference) -> None:
        if preference.tick != Observation.HELLO:
            weighed[preference.episode][preference.tick].append(preference.log_probabilities.tobytes())

    subscription = team.client.node.create_subscription(Preference, "/preference", note, qos.newest(4096))
    assert team.client.spin(lambda: subscription.get_publisher_count() >= processes, 20.0), (
        subscription.get_publisher_count()
    )
    return weighed


@pytest.mark.parametrize("index", range(len(CASES)))
def test_ten_processes_walk_the_paths_of_the_batched_simulator(team, batched, policy_folder, index):
    outcome = team.run_undisturbed(team.goal(CASES[index]))
    assert_same(outcome, batched(policy_folder)[index], feature_bytes=548)


@pytest.mark.parametrize("index", range(2))
def test_so_do_ten_that_hear_each_other_through_the_simulator(relayed_team, batched, policy_folder, index):
    outcome = relayed_team.run_undisturbed(relayed_team.goal(CASES[index]))
    assert_same(outcome, batched(policy_folder)[index], feature_bytes=548)


@pytest.mark.parametrize("radio", ["direct", pytest.param("relayed", marks=pytest.mark.faults)])
def test_so_do_robots_that_miss_a_third_of_what_is_said(start_team, batched, policy_folder, radio):
    rules = Rules(link_loss=0.3)
    walks = batched(policy_folder, rules=rules)
    assert walks[0].weighed != batched(policy_folder)[0].weighed
    with start_team(10, radio=radio, crew=5, link_loss=rules.link_loss) as team:
        for index in range(2):
            assert_same(team.run_undisturbed(team.goal(CASES[index])), walks[index], feature_bytes=548)


def test_so_do_robots_that_remember_their_visits(start_team, batched, policy_folder, tmp_path):
    folder = shutil.copytree(policy_folder, tmp_path / "policy")
    config = json.loads((folder / "config.json").read_text())
    config["policy"]["visit_memory"] = 1.5
    (folder / "config.json").write_text(json.dumps(config))
    size = {"width": 14, "height": 14}
    walks, others = (batched(which, robots=20, **size) for which in (folder, policy_folder))
    assert all(walk.paths.tolist() != other.paths.tolist() for walk, other in zip(walks[:2], others[:2], strict=True))
    with start_team(20, policy=folder, crew=10) as team:
        for index in range(2):
            assert_same(team.run_undisturbed(team.goal(CASES[index], **size)), walks[index], feature_bytes=548)


@pytest.mark.parametrize("shield", ["pibt", "pibt-memory"])
def test_so_do_robots_that_push_each_other_aside(start_team, batched, policy_folder, shield):
    size = {"width": 14, "height": 14}
    rules = Rules(shield=shield)
    walks = batched(policy_folder, rules=rules, robots=20, **size)
    others = batched(policy_folder, robots=20, **size)
    assert any(walk.paths.tolist() != other.paths.tolist() for walk, other in zip(walks[:2], others[:2], strict=True))
    with start_team(20, crew=10, shield=rules.shield) as team:
        for index in range(2):
            assert_same(team.run_undisturbed(team.goal(CASES[index], **size)), walks[index], feature_bytes=548)


@pytest.mark.parametrize(
    ("radio", "crew", "encoding", "feature_bytes"),
    [("direct", 5, "float16", 292), ("relayed", 10, "int8", 168)],
    ids=["two crews of five, float16", "one crew, int8, relayed"],
)
def test_so_do_robots_that_share_a_process(start_team, batched, policy_folder, radio, crew, encoding, feature_bytes):
    walks = batched(policy_folder, encoding)
    # float16 holds every number of a message; in 8 bits they are others, though hardly so far that a path changes.
    assert (walks[0].weighed != batched(policy_folder)[0].weighed) == (encoding == "int8")
    with start_team(10, radio=radio, crew=crew, encoding=encoding) as team:
        weighed = weighed_by(team, 10 // crew)
        for index in range(2):
            outcome = team.run_undisturbed(team.goal(CASES[index]))
            assert_same(outcome, walks[index], feature_bytes)
            said = weighed[outcome.result.episode]
            assert sum(map(len, said.values())) > 0.9 * 10 * outcome.result.ticks
            for tick, rows in said.items():
                assert not collections.Counter(rows) - collections.Counter(walks[index].weighed[tick])
        assert len(team.processes.pids("robots")) == 10 // crew
        statuses = team.statuses()
    assert len(statuses) == 10
    for name, status in statuses.items():
        first = int(name.removeprefix("robot_")) // crew * crew
        assert status.robots == [f"robot_{i}" for i in range(first, first + crew)]
        assert (status.encoding, status.radio) == (encoding, radio)
        assert status.ticks >= crew * sum(walk.measures.ticks for walk in walks[:2])
        assert status.peers_heard >= crew - 1
        assert (status.messages_dropped, status.last_drop) == (0, "")


@pytest.mark.faults
def test_so_do_crews_whose_messages_travel_several_hops_and_one_that_dies_takes_nobody_with_it(
    start_team, batched, random_network, tmp_path
):
    policy = tmp_path / "policy"
    save(random_network("MAGAT-F-16-P2", taps=3, layers=2), policy, "")
    size = {"width": 14, "height": 14}
    walks = batched(policy, "float16", robots=6, **size)
    with start_team(
        6, policy=policy, radio="relayed", crew=2, encoding="float16", backend="torch", respawn=False
    ) as team:
        for index in range(2):
            outcome = team.run_undisturbed(team.goal(CASES[index], **size))
            # Four rounds: x, x and the aggregates of two heads; then the same for layer two, whose x has two heads.
            assert_same(outcome, walks[index], feature_bytes=4 * 36 + 2 * (16 + 3 * 16 + 32 + 3 * 32))
        victims = []

        def kill_at_tick_three(feedback):
            if feedback.tick == 3 and not victims:
                victims.append(team.processes.pids("robots")[0])
                os.kill(victims[0], signal.SIGKILL)

        outcome = team.run(team.goal(CASES[0], t_max=40, **size), kill_at_tick_three)
        assert len(team.processes.pids("robots")) == 2
    recording, ticks = outcome.recording, outcome.result.ticks
    silent = [set(np.flatnonzero(recording.worlds[tick].silent).tolist()) for tick in range(8, ticks + 1)]
    dead = silent[0]
    assert dead in ({0, 1}, {2, 3}, {4, 5})
    assert all(dead <= now for now in silent)
    # On a busy machine a message may be late.
    assert sum(now == dead for now in silent) > 0.5 * len(silent)
    assert (recording.positions[8:, sorted(dead)] == recording.positions[8, sorted(dead)]).all()
    # What the dead would say is not waited for, and missed by nobody.
    assert outcome.result.features_missing < 150
    assert outcome.result.ticks_per_second > 2


def test_another_seed_walks_other_paths(team, batched, policy_folder):
    case = next(iter(solved_cases(CASES[:1]))).case
    goal = team.goal(CASES[0], seed=1, obstacles=case.obstacles.astype(np.uint8).ravel().tolist())
    goal.start_x, goal.start_y = case.starts[:, 0].tolist(), case.starts[:, 1].tolist()
    goal.goal_x, goal.goal_y = case.goals[:, 0].tolist(), case.goals[:, 1].tolist()
    positions = team.run(goal).recording.positions
    walked = batched(policy_folder)[0].paths
    np.testing.assert_array_equal(positions[0], walked[0])
    shorter = min(len(positions), len(walked))
    assert (positions[:shorter] != walked[:shorter]).any()
