# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Log lines, and texts of others in them; free of ROS."""

import time
from collections.abc import Callable

#: Most characters of a text that is quoted in a message, such as a name.
QUOTED = 80
#: Seconds between two log lines of one kind that others can cause.
THROTTLE = 5.0


def shortened(text: object, most: int = QUOTED) -> str:
    """``text`` in one line of about ``most`` characters, for log lines and errors.

    Texts that come from the network may be as long as a message, and hold line breaks that look like log lines of
    others. Characters that cannot be printed are escaped, and of a longer text the begin and the length are given.
    """
    whole = str(text)
    begin = whole[:most]
    line = begin if begin.isprintable() else begin.encode("unicode_escape").decode("ascii")[:most]
    return line if len(whole) <= most else f"{line}... ({len(whole)} characters)"


def log_line(level: str, logger: str, text: str) -> str:
    """A log line in ROS's format, of a process that is no node or speaks about another one."""
    return f"[{level}] [{time.time():.9f}] [{logger}]: {text}"


class Throttle:
    """Says when it is time for another log line of one kind."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Start with a line that is due; ``clock`` is the time, seconds."""
        self._clock, self._last = clock, float("-inf")

    def due(self) -> bool:
        """Whether the last line was long enough ago; if so, this is the last one."""
        now = self._clock()
        if now - self._last < THROTTLE:
            return False
        self._last = now
        return True
