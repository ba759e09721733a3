"""A policy on its way to a team: every robot prepares it, then all switch, or none does. No ROS; time is passed in."""

import enum
from collections.abc import Sequence
from typing import NamedTuple


class Order(enum.IntEnum):
    """What all robots are told, as in `magat_interfaces/msg/Deployment`."""

    PREPARE = 0
    SWITCH = 1
    ROLL_BACK = 2


class RobotReport(NamedTuple):
    """What a robot last said of its policies, as in `magat_interfaces/msg/RobotStatus`."""

    deployment: int
    prepared: int
    refusal: str


class Deployment:
    """Decides what robots are told, from what they say.

    It ends with all robots on the new policy and no `error`, or with all that can be reached on what they carried
    before. A robot that cannot be reached is not waited for beyond ``patience``; the last order holds for it, too, when
    it comes back.
    """

    def __init__(self, number: int, robots: Sequence[str], now: float, patience: float) -> None:
        """Begin with `Order.PREPARE`.

        Args:
            number: of the deployment, not 0.
            robots: all names.
            now: seconds.
            patience: wait so long for the robots after each order, seconds.
        """
        self.number = number
        self.order = Order.PREPARE
        self._error = ""
        self._robots, self._patience = list(robots), patience
        self._ordered = now
        self._reports: dict[str, RobotReport] = {}

    def reported(self, robots: Sequence[str], report: RobotReport) -> None:
        """Take what the process of ``robots`` says, after the last order."""
        self._reports.update(dict.fromkeys(robots, report))

    @property
    def error(self) -> str:
        """Why the policy is not deployed; empty as long as nothing is in the way."""
        lost = self._behind() if self.order is Order.ROLL_BACK else []
        return self._error + (f"; no answer about going back from {', '.join(lost)}" if lost else "")

    @property
    def done(self) -> int:
        """How many robots have done as they were told."""
        return len(self._robots) - len(self._behind())

    def advance(self, now: float) -> Order | None:
        """The next order, if it is time for one."""
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
        """Whether all that can be had has been done."""
        last = self.order is not Order.PREPARE and not self._behind()
        return last or (self.order is Order.ROLL_BACK and now - self._ordered > self._patience)

    def cancel(self, now: float) -> Order | None:
        """Give it up, unless it is given up already."""
        return None if self.order is Order.ROLL_BACK else self._roll_back(now, "cancelled")

    def _behind(self) -> list[str]:
        """Robots that have not done, as far as is known, what they were told."""
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
        self._reports = {}  # only what is said after it counts
        return order
