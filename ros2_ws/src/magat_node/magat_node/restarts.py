# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""How often a process is started again. Free of ROS."""

from collections import deque

#: A process that a signal has killed is started again at most this often in so many seconds. Over a run of days any
#: number of kills is fine; a process that is killed as soon as it starts is not.
RESTARTS, WINDOW = 10, 600.0
#: How often a process that only watches the team and ends by itself is started again; it may fail for the same reason.
TRIES = 2


class RestartLimit:
    """Counts the restarts of one process in a window of time. Times are passed in, seconds."""

    def __init__(self, most: int = RESTARTS, window: float = WINDOW) -> None:
        """Allow ``most`` restarts in ``window`` seconds."""
        self.most, self.window = most, window
        self._times: deque[float] = deque()

    def allows(self, now: float) -> bool:
        """Whether a process that ended at ``now`` may be started again, which counts as a restart."""
        while self._times and now - self._times[0] >= self.window:
            self._times.popleft()
        if len(self._times) >= self.most:
            return False
        self._times.append(now)
        return True

    @property
    def spent(self) -> str:
        """What happened to a process that is not started again, e.g. ``killed 11 times in 10 minutes``."""
        times = len(self._times) + 1
        return f"{times} times in {self.window / 60:g} minutes" if times > 1 else "once"
