# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

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
from magat_node.restarts import TRIES, RestartLimit
from magat_node.text import log_line, shortened

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
        self._kills = {name: RestartLimit() for name in self._commands}
        self._exits = {name: RestartLimit(TRIES) for name in self._commands}
        #: Observers that are not started again, and why.
        self.given_up: dict[str, str] = {}
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
        """Pass log lines on; restart processes that have ended, or give them up.

        A process that a signal has killed is restarted if the plan says so, and as often as a `RestartLimit` allows. An
        observer (`Command.observer`) that ends by itself is restarted a few times; then the team goes on without it.

        Raises:
            TeamError: a process that the team needs has ended by itself, or was killed too often; the message holds its
                last lines.
        """
        self._pass_on_lines()
        for name, process in list(self._running.items()):
            status = process.poll()
            if status is not None:
                self._take_end(name, status)

    def _take_end(self, name: str, status: int) -> None:
        """Restart a process that has ended, or give it up."""
        command, killed = self._commands[name], status < 0
        limit = self._kills[name] if killed else self._exits[name]
        restarts = self._respawn and command.again and (killed or command.observer)
        how = f"killed by signal {-status}" if killed else f"ended with status {status}"
        if restarts and limit.allows(time.monotonic()):
            why = "" if killed else f" ({self._last_lines(name, 1)})"
            self._on_line(name, log_line("WARN", name, f"{how}, restarted{why}"))
            self._start(name)
            return
        if restarts:
            how = f"{how}, {limit.spent}"
        if not command.observer:
            said = self._last_lines(name, 15)
            raise TeamError(f"{name}: {how}, not started again. Its last lines:\n  {said}")
        del self._running[name]
        self.given_up[name] = f"{how}, not started again ({self._last_lines(name, 1)})"
        self._on_line(name, log_line("ERROR", name, f"{self.given_up[name]}: the team goes on without it"))

    def _last_lines(self, name: str, count: int) -> str:
        lines = self._log(name).read_text(errors="replace").strip().splitlines()[-count:]
        return "\n  ".join(shortened(line, 300) for line in lines) or "it logged nothing"

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
