# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which robots take part: those that are ready, not those that became silent, and again those that answer."""

import pytest

from magat_sim.team import FRESH, SILENT_TICKS, Equipment, Team

EQUIPMENT = Equipment("digest" * 4, "float32", "direct", 1)


@pytest.fixture
def team() -> Team:
    return Team(["a", "b", "c"], [11, 22, 33], peers=2)


def make_ready(team: Team, name: str, now: float, peers: int = 2) -> None:
    team.by_name[name].answered(now)
    team.by_name[name].reported(now, peers, EQUIPMENT)


def test_a_robot_joins_when_it_answers_reports_and_hears_all_others(team):
    assert team.gather(0.0) == ["a", "b", "c"]
    make_ready(team, "a", 10.0)
    make_ready(team, "b", 10.0, peers=1)
    team.by_name["c"].answered(10.0)
    assert team.gather(10.1) == ["b", "c"]
    make_ready(team, "b", 10.2)
    make_ready(team, "c", 10.2)
    assert team.gather(10.3) == []


def test_what_is_stale_does_not_count(team):
    make_ready(team, "a", 10.0)
    assert team.gather(10.0 + FRESH) == ["a", "b", "c"]
    team.by_name["a"].answered(20.0)
    assert "a" in team.gather(20.0), "its status is ten seconds old"


def test_robots_that_need_not_hear_each_other_join_without(team):
    """Where the simulator relays, it is the only one that listens."""
    relayed = Team(["a", "b"], [1, 2], peers=0)
    make_ready(relayed, "a", 0.0, peers=0)
    assert relayed.gather(0.1) == ["b"], "it must answer and report all the same"
    relayed.by_name["b"].reported(0.0, 0, EQUIPMENT)
    assert relayed.gather(0.1) == ["b"]
    relayed.by_name["b"].answered(0.0)
    assert relayed.gather(0.1) == []


def test_a_robot_of_one_is_a_team(team):
    alone = Team(["a"], [1], peers=0)
    make_ready(alone, "a", 0.0, peers=0)
    assert alone.gather(0.1) == []


def test_silence_ends_and_an_answer_begins_taking_part(team):
    for name in "abc":
        make_ready(team, name, 0.0)
    assert team.gather(0.0) == []
    for _ in range(SILENT_TICKS - 1):
        assert team.account([True, False, True]) == []
    assert team.account([True, True, True]) == [], "one answer in between starts the count anew"
    lost = [team.account([True, False, True]) for _ in range(SILENT_TICKS)]
    assert lost == [[]] * (SILENT_TICKS - 1) + [["b"]]
    assert team.account([True, False, True]) == [], "it is reported once"
    assert team.readmit(0.1) == [], "what it answered before does not count"
    team.by_name["b"].answered(5.0)
    assert team.readmit(5.1) == [], "what it carries is not known"
    team.by_name["b"].reported(5.1, 2, EQUIPMENT)
    assert team.readmit(5.2) == ["b"]
    assert team.account([True, False, True]) == []


def test_a_robot_that_returns_with_other_equipment_takes_no_part(team):
    for name in "abc":
        make_ready(team, name, 0.0)
    assert team.gather(0.0) == []
    assert team.strangers() == []
    other = EQUIPMENT._replace(digest="another")
    # So quickly that it missed no tick.
    team.by_name["b"].reported(1.0, 2, other)
    assert team.account([True, True, True]) == ["b"]
    for now in (1.0, 2.0):
        team.by_name["b"].answered(now)
        team.by_name["b"].reported(now, 2, other)
        assert team.strangers() == ["b"]
        assert team.readmit(now) == []
    team.by_name["b"].reported(3.0, 2, EQUIPMENT)
    assert team.strangers() == []
    assert team.readmit(2.5) == ["b"]


def test_a_team_of_which_all_are_absent_can_come_back(team):
    for name in "abc":
        make_ready(team, name, 0.0)
    assert team.gather(0.0) == []
    for _ in range(SILENT_TICKS):
        team.account([False, False, False])
    for name in "abc":
        make_ready(team, name, 9.0)
    assert team.readmit(9.0) == ["a", "b", "c"]


def test_robots_of_one_equipment_fit_together(team):
    assert team.mismatch("direct") is None, "no robot has reported yet"
    for name in "abc":
        make_ready(team, name, 0.0)
    assert team.mismatch("direct") is None


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("digest", "0123456789abcdef", "policy 0123456789ab"),
        ("encoding", "int8", "int8"),
        ("radio", "relayed", "relayed radio"),
    ],
)
def test_robots_that_differ_are_named_with_what_they_carry(team, field, value, told):
    for name in "abc":
        make_ready(team, name, 0.0)
    team.by_name["b"].reported(0.0, 2, EQUIPMENT._replace(**{field: value}))
    told_of = team.mismatch("direct")
    assert "a, c: policy digestdigest, float32, direct radio" in told_of
    assert f"b: policy {value[:12] if field == 'digest' else 'digestdigest'}" in told_of
    assert told in told_of
    make_ready(team, "b", 1.0)
    assert team.mismatch("direct") is None, "it has been started anew"


def test_robots_that_fit_together_may_not_fit_the_simulator(team):
    for name in "abc":
        make_ready(team, name, 0.0)
    told_of = team.mismatch("relayed")
    assert "the simulator's radio is relayed" in told_of
    assert "a, b, c: policy digestdigest, float32, direct radio" in told_of


@pytest.mark.parametrize("names", [[], ["a", "a"]])
def test_a_team_without_names_or_with_one_twice_is_refused(names):
    with pytest.raises(ValueError, match="name at least one robot, and none twice"):
        Team(names, list(range(len(names))), peers=1)
