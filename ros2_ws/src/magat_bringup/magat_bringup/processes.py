"""Starts and watches the processes of a team, and ends them all."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from magat_bringup.team import ENVIRONMENT, TeamPlan
from magat_node.errors import TeamError
from magat_node.parent import end_with_parent
from magat_robot.forked import RESTARTS

#: How long processes may take to end after SIGTERM before they are killed, seconds.
GRACE = 5.0


class TeamProcesses:
    """The processes of a plan, for a ``with`` statement: when it ends, all of them have ended."""

    def __init__(
        self,
        plan: TeamPlan,
        logs: Path,
        environment: Mapping[str, str],
        on_line: Callable[[str, str], None] = lambda process, line: None,
    ) -> None:
        """Start the processes.

        Args:
            plan: what to start.
            logs: folder for their output.
            environment: variables added to this process's own.
            on_line: called by `check` and `stop` with the name of a process and a line of its output.

        Raises:
            TeamFileError: see `TeamPlan.commands`.
        """
        self._commands = {command.name: command for command in plan.commands()}
        self._respawn, self._on_line = plan.respawn, on_line
        self._logs = logs
        self._logs.mkdir(parents=True, exist_ok=True)
        # The wheels' guard against a second re-execution must not reach a child without its variables.
        self._environment = {**os.environ, **environment, **ENVIRONMENT}
        self._environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._starts = dict.fromkeys(self._commands, 0)
        self._outputs: dict[str, IO[bytes]] = {}
        for name in self._commands:
            self._log(name).write_bytes(b"")
            self._outputs[name] = self._log(name).open("rb")
            self._start(name)

    def _log(self, name: str) -> Path:
        return self._logs / f"{name}.log"

    def _start(self, name: str) -> None:
        self._starts[name] += 1
        with self._log(name).open("ab") as log:
            self._running[name] = subprocess.Popen(
                [sys.executable, "-m", *self._commands[name].python],
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                # A session of its own: Ctrl-C in a terminal reaches only this process, which ends the others in order.
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )

    def starts(self, name: str) -> int:
        """How often the command ``name`` was started."""
        return self._starts[name]

    def pids(self, name: str) -> list[int]:
        """Process ids of the command ``name``; for the robots, those of all robot processes, in any order."""
        pid = self._running[name].pid
        return _children(pid) if name == "robots" else [pid]

    def check(self) -> None:
        """Pass log lines on; restart processes that a signal has killed, if the plan says so.

        Raises:
            TeamError: a process has ended by itself, or was killed too often; the message holds its last lines.
        """
        self._pass_on_lines()
        for name, process in self._running.items():
            status = process.poll()
            if status is None:
                continue
            respawn = self._respawn and self._commands[name].again
            if respawn and status < 0 and self._starts[name] <= RESTARTS:
                self._on_line(name, f"[WARN] [{time.time():.9f}] [{name}]: killed by signal {-status}, restarted")
                self._start(name)
                continue
            last = self._log(name).read_text(errors="replace").strip().splitlines()[-15:]
            text = "\n  ".join(last) or "(none)"
            raise TeamError(f"{name}: the process ended with status {status}. Its last lines:\n  {text}")

    def _pass_on_lines(self) -> None:
        for name, output in self._outputs.items():
            for line in output:
                if not line.endswith(b"\n"):  # the rest is not written yet
                    output.seek(-len(line), os.SEEK_CUR)
                    break
                self._on_line(name, line.decode(errors="replace").rstrip())

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
        self._pass_on_lines()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()


def _die_with_parent() -> None:
    """In a child, before it becomes another program: end with the parent, even if that is killed."""
    end_with_parent(signal.SIGTERM)


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
