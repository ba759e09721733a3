# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Browsers get what the World messages say, and an episode has the measures of the simulator."""

import math
import struct

import numpy as np
import pytest

from magat_sim.measures import Flowtime
from magat_viewer.watched_episode import WatchedEpisode


def seen(worlds) -> WatchedEpisode:
    state = WatchedEpisode(7, worlds[0])
    for world in worlds[1:]:
        state.step(world)
    return state


@pytest.mark.parametrize("robots", [1, 4, 5])
def test_a_frame_holds_the_world(walk, robots):
    worlds = walk(robots).worlds
    worlds[-1].silent[0] = True
    state, last = seen(worlds), worlds[-1]
    data = state.frame()
    assert len(data) == 32 + 4 * -(-5 * robots // 4)
    number, tick, on_goal, visited, blocked, silent, links, seconds = struct.unpack_from("<7If", data)
    assert (number, tick, links, silent, visited) == (7, 12, 4, 1, sum(last.visited))
    assert seconds == pytest.approx(0.02)
    assert on_goal == sum(map(lambda x, y, *goal: [x, y] == goal, last.x, last.y, last.goal_x, last.goal_y))
    body = data[32:]
    assert np.frombuffer(body, "<i2", robots).tolist() == last.x
    assert np.frombuffer(body, "<i2", robots, 2 * robots).tolist() == last.y
    flags = np.frombuffer(body, np.uint8, robots, 4 * robots)
    assert (flags & 7).tolist() == list(last.action)
    assert (flags >> 3 & 7).tolist() == list(last.moved)
    assert (flags >> 6 & 1).astype(bool).tolist() == last.silent
    assert (flags >> 7).astype(bool).tolist() == last.visited
    held_back = sum(w != 0 and w != m for world in worlds[1:] for w, m in zip(world.action, world.moved, strict=True))
    assert blocked == held_back


def test_the_scene_is_the_case(walk):
    made = walk()
    scene = seen(made.worlds).scene()
    assert (scene.width, scene.height, scene.t_max, scene.episode) == (7, 8, 12, 7)
    assert scene.goals == made.case.goals.tolist()
    grid = np.array(list(scene.obstacles), dtype=int).reshape(8, 7)
    assert (grid == made.case.obstacles).all()
    assert scene.robots == [f"r_{i}" for i in range(5)]


@pytest.mark.parametrize("seed", range(6))
def test_the_measures_are_the_simulators(walk, seed):
    made = walk(robots=2, ticks=40, seed=seed, side=3)
    [expected] = made.simulator.measures([Flowtime(20, 21)])
    state = seen(made.worlds)
    assert state.measures == expected
    assert state.result().measures.delta_ft == expected.delta_ft
    assert state.result().ticks == expected.ticks


def test_an_episode_that_runs_or_was_seen_in_part_has_no_measures(walk):
    worlds = walk().worlds
    assert seen(worlds[:-1]).measures is None
    assert seen(worlds[1:]).measures is None
    assert seen([*worlds[:4], *worlds[5:]]).measures is None
    assert seen(worlds[1:]).obstacles is None
    assert seen(worlds[1:]).scene().obstacles is None


def test_a_world_that_comes_twice_or_late_counts_once(walk):
    worlds = walk().worlds
    assert seen([*worlds[:5], worlds[2], *worlds[4:]]).frame() == seen(worlds).frame()
    assert seen([*worlds[:5], worlds[4], *worlds[5:]]).measures == seen(worlds).measures


def test_without_an_experts_solution_there_is_no_delta(walk):
    worlds = walk().worlds
    for world in worlds:
        world.expert_flowtime = -1
    assert math.isnan(seen(worlds).result().measures.delta_ft)
