# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Deploying a policy to a team: all robots prepare it, then all switch, or none does. No ROS; time is passed in."""

import enum
from collections.abc import Sequence
from typing import NamedTuple


class Order(enum.IntEnum):
    """An order to all robots, as in `magat_interfaces/msg/Deployment`."""

    PREPARE = 0
    SWITCH = 1
    ROLL_BACK = 2


class RobotReport(NamedTuple):
    """A robot's last report about its policies, as in `magat_interfaces/msg/RobotStatus`."""

    deployment: int
    prepared: int
    refusal: str


class Deployment:
    """Decides on the orders to the robots, from their reports.

    It ends with all robots on the new policy and no `error`, or with all reachable robots on the policy from before. It
    waits at most ``patience`` for each robot. The last order also holds for a robot that returns later.
    """

    def __init__(self, number: int, robots: Sequence[str], now: float, patience: float) -> None:
        """Begin with `Order.PREPARE`.

        Args:
            number: the number of the deployment, not 0.
            robots: the names of all robots.
            now: seconds.
            patience: how long to wait for the robots after each order, seconds.
        """
        self.number = number
        self.order = Order.PREPARE
        self._error = ""
        self._robots, self._patience = list(robots), patience
        self._ordered = now
        self._reports: dict[str, RobotReport] = {}

    def reported(self, robots: Sequence[str], report: RobotReport) -> None:
        """Take the report of the process of ``robots``."""
        self._reports.update(dict.fromkeys(robots, report))

    @property
    def error(self) -> str:
        """Why the policy is not deployed; empty if nothing has failed."""
        lost = self._behind() if self.order is Order.ROLL_BACK else []
        return self._error + (f"; no answer to ROLL_BACK from {', '.join(lost)}" if lost else "")

    @property
    def done(self) -> int:
        """How many robots have followed the last order."""
        return len(self._robots) - len(self._behind())

    def advance(self, now: float) -> Order | None:
        """The next order, or None if it is not time for one."""
        behind, refusing = self._behind(), self._refusing()
        late = now - self._ordered > self._patience
        if self.order is Order.ROLL_BACK:
            return None
        if refusing:
            return self._roll_back(now, "; ".join(f"{name} refuses: {why}" for name, why in refusing.items()))
        if behind and late:
            return self._roll_back(now, f"no answer within {self._patience:g} s from {', '.join(behind)}")
        if not behind and self.order is Order.PREPARE:
            return self._give(Order.SWITCH, now)
        return None

    def ended(self, now: float) -> bool:
        """Whether the deployment has ended: all robots have followed the last order, or ROLL_BACK has timed out."""
        last = self.order is not Order.PREPARE and not self._behind()
        return last or (self.order is Order.ROLL_BACK and now - self._ordered > self._patience)

    def cancel(self, now: float) -> Order | None:
        """Roll back, unless that is under way; returns the order, if there is a new one."""
        return None if self.order is Order.ROLL_BACK else self._roll_back(now, "cancelled")

    def _behind(self) -> list[str]:
        """Robots that have not reported that they followed the last order."""
        return [name for name in self._robots if not self._follows(self._reports.get(name))]

    def _follows(self, report: RobotReport | None) -> bool:
        if report is None:
            return False
        if self.order is Order.PREPARE:
            return report.prepared == self.number and not report.refusal
        if self.order is Order.SWITCH:
            return report.deployment == self.number
        return report.deployment != self.number and report.prepared != self.number

    def _refusing(self) -> dict[str, str]:
        reports = ((name, self._reports[name]) for name in self._robots if name in self._reports)
        return {name: said.refusal for name, said in reports if said.prepared == self.number and said.refusal}

    def _roll_back(self, now: float, error: str) -> Order:
        self._error = error
        return self._give(Order.ROLL_BACK, now)

    def _give(self, order: Order, now: float) -> Order:
        self.order, self._ordered = order, now
        self._reports = {}  # only reports after the order count
        return order
