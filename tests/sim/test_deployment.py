# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A team switches as one: all robots to the new policy, or none, whatever happens in between."""

import pytest

from magat_sim.deployment import Deployment, Order, RobotReport

NUMBER = 5
BEFORE = RobotReport(0, 0, "")
PREPARED = RobotReport(0, NUMBER, "")
REFUSED = RobotReport(0, NUMBER, "it is too long")
SWITCHED = RobotReport(NUMBER, NUMBER, "")


@pytest.fixture
def deployment() -> Deployment:
    return Deployment(NUMBER, ["a", "b", "c"], now=100.0, patience=10.0)


def report(deployment: Deployment, **said: RobotReport) -> None:
    for name, what in said.items():
        deployment.reported([name], what)


def test_all_prepare_then_all_switch(deployment):
    assert deployment.order is Order.PREPARE
    report(deployment, a=PREPARED, b=BEFORE, c=PREPARED)
    assert (deployment.done, deployment.advance(101.0)) == (2, None)
    report(deployment, b=PREPARED)
    assert deployment.advance(102.0) is Order.SWITCH
    assert deployment.done == 0
    report(deployment, a=SWITCHED, b=PREPARED, c=SWITCHED)
    assert deployment.advance(103.0) is None
    assert not deployment.ended(103.0)
    report(deployment, b=SWITCHED)
    assert deployment.ended(104.0)
    assert deployment.error == ""


def test_one_report_may_be_of_several_robots(deployment):
    deployment.reported(["a", "b", "c", "a stranger"], PREPARED)
    assert deployment.advance(101.0) is Order.SWITCH


def test_strangers_do_not_count(deployment):
    report(deployment, a=PREPARED, b=PREPARED, d=PREPARED, e=REFUSED)
    assert (deployment.done, deployment.advance(101.0)) == (2, None)


def test_after_one_refusal_no_robot_switches(deployment):
    report(deployment, a=PREPARED, b=REFUSED)
    assert deployment.advance(101.0) is Order.ROLL_BACK
    assert not deployment.ended(101.0)
    report(deployment, a=PREPARED, b=BEFORE, c=BEFORE)
    assert deployment.done == 2, "a still has it"
    assert deployment.advance(102.0) is None
    report(deployment, a=BEFORE)
    assert deployment.ended(102.0)
    assert deployment.error == "b refuses: it is too long"


def test_a_robot_that_does_not_prepare_in_time_keeps_all_from_switching(deployment):
    report(deployment, a=PREPARED)
    assert deployment.advance(110.0) is None
    assert deployment.advance(110.1) is Order.ROLL_BACK
    report(deployment, a=BEFORE)
    assert not deployment.ended(120.0)
    assert deployment.ended(120.2), "the wait for a missing robot ends"
    assert deployment.error == (
        "no answer within 10 s from b, c; no answer to ROLL_BACK from b, c"
    )  # fmt: skip


def test_a_robot_that_does_not_switch_in_time_rolls_all_back(deployment):
    report(deployment, a=PREPARED, b=PREPARED, c=PREPARED)
    assert deployment.advance(105.0) is Order.SWITCH
    report(deployment, a=SWITCHED, b=SWITCHED)
    assert deployment.advance(115.0) is None, "each order has its time"
    assert deployment.advance(115.1) is Order.ROLL_BACK
    report(deployment, a=BEFORE, b=BEFORE, c=BEFORE)
    assert deployment.ended(115.2)
    assert "from c" in deployment.error


def test_a_robot_that_was_killed_and_returns_in_time_does_not_stop_it(deployment):
    report(deployment, a=PREPARED, b=PREPARED, c=PREPARED)
    assert deployment.advance(101.0) is Order.SWITCH
    report(deployment, a=SWITCHED, b=SWITCHED, c=BEFORE)
    assert deployment.advance(102.0) is None
    report(deployment, c=SWITCHED)
    assert deployment.ended(103.0)
    assert deployment.error == ""


def test_one_that_comes_back_and_refuses_takes_all_back(deployment):
    report(deployment, a=PREPARED, b=PREPARED, c=PREPARED)
    assert deployment.advance(101.0) is Order.SWITCH
    report(deployment, a=SWITCHED, b=SWITCHED, c=REFUSED)
    assert deployment.advance(102.0) is Order.ROLL_BACK


def test_what_was_said_before_an_order_does_not_count_after_it(deployment):
    report(deployment, a=SWITCHED, b=SWITCHED, c=SWITCHED)
    assert deployment.advance(101.0) is Order.SWITCH
    assert not deployment.ended(101.0)


@pytest.mark.parametrize("switching", [False, True])
def test_it_can_be_cancelled_once(deployment, switching):
    if switching:
        report(deployment, a=PREPARED, b=PREPARED, c=PREPARED)
        deployment.advance(101.0)
    assert deployment.cancel(102.0) is Order.ROLL_BACK
    assert deployment.cancel(102.0) is None
    report(deployment, a=BEFORE, b=BEFORE, c=BEFORE)
    assert deployment.ended(102.0)
    assert deployment.error == "cancelled"
