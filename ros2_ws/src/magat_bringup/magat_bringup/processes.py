"""The processes of a team: started, watched, and none left behind."""

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from magat_bringup.team import ENVIRONMENT, Command, TeamFile, commands

_PR_SET_PDEATHSIG = 1
#: How long processes may take to end when asked to, before they are killed, seconds.
GRACE = 5.0


class TeamError(RuntimeError):
    """The team cannot go on; the message says which process failed and what it said."""


@dataclass(frozen=True)
class TeamPlan:
    """What to start."""

    #: Names of the robots.
    robots: Sequence[str]
    #: Folder of the policy that each robot carries.
    policy: Path
    #: Folder for the processes' logs.
    logs: Path
    #: Environment variables besides this process's own.
    environment: Mapping[str, str]
    #: Robots in each process.
    crew: int = 1
    #: direct: robots hear each other; relayed: through the simulator.
    radio: str = "direct"
    #: Of messages; that of the policy's configuration if empty.
    encoding: str = ""
    #: What computes the policy: torch or onnx.
    backend: str = "torch"
    #: How long an episode waits for robots that are missing, seconds; the simulator's default if None.
    ready_timeout: float | None = None
    #: ROS parameter file for every process.
    params: Path | None = None
    #: Whether there is a view, too.
    view: bool = False

    def commands(self) -> list[Command]:
        """How the processes are started, one after the other.

        Raises:
            TeamFileError: the robots make no team, or there is no file ``params``.
        """
        return commands(
            TeamFile(tuple(self.robots), self.crew),
            self.policy,
            radio=self.radio,
            encoding=self.encoding,
            backend=self.backend,
            params=self.params,
            ready_timeout=self.ready_timeout,
            view=self.view,
        )


class TeamProcesses:
    """Robots, simulator, expert and view, in a ``with`` statement: at its end all of them have ended."""

    def __init__(self, plan: TeamPlan) -> None:
        """Start the processes; their output goes to ``plan.logs``.

        Raises:
            TeamFileError: see `TeamPlan.commands`.
        """
        started = plan.commands()
        self._logs = plan.logs
        self._logs.mkdir(parents=True, exist_ok=True)
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        # The wheels' guard against a second re-execution must not reach a child without what came of the first.
        self._environment = {**os.environ, **plan.environment, **ENVIRONMENT}
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
