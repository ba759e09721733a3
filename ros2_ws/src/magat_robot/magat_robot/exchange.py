"""The message exchange of the robots in one process: what belongs to this tick, what comes early, what is dropped.

Free of ROS. Nothing here knows who sent a message: it is known by the one-time tag that it carries, and by that only
until the tick is over.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

#: How many ticks ahead of the current one a message may be.
EARLY_TICKS = 4
#: Rounds of other episodes than this one of which messages are kept: the next one's first, and room for nonsense.
FOREIGN_ROUNDS = 32
#: Messages kept of one round; more are dropped, so that nobody can fill a robot's memory.
MOST_MESSAGES = 4096

_Round = tuple[int, int, int]  # (episode, tick, round)


@dataclass
class Exchange:
    """Keeps the payloads that come, by tick, round and tag."""

    #: Bytes of a message in each round of a tick.
    sizes: Sequence[int]
    #: Messages dropped so far, and why the last one was.
    dropped: int = 0
    last_drop: str = ""
    _episode: int = -1  # of no episode, so far
    _tick: int = -1
    _audible: frozenset[int] | None = None  # tags of this tick, once they are known
    _kept: dict[_Round, dict[int, bytes]] = field(default_factory=dict)

    def begin(self, episode: int, tick: int) -> None:
        """Start a tick; messages that came early count already."""
        self._episode, self._tick, self._audible = episode, tick, None
        # Of this episode, what is of an earlier tick is late by now; other episodes are over or new.
        self._kept = {at: kept for at, kept in self._kept.items() if at[0] != episode or at[1] >= tick}

    def listen(self, audible: frozenset[int]) -> None:
        """From now on keep of this tick what is tagged ``audible``, and nothing else: all others are out of range."""
        self._audible = audible
        for at, kept in self._kept.items():
            if at[:2] == (self._episode, self._tick):
                self._kept[at] = {tag: payload for tag, payload in kept.items() if tag in audible}

    def receive(self, episode: int, tick: int, number: int, tag: int, payload: bytes) -> bool:
        """Take a message of round ``number``; True if it belongs to the current tick and is new."""
        if number >= len(self.sizes):
            return self.drop(f"of round {number}: this policy's rounds are 0 to {len(self.sizes) - 1}")
        current = episode == self._episode
        if current and tick < self._tick:
            return self.drop(f"late: of tick {tick}, after tick {self._tick} began")
        if current and tick > self._tick + EARLY_TICKS:
            return self.drop(f"far ahead: of tick {tick}, before tick {self._tick + 1} began")
        now = current and tick == self._tick
        if now and self._audible is not None and tag not in self._audible:
            return False  # out of radio range: not an error, just not heard
        if len(payload) != self.sizes[number]:
            size = self.sizes[number]
            return self.drop(f"{len(payload)} bytes, not {size}: from a robot with another policy or encoding?")
        kept = self._kept.setdefault((episode, tick, number), {})
        if tag in kept:
            return self.drop(f"repeated: a second message under one tag in tick {tick}")
        if len(kept) >= MOST_MESSAGES:
            return self.drop(f"more than {MOST_MESSAGES} messages in one round of tick {tick}")
        kept[tag] = payload
        if not current:
            self._forget_foreign()
        return now

    def kept(self, number: int) -> dict[int, bytes]:
        """Payloads of round ``number`` of the current tick so far, by tag; all audible, once that is known."""
        return self._kept.get((self._episode, self._tick, number), {})

    def _forget_foreign(self) -> None:
        """Of other episodes keep the few rounds that were first heard of last."""
        foreign = [at for at in self._kept if at[0] != self._episode]
        for at in foreign[:-FOREIGN_ROUNDS]:
            del self._kept[at]

    def drop(self, why: str) -> bool:
        """Count a message that was dropped, and remember why; False, for `receive` to return."""
        self.dropped += 1
        self.last_drop = why
        return False
