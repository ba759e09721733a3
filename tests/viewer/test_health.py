"""How processes are is what they said last, and what follows from it."""

from types import SimpleNamespace

from magat_viewer.health import Health


def status(*robots: str, ticks: int = 5, **fields: object) -> SimpleNamespace:
    said = {"policy": "MAGAT-F-128", "digest": "abc", "encoding": "float32", "radio": "direct", "features_missing": 0}
    said |= {"messages_dropped": 0, "last_drop": "", "state": 1}
    return SimpleNamespace(robots=list(robots), ticks=ticks, **(said | fields))


def processes(health: Health, now: float = 10.0) -> dict[tuple[int, ...], dict]:
    report = health.report(["alice", "bob", "carol"], [0, 2, 0], now)
    return {tuple(process["robots"]): process for process in report["processes"]}


def test_each_process_is_named_once_by_its_robots_numbers():
    health = Health()
    health.reported(status("bob", "carol", digest="d1", features_missing=3), 8.0)
    health.reported(status("alice", digest="d2"), 9.5)
    found = processes(health)
    assert found.keys() == {(0,), (1, 2)}
    assert (found[1, 2]["digest"], found[1, 2]["age"], found[1, 2]["features_missing"]) == ("d1", 2.0, 3)
    assert (found[0,]["digest"], found[0,]["running"]) == ("d2", True)


def test_who_was_late_is_told_and_nobody_else():
    assert Health().report(["alice", "bob"], [0, 2], 1.0)["late"] == {"1": 2}


def test_who_has_answered_less_often_than_before_was_started_again():
    health = Health()
    for ticks in (5, 9, 9, 0, 4, 4, 1):
        health.reported(status("alice", ticks=ticks), 1.0)
    assert processes(health)[0,]["restarts"] == 2


def test_robots_that_share_processes_in_another_way_are_other_processes():
    health = Health()
    health.reported(status("alice", "bob", ticks=9), 1.0)
    health.reported(status("alice", ticks=0), 2.0)
    health.reported(status("bob", ticks=0), 3.0)
    found = processes(health)
    assert found.keys() == {(0,), (1,)}
    assert [process["restarts"] for process in found.values()] == [0, 0]


def test_a_status_of_nobody_is_nobodys():
    health = Health()
    health.reported(status(), 1.0)
    assert processes(health) == {}
    assert health.status_of("alice") is None
