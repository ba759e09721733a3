# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The health of processes follows from their statuses."""

from types import SimpleNamespace

from magat_viewer.health import ProcessHealth, TeamHealth


def status(*robots: str, ticks: int = 5, **fields: object) -> SimpleNamespace:
    said = {"policy": "MAGAT-F-128", "digest": "abc", "encoding": "float32", "radio": "direct", "features_missing": 0}
    said |= {"messages_dropped": 0, "last_drop": "", "state": 1}
    return SimpleNamespace(robots=list(robots), ticks=ticks, **(said | fields))


def processes(health: TeamHealth, now: float = 10.0) -> dict[tuple[int, ...], ProcessHealth]:
    report = health.report(["alice", "bob", "carol"], [0, 2, 0], now)
    return {tuple(process.robots): process for process in report.processes}


def test_each_process_is_named_once_by_its_robots_numbers():
    health = TeamHealth()
    health.add_status(status("bob", "carol", digest="d1", features_missing=3), 8.0)
    health.add_status(status("alice", digest="d2"), 9.5)
    found = processes(health)
    assert found.keys() == {(0,), (1, 2)}
    assert (found[1, 2].digest, found[1, 2].age, found[1, 2].features_missing) == ("d1", 2.0, 3)
    assert (found[0,].digest, found[0,].running) == ("d2", True)


def test_only_robots_that_were_silent_are_late():
    assert TeamHealth().report(["alice", "bob"], [0, 2], 1.0).late == {1: 2}


def test_fewer_ticks_than_before_are_a_restart():
    health = TeamHealth()
    for ticks in (5, 9, 9, 0, 4, 4, 1):
        health.add_status(status("alice", ticks=ticks), 1.0)
    assert processes(health)[0,].restarts == 2


def test_other_crews_are_other_processes():
    health = TeamHealth()
    health.add_status(status("alice", "bob", ticks=9), 1.0)
    health.add_status(status("alice", ticks=0), 2.0)
    health.add_status(status("bob", ticks=0), 3.0)
    found = processes(health)
    assert found.keys() == {(0,), (1,)}
    assert [process.restarts for process in found.values()] == [0, 0]


def test_a_status_without_robots_is_ignored():
    health = TeamHealth()
    health.add_status(status(), 1.0)
    assert processes(health) == {}
    assert health.status_of("alice") is None
