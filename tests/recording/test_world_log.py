# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""World messages are kept by episode, and those that make no sense are refused."""

from types import SimpleNamespace

import numpy as np
import pytest

from magat_node.errors import UnusableMessageError
from magat_node.status_check import LONGEST_TEXT, status_fault
from magat_recording.world_check import MOST_CELLS, fault
from magat_recording.world_log import WorldLog, WorldLogs


def world(tick: int = 0, episode: int = 7, **fields: object) -> SimpleNamespace:
    values = {
        "robots": ["alice", "bob"], "width": 3, "height": 2, "obstacles": b"" if tick else bytes(6), "x": [0, tick % 3],
        "y": [0, 1], "goal_x": [2, 0], "goal_y": [1, 1], "action": bytes(2), "moved": bytes(2),
        "silent": [False] * 2, "missing": [0, 0], "visited": [False] * 2, "t_max": 30, "links": 0,
    }  # fmt: skip
    return SimpleNamespace(episode=episode, tick=tick, **values | fields)


def test_episodes_of_strangers_do_not_disturb_the_own():
    logs = WorldLogs()
    for tick in range(4):
        logs.add(world(tick))
        logs.add(world(0, episode=100 + tick, robots=["eve", "mallory"]))
    assert logs.of(7).complete
    np.testing.assert_array_equal(logs.of(7).positions[:, 1, 0], [0, 1, 2, 0])
    logs.clear()
    assert logs.of(7).worlds == {}


def test_an_episode_that_was_not_seen_from_its_start_is_not_kept():
    logs = WorldLogs()
    logs.add(world(3))
    assert logs.of(7).worlds == {}


def test_the_number_of_episodes_is_bounded_and_the_running_one_stays():
    logs = WorldLogs()
    for number in range(1000):
        logs.add(world(0, episode=1000 + number))
        logs.add(world(number % 30))
    assert len(logs._logs) == 64
    assert len(logs.of(7).worlds) == 30


@pytest.mark.parametrize(
    "fields",
    [
        {"robots": [], "x": [], "y": [], "goal_x": [], "goal_y": [], "action": b"", "moved": b"", "silent": [],
         "missing": [], "visited": []},
        {"robots": ["alice", "alice"]},
        {"robots": ["alice", "no name"]},
        {"robots": ["alice", "/../x"]},
        {"robots": ["alice", ""]},
        {"robots": ["alice", "b" * 100_000]},
        {"width": 65535, "height": 65535, "obstacles": b""},
        {"x": [0]},
        {"y": [0, 2]},
    ],
)  # fmt: skip
def test_a_world_that_cannot_be_used_is_refused(fields):
    logs = WorldLogs()
    with pytest.raises(UnusableMessageError) as refused:
        logs.add(world(**fields))
    assert len(str(refused.value)) < 300
    assert logs.of(7).worlds == {}


@pytest.mark.parametrize(
    "fields", [{"robots": ["alice", "carol"]}, {"goal_x": [2, 1]}, {"width": 4}, {"t_max": 31}, {"tick": 31}]
)
def test_an_episode_stays_what_it_was_at_its_start(fields):
    log = WorldLog(7)
    log.add(world(0))
    log.add(world(1))
    with pytest.raises(UnusableMessageError, match="not those of its episode"):
        log.add(world(**{"tick": 2} | fields))
    log.add(world(1, x=[1, 1]))  # repeated: the first one counts
    np.testing.assert_array_equal(log.positions[:, :, 0], [[0, 0], [0, 1]])


def test_a_map_may_be_as_large_as_one_that_is_shown():
    assert fault(world(5, width=4096, height=MOST_CELLS // 4096)) is None


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"robots": []}, "no robots"),
        ({"robots": ["no name"]}, "'no name'"),
        ({"last_drop": "x" * (LONGEST_TEXT + 1)}, "last_drop has 1001 characters"),
        ({"policy": "x" * 100_000}, "policy has 100000 characters"),
    ],
)
def test_a_status_that_cannot_be_used_is_named(fields, said):
    texts = dict.fromkeys(("policy", "digest", "encoding", "radio", "refusal", "last_drop"), "")
    assert status_fault(SimpleNamespace(robots=["alice"], **texts)) is None
    assert said in status_fault(SimpleNamespace(**{"robots": ["alice"]} | texts | fields))
