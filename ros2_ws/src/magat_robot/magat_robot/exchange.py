"""One robot's side of the message exchange: which features belong to this tick, which come early, which are dropped.

Free of ROS. Nothing here knows who sent a message: a feature is known by the one-time tag that it carries, and by that
only until the tick is over.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from magat_robot.policy.fixed_point import ACTIVATION_BITS, ACTIVATION_MAX

#: How many ticks ahead of this robot's own observation a feature may be.
EARLY_TICKS = 4
#: Ticks of other episodes than the current one of which features are kept: the next one's first, and room for nonsense.
FOREIGN_TICKS = 32
#: Features kept for such a tick; more are dropped, so that nobody can fill a robot's memory.
EARLY_FEATURES = 4096

_Tick = tuple[int, int]  # (episode, tick)


@dataclass
class Exchange:
    """Collects the features that a robot can hear, tick by tick."""

    #: Num_features F: how many numbers a message holds.
    features: int
    #: Messages dropped so far, and why the last one was.
    dropped: int = 0
    last_drop: str = ""
    _now: _Tick | None = None
    _audible: frozenset[int] = frozenset()
    _heard: dict[int, npt.NDArray[np.float32]] = field(default_factory=dict)
    _early: dict[_Tick, dict[int, npt.NDArray[np.float32]]] = field(default_factory=dict)

    def begin(self, episode: int, tick: int, audible: list[int]) -> None:
        """Start a tick in which the messages tagged ``audible`` can be heard; those that came early count already."""
        self._now = (episode, tick)
        self._audible = frozenset(audible)
        early = self._early.pop(self._now, {})
        # What waits for any other tick of this episode but a later one is late by now; other episodes are over or new.
        self._early = {t: kept for t, kept in self._early.items() if t[0] != episode or t[1] > tick}
        self._heard = {tag: x for tag, x in early.items() if tag in self._audible}

    def receive(self, episode: int, tick: int, tag: int, payload: bytes) -> bool:
        """Take a message (float32 payload); True if it belongs to the current tick and is new."""
        at = (episode, tick)
        if self._now is not None and self._now[0] == episode:
            begun = self._now[1]
            if tick < begun:
                return self.drop(f"late: of tick {tick}, after tick {begun} began")
            if tick > begun + EARLY_TICKS:
                return self.drop(f"far ahead: of tick {tick}, before tick {begun + 1} began")
        if at == self._now and tag not in self._audible:
            return False  # out of radio range: not an error, just not heard
        waiting = self._heard if at == self._now else self._early.get(at, {})
        if tag in waiting:
            return self.drop(f"repeated: a second message under one tag in tick {tick}")
        if at != self._now and len(waiting) >= EARLY_FEATURES:
            return self.drop(f"more than {EARLY_FEATURES} messages for tick {tick}, which has not begun")
        x = self._decode(payload)
        if x is None:
            return False
        waiting[tag] = x
        if at != self._now:
            self._early[at] = waiting
            self._forget_foreign()
        return at == self._now

    @property
    def complete(self) -> bool:
        """Every audible message of the current tick is there."""
        return len(self._heard) == len(self._audible)

    @property
    def missing(self) -> int:
        """Audible messages of the current tick that are not there."""
        return len(self._audible) - len(self._heard)

    def messages(self) -> npt.NDArray[np.float32]:
        """``[M, F]`` float32, the features heard in the current tick, in no particular order."""
        if not self._heard:
            return np.zeros((0, self.features), dtype=np.float32)
        return np.stack(list(self._heard.values()))

    def _decode(self, payload: bytes) -> npt.NDArray[np.float32] | None:
        if len(payload) != 4 * self.features:
            self.drop(f"a payload of {len(payload)} bytes, not {4 * self.features}: a robot with another policy?")
            return None
        x = np.frombuffer(payload, dtype="<f4")
        # Written so that NaN fails, too. Off the grid, sums would depend on the order of messages.
        units = np.clip(x, 0, ACTIVATION_MAX) * 2**ACTIVATION_BITS
        if not ((units == np.rint(units)) & (x >= 0) & (x <= ACTIVATION_MAX)).all():
            self.drop(
                f"a payload with values other than multiples of 1/{2**ACTIVATION_BITS} from 0 to {ACTIVATION_MAX:g}"
            )
            return None
        return x

    def _forget_foreign(self) -> None:
        """Of other episodes keep the few ticks that were first heard of last."""
        current = self._now[0] if self._now is not None else None
        foreign = [at for at in self._early if at[0] != current]
        for at in foreign[:-FOREIGN_TICKS]:
            del self._early[at]

    def drop(self, why: str) -> bool:
        """Count a message that was dropped, and remember why; False, for `receive` to return."""
        self.dropped += 1
        self.last_drop = why
        return False
