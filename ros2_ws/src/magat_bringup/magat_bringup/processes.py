"""The processes of a team: started, watched, and none left behind."""

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from magat_bringup.team import ENVIRONMENT, Command, TeamPlan

_PR_SET_PDEATHSIG = 1
#: How long processes may take to end when asked to, before they are killed, seconds.
GRACE = 5.0


class TeamError(RuntimeError):
    """The team cannot go on; the message says which process failed and what it said."""


class TeamProcesses:
    """Robots, simulator, expert and view, in a ``with`` statement: at its end all of them have ended."""

    def __init__(self, plan: TeamPlan, logs: Path, environment: Mapping[str, str]) -> None:
        """Start the processes.

        Args:
            plan: what to start.
            logs: folder for their output.
            environment: variables besides this process's own.

        Raises:
            TeamFileError: see `TeamPlan.commands`.
        """
        started = plan.commands()
        self._logs = logs
        self._logs.mkdir(parents=True, exist_ok=True)
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        # The wheels' guard against a second re-execution must not reach a child without what came of the first.
        self._environment = {**os.environ, **environment, **ENVIRONMENT}
        self._environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
        for command in started:
            self._start(command)

    def _start(self, command: Command) -> None:
        with (self._logs / f"{command.name}.log").open("wb") as log:
            self._running[command.name] = subprocess.Popen(
                [sys.executable, "-m", *command.python],
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                # A session of its own: Ctrl-C in a terminal reaches this process only, which ends the others in order.
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )

    def pids(self, name: str) -> list[int]:
        """Process numbers of ``name``, a `Command`'s; of the robots, those of all their processes, in no order."""
        pid = self._running[name].pid
        return _children(pid) if name == "robots" else [pid]

    def check(self) -> None:
        """Fail if one of the processes has ended.

        Raises:
            TeamError: with the end of what it said.
        """
        for name, process in self._running.items():
            if process.poll() is not None:
                said = (self._logs / f"{name}.log").read_text(errors="replace").strip().splitlines()[-15:]
                text = "\n  ".join(said) or "nothing"
                raise TeamError(f"{name}: the process ended with status {process.returncode}. It said:\n  {text}")

    def stop(self) -> None:
        """End all processes: asked first, killed after a while. Safe to call twice."""
        for process in self._running.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + GRACE
        for process in self._running.values():
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()


def _die_with_parent() -> None:
    """In a child, before it becomes another program: end with the parent, even if that is killed."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
