# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The mailbox of the robots in one process: sorts messages by tick and round, and drops invalid ones. Free of ROS.

The sender of a message is not known. Each message carries a one-time tag, which is valid for one tick.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

#: A message may be at most this many ticks ahead of the current one.
EARLY_TICKS = 4
#: Rounds of other episodes for which messages are kept: the first of the next episode, and some invalid ones.
FOREIGN_ROUNDS = 32
#: Messages kept of one round. More are dropped, so that a faulty sender cannot fill a robot's memory.
MOST_MESSAGES = 4096

_Round = tuple[int, int, int]  # (episode, tick, round)


@dataclass
class Exchange:
    """The received payloads of this tick and later ones, by tick, round and tag."""

    #: Bytes of a message in each round of a tick.
    sizes: Sequence[int]
    #: Messages dropped so far.
    dropped: int = 0
    #: Why the last one was dropped; empty before the first.
    last_drop: str = ""
    _episode: int = -1  # before the first tick
    _tick: int = -1
    _audible: frozenset[int] | None = None  # tags of this tick, once they are known
    _kept: dict[_Round, dict[int, bytes]] = field(default_factory=dict)

    def begin(self, episode: int, tick: int) -> None:
        """Start a tick. Messages of it that came early are kept."""
        self._episode, self._tick, self._audible = episode, tick, None
        # Messages of earlier ticks are late now. Those of other episodes may belong to the next one.
        self._kept = {at: kept for at, kept in self._kept.items() if at[0] != episode or at[1] >= tick}

    def listen(self, audible: frozenset[int]) -> None:
        """Set the tags in radio range in this tick; messages with other tags are discarded."""
        self._audible = audible
        for at, kept in self._kept.items():
            if at[:2] == (self._episode, self._tick):
                self._kept[at] = {tag: payload for tag, payload in kept.items() if tag in audible}

    def receive(self, episode: int, tick: int, number: int, tag: int, payload: bytes) -> bool:
        """Process a message of round ``number``; True if it belongs to the current tick, is audible and is new."""
        if number >= len(self.sizes):
            return self.drop(f"a message of round {number}: this policy has rounds 0 to {len(self.sizes) - 1}")
        current = episode == self._episode
        if current and tick < self._tick:
            return self.drop(f"a late message, of tick {tick} after tick {self._tick} began")
        if current and tick > self._tick + EARLY_TICKS:
            return self.drop(f"a message far ahead, of tick {tick} during tick {self._tick}")
        now = current and tick == self._tick
        if now and self._audible is not None and tag not in self._audible:
            return False  # out of radio range, which is no fault
        if len(payload) != self.sizes[number]:
            size = self.sizes[number]
            return self.drop(
                f"a message of {len(payload)} bytes, not {size}: does its sender use another policy or encoding?"
            )
        kept = self._kept.setdefault((episode, tick, number), {})
        if tag in kept:
            return self.drop(f"a repeated message, the second with the same tag in round {number} of tick {tick}")
        if len(kept) >= MOST_MESSAGES:
            return self.drop(f"more than {MOST_MESSAGES} messages in one round of tick {tick}")
        kept[tag] = payload
        if not current:
            self._forget_foreign()
        return now

    def kept(self, number: int) -> dict[int, bytes]:
        """The payloads of round ``number`` of the current tick so far, by tag; after `listen`, only audible ones."""
        return self._kept.get((self._episode, self._tick, number), {})

    def _forget_foreign(self) -> None:
        """Keep messages of the newest `FOREIGN_ROUNDS` rounds of other episodes only."""
        foreign = [at for at in self._kept if at[0] != self._episode]
        for at in foreign[:-FOREIGN_ROUNDS]:
            del self._kept[at]

    def drop(self, why: str) -> bool:
        """Count a dropped message and store the reason; returns False, the result of `receive`."""
        self.dropped += 1
        self.last_drop = why
        return False
