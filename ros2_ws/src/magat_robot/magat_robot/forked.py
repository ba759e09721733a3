# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Starts the robot processes of a team by forking: the policy is loaded and ROS imported only once.

Forked processes share the memory of the policy and start in a fraction of the time. Otherwise each is the same as a
robot that is started alone. Forking happens before ROS is initialised, because threads and sockets do not survive it.
"""

import argparse
import contextlib
import os
import signal
import sys
import time
import traceback
from itertools import pairwise
from pathlib import Path
from types import FrameType

from magat_node.imports import quiet_imports

with quiet_imports():
    from magat_node.names import InvalidNameError, check_robot_name, team_namespace
    from magat_node.parent import end_with_parent
    from magat_node.restarts import RESTARTS, RestartLimit
    from magat_node.text import log_line
    from magat_robot import node
    from magat_robot.policy.backends import preload
    from magat_robot.policy.config import BACKENDS, ENCODINGS, ModelError
    from magat_robot.policy.folder import read_temperature

#: Exit status of a process that a signal ended, as shells give it.
_SIGNALLED = 128


def run_robots(names: list[str], ros_arguments: list[str], crew: int = 1, respawn: bool = False) -> int:
    """Run robot processes until all have ended.

    SIGINT and SIGTERM are forwarded to them. When a process ends, a log line says how, and whether it is started again.
    If this process ends, however it does, the others are killed.

    Args:
        names: names of the robots, which are their namespaces in the team's.
        ros_arguments: arguments after ``--ros-args``, the same for all processes. A remapping of ``__ns`` sets the
            namespace of the team.
        crew: robots in each process; the last process may have fewer.
        respawn: restart a process that was killed by a signal, as often as a `RestartLimit` allows. A process that
            exits by itself is not restarted: it would fail again for the same reason.

    Returns:
        0 if all processes returned 0, else the first other exit status.
    """
    crews = [names[first : first + crew] for first in range(0, len(names), crew)]
    carrying = [_carrying(group, _namespace(ros_arguments)) for group in crews]
    robots = {_fork(own + ros_arguments): index for index, own in enumerate(carrying)}
    limits = [RestartLimit(RESTARTS if respawn else 0) for _ in crews]
    stopping = False

    def pass_on(number: int, _: FrameType | None) -> None:
        nonlocal stopping
        stopping = True  # processes that end now are not restarted
        for pid in robots:
            with contextlib.suppress(ProcessLookupError):  # it has just ended
                os.kill(pid, number)

    signal.signal(signal.SIGINT, pass_on)
    signal.signal(signal.SIGTERM, pass_on)
    worst = 0
    while robots:
        pid, status = os.wait()
        code = os.waitstatus_to_exitcode(status)
        index = robots.pop(pid)
        again = code < 0 and not stopping and limits[index].allows(time.monotonic())
        how = f"killed by signal {-code}" if code < 0 else f"ended with status {code}"
        name = ", ".join(crews[index])
        if again:
            print(log_line("WARN", "robots", f"{name}: {how}, restarted"), flush=True)
            robots[_fork(carrying[index] + ros_arguments)] = index
            continue
        often = f"{how}, {limits[index].spent}, " if code < 0 and respawn else f"{how}, "
        level = "INFO" if stopping else "ERROR"
        print(log_line(level, "robots", f"{name}: {often}not started again"), flush=True)
        worst = worst or (code if code >= 0 else _SIGNALLED - code)
    return worst


def _namespace(ros_arguments: list[str]) -> str:
    """The namespace that ``ros_arguments`` give, without a slash at its end; of several the first, as in ROS."""
    for option, rule in pairwise(ros_arguments):
        left, _, right = rule.partition(":=")
        if option in ("-r", "--remap") and left in ("__ns", "robot:__ns"):
            return team_namespace(right)
    return ""


def _carrying(names: list[str], namespace: str = "") -> list[str]:
    """ROS arguments of a process that runs these robots of the team in ``namespace``."""
    crew = ["-p", f"robots:=[{','.join(names)}]"] if len(names) > 1 else []
    return ["-r", f"__ns:={namespace}/{names[0]}", *crew]


def _fork(ros_arguments: list[str]) -> int:
    parent = os.getpid()
    pid = os.fork()
    if pid != 0:
        return pid
    code = 1
    try:
        end_with_parent(signal.SIGKILL)
        if os.getppid() == parent:  # otherwise the parent died before prctl was called
            code = node.main(["robot", "--ros-args", *ros_arguments])
    except BaseException:  # printed here, because os._exit() below skips all frames above
        traceback.print_exc()
    finally:
        # Not sys.exit(), which would run the exit handlers of the parent.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def main(args: list[str] | None = None) -> int:
    """Command line: ``robots --policy FOLDER [--crew M] [--respawn] NAME [NAME ...] [--ros-args ...]``."""
    args = sys.argv[1:] if args is None else args
    split = args.index("--ros-args") if "--ros-args" in args else len(args)
    parser = argparse.ArgumentParser(prog="robots", description="Start the robots of a team, each in its own process.")
    parser.add_argument("names", nargs="+", metavar="NAME", help="of a robot, its namespace in the team's")
    parser.add_argument("--policy", required=True, metavar="FOLDER", help="folder of the robots' policy")
    parser.add_argument("--encoding", choices=ENCODINGS, default="", help="of messages (default: the policy's)")
    parser.add_argument("--shield", default="", help="the simulator's, which selects the temperature (default: none)")
    parser.add_argument("--backend", choices=BACKENDS, default="onnx", help="computes the policy (default: onnx)")
    parser.add_argument("--respawn", action="store_true", help="restart processes that are killed by a signal")
    parser.add_argument("--crew", type=int, default=1, metavar="M", help="robots in each process (default: 1)")
    options = parser.parse_args(args[:split])
    if options.crew < 1:
        parser.error(f"--crew {options.crew}: must be at least 1")
    try:
        for name in options.names:
            check_robot_name(name)
        _namespace(args[split + 1 :])
    except InvalidNameError as error:
        parser.error(str(error))
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # ends at once during imports: there is nothing to clean up yet
    changes = {"encoding": options.encoding} if options.encoding else {}
    # Before the fork, so that memory is shared. Errors are left to the robots: parameters may give them another policy.
    with contextlib.suppress(ModelError):
        temperature = read_temperature(Path(options.policy), options.shield)
        preload(Path(options.policy), options.backend, temperature=temperature, **changes)
    values = {"policy": options.policy, "backend": options.backend, **changes}
    values |= {"shield": options.shield} if options.shield else {}
    parameters = [part for name, value in values.items() for part in ("-p", f"{name}:={value}")]
    return run_robots(options.names, [*parameters, *args[split + 1 :]], options.crew, options.respawn)


if __name__ == "__main__":
    sys.exit(main())
