"""Who of the team is there: readiness before an episode, silence and return during one. No ROS; time is passed in."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

#: How long an answer to a hello, or a status, counts as fresh, seconds.
FRESH = 1.0
#: A robot silent for so many ticks in a row is absent: nobody waits for it or hears it until it answers a hello.
SILENT_TICKS = 2


class Equipment(NamedTuple):
    """What must be the same in all robots of a team."""

    digest: str
    encoding: str
    radio: str
    #: Of messages in a tick.
    rounds: int


@dataclass
class Member:
    """What the simulator knows of one robot."""

    name: str
    #: Sent with each hello; the robot's answer carries it back.
    nonce: int
    #: Takes part: it was ready once and has not fallen silent since.
    joined: bool = False
    silent_ticks: int = 0
    #: What it carries, as it last said.
    equipment: Equipment | None = None
    _answered: float = field(default=-math.inf, repr=False)
    _status: float = field(default=-math.inf, repr=False)
    _peers_heard: int = 0

    def join(self) -> None:
        """From now on it takes part."""
        self.joined, self.silent_ticks = True, 0

    def leave(self) -> None:
        """From now on it does not take part, whatever it answered and reported before."""
        self.joined, self._answered, self.equipment = False, -math.inf, None

    def answered(self, now: float) -> None:
        """It answered a hello at ``now`` (seconds)."""
        self._answered = now

    def reported(self, now: float, peers_heard: int, equipment: Equipment) -> None:
        """Its status came at ``now``: hellos of ``peers_heard`` other robots reach it."""
        self._status, self._peers_heard, self.equipment = now, peers_heard, equipment

    def reachable(self, now: float) -> bool:
        """Observations reach it and its preferences come back."""
        return now - self._answered < FRESH

    def ready(self, now: float, peers: int) -> bool:
        """Reachable, and it hears at least ``peers`` other robots."""
        return self.reachable(now) and now - self._status < FRESH and self._peers_heard >= peers


class Team:
    """The robots that the simulator expects, in its order."""

    def __init__(self, names: list[str], nonces: list[int], peers: int) -> None:
        """Expect the robots ``names``.

        Args:
            names: all different.
            nonces: random, and all different.
            peers: how many others each must hear before it is ready.

        Raises:
            ValueError: no names, or a name twice.
        """
        if not names or len(set(names)) != len(names):
            raise ValueError(f"the team is {names}: name at least one robot, and none twice")
        self._peers = peers
        self.members = [Member(name, nonce) for name, nonce in zip(names, nonces, strict=True)]
        self.by_name = {member.name: member for member in self.members}
        self.by_nonce = {member.nonce: member for member in self.members}
        #: What all carried when they had gathered; None before.
        self.equipment: Equipment | None = None

    def gather(self, now: float) -> list[str]:
        """Let join who is ready; the names of those still missing."""
        for member in self.members:
            if not member.joined and member.ready(now, self._peers):
                member.join()
        missing = [member.name for member in self.members if not member.joined]
        if not missing:
            self.equipment = self.members[0].equipment
        return missing

    def readmit(self, now: float) -> list[str]:
        """Between two ticks: let absent robots take part again that can be reached and carry what the team carries.

        Returns:
            Their names.
        """
        absent = [member for member in self.members if not member.joined and member.reachable(now)]
        back = [member for member in absent if member.equipment is not None and member.equipment == self.equipment]
        for member in back:
            member.join()
        return [member.name for member in back]

    def strangers(self) -> list[str]:
        """Robots that carry something else than what the team gathered with: they take no part until they do."""
        return [m.name for m in self.members if m.equipment is not None and m.equipment != self.equipment]

    def account(self, spoke: list[bool]) -> list[str]:
        """After a tick: which robots spoke (``[N]``); the names of those that are absent from now on."""
        lost = []
        for member, heard in zip(self.members, spoke, strict=True):
            member.silent_ticks = 0 if heard else member.silent_ticks + 1
            stranger = member.equipment != self.equipment  # started again, with something else
            if member.joined and (member.silent_ticks >= SILENT_TICKS or stranger):
                member.leave()
                lost.append(member.name)
        return lost

    def mismatch(self, radio: str) -> str | None:
        """What keeps the robots from understanding each other or the simulator, whose radio is ``radio``; or None."""
        carried: dict[Equipment, list[str]] = {}
        for member in self.members:
            if member.equipment is not None:
                carried.setdefault(member.equipment, []).append(member.name)
        if len(carried) < 2 and all(equipment.radio == radio for equipment in carried):
            return None
        kinds = "; ".join(
            f"{', '.join(names)}: policy {kind.digest[:12]}, {kind.encoding}, {kind.radio} radio"
            for kind, names in carried.items()
        )
        return f"the team does not fit together (the simulator's radio is {radio}; {kinds}): start all with the same"
