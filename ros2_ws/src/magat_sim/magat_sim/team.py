# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which robots take part: readiness before an episode, absence and return during one. No ROS; time is passed in."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from magat_node.text import shortened

#: How long an answer to a hello, or a status, is valid, seconds.
FRESH = 1.0
#: A robot that is silent in this many consecutive ticks is absent until it answers a hello.
SILENT_TICKS = 2


class Equipment(NamedTuple):
    """What must be the same in all robots of a team."""

    digest: str
    encoding: str
    radio: str
    #: Rounds of messages in a tick.
    rounds: int


@dataclass
class Member:
    """What the simulator knows about one robot."""

    name: str
    #: Sent with each hello; the robot's answer carries it back.
    nonce: int
    #: Whether it takes part: it was ready once and has not become absent since.
    joined: bool = False
    silent_ticks: int = 0
    #: As in its last status.
    equipment: Equipment | None = None
    _answered: float = field(default=-math.inf, repr=False)
    _status: float = field(default=-math.inf, repr=False)
    _peers_heard: int = 0

    def join(self) -> None:
        """Let it take part."""
        self.joined, self.silent_ticks = True, 0

    def leave(self) -> None:
        """Let it not take part, and forget what it answered and reported."""
        self.joined, self._answered, self.equipment = False, -math.inf, None

    def answered(self, now: float) -> None:
        """It answered a hello at ``now`` (seconds)."""
        self._answered = now

    def reported(self, now: float, peers_heard: int, equipment: Equipment) -> None:
        """Its status came at ``now``: it hears ``peers_heard`` other robots."""
        self._status, self._peers_heard, self.equipment = now, peers_heard, equipment

    def reachable(self, now: float) -> bool:
        """Whether observations reach it and its preferences come back."""
        return now - self._answered < FRESH

    def ready(self, now: float, peers: int) -> bool:
        """Whether it is reachable and hears at least ``peers`` other robots."""
        return self.reachable(now) and now - self._status < FRESH and self._peers_heard >= peers


class Team:
    """The robots that the simulator expects, in its order."""

    def __init__(self, names: list[str], nonces: list[int], peers: int) -> None:
        """Expect the robots ``names``.

        Args:
            names: all different.
            nonces: random, and all different.
            peers: the number of others that each robot must hear to be ready.

        Raises:
            ValueError: there are no names, or a name is repeated.
        """
        if not names or len(set(names)) != len(names):
            raise ValueError(f"the team is {names}: name at least one robot, and none twice")
        self._peers = peers
        self.members = [Member(name, nonce) for name, nonce in zip(names, nonces, strict=True)]
        self.by_name = {member.name: member for member in self.members}
        self.by_nonce = {member.nonce: member for member in self.members}
        #: Of all robots when they had gathered; None before.
        self.equipment: Equipment | None = None

    def gather(self, now: float) -> list[str]:
        """Let ready robots join; returns the names of those that are missing."""
        for member in self.members:
            if not member.joined and member.ready(now, self._peers):
                member.join()
        missing = [member.name for member in self.members if not member.joined]
        if not missing:
            self.equipment = self.members[0].equipment
        return missing

    def readmit(self, now: float) -> list[str]:
        """Between two ticks: let absent robots join again that are reachable and have the team's equipment.

        Returns:
            Their names.
        """
        absent = [member for member in self.members if not member.joined and member.reachable(now)]
        back = [member for member in absent if member.equipment is not None and member.equipment == self.equipment]
        for member in back:
            member.join()
        return [member.name for member in back]

    def strangers(self) -> list[str]:
        """The names of robots whose equipment differs from the team's; they take no part."""
        return [m.name for m in self.members if m.equipment is not None and m.equipment != self.equipment]

    def account(self, spoke: list[bool]) -> list[str]:
        """After a tick in which some robots ``spoke`` (``[N]`` bool): the names of those that become absent."""
        lost = []
        for member, heard in zip(self.members, spoke, strict=True):
            member.silent_ticks = 0 if heard else member.silent_ticks + 1
            stranger = member.equipment != self.equipment  # restarted, with something else
            if member.joined and (member.silent_ticks >= SILENT_TICKS or stranger):
                member.leave()
                lost.append(member.name)
        return lost

    def mismatch(self, radio: str) -> str | None:
        """Why the robots do not fit each other, or the simulator's ``radio``; None if they do."""
        carried: dict[Equipment, list[str]] = {}
        for member in self.members:
            if member.equipment is not None:
                carried.setdefault(member.equipment, []).append(member.name)
        if len(carried) < 2 and all(equipment.radio == radio for equipment in carried):
            return None
        kinds = "; ".join(
            f"{', '.join(names)}: policy {shortened(kind.digest[:12])}, {shortened(kind.encoding)}, "
            f"{shortened(kind.radio)} radio"
            for kind, names in carried.items()
        )
        return f"the team does not fit together (the simulator's radio is {radio}; {kinds}): start all with the same"
