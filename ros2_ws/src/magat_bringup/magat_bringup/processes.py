"""The processes of a team: started, watched, and none left behind."""

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

_PR_SET_PDEATHSIG = 1
#: How long processes may take to end when asked to, before they are killed, seconds.
GRACE = 5.0


class TeamError(RuntimeError):
    """The team cannot go on; the message says which process failed and what it said."""


@dataclass(frozen=True)
class TeamPlan:
    """What to start."""

    #: Names of the robots, one process each.
    robots: list[str]
    #: Folder of the policy that each robot carries.
    policy: Path
    #: Folder for the processes' logs.
    logs: Path
    #: Environment variables besides this process's own.
    environment: Mapping[str, str]
    #: How long an episode waits for robots that are missing, seconds.
    ready_timeout: float = 60.0


class TeamProcesses:
    """One simulator, one expert and N robot processes, in a ``with`` statement: at its end all of them have ended."""

    def __init__(self, plan: TeamPlan) -> None:
        """Start the processes; their output goes to ``plan.logs``."""
        self._logs = plan.logs
        self._logs.mkdir(parents=True, exist_ok=True)
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        # The wheels' guard against a second re-execution must not reach a child without what came of the first.
        self._environment = {
            **os.environ,
            **plan.environment,
            "OMP_NUM_THREADS": "1",
            "PYTHONUNBUFFERED": "1",
        }
        self._environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
        size = ["-p", f"team_size:={len(plan.robots)}"]
        robots = ["magat_robot.processes", *plan.robots, "--ros-args", "-p", f"policy:={plan.policy}", *size]
        self._start("robots", robots)
        roster = ["-p", f"robots:=[{','.join(plan.robots)}]", "-p", f"ready_timeout:={plan.ready_timeout:f}"]
        self._start("simulator", ["magat_sim.node", "--ros-args", *roster])
        self._start("expert", ["magat_expert.node"])

    def _start(self, name: str, module: list[str]) -> None:
        with (self._logs / f"{name}.log").open("wb") as log:
            self._running[name] = subprocess.Popen(
                [sys.executable, "-m", *module],
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                # A session of its own: Ctrl-C in a terminal reaches this process only, which ends the others in order.
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )

    def pids(self, name: str) -> list[int]:
        """Process numbers of ``name`` (robots, simulator or expert); of the robots, one each, in no order."""
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
