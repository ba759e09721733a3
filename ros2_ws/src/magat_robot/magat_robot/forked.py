"""Starts the robot processes of a team by forking: the policy is loaded and ROS imported only once.

Forked processes share the memory of the policy and start in a fraction of the time. Otherwise each is the same as a
robot that is started alone. Forking happens before ROS is initialised, because threads and sockets do not survive it.
"""

import argparse
import contextlib
import os
import signal
import sys
import traceback
from pathlib import Path
from types import FrameType

from magat_node.parent import end_with_parent
from magat_robot import node
from magat_robot.policy.backends import BACKENDS, preload
from magat_robot.policy.config import ENCODINGS, ModelError

#: Exit status of a process that a signal ended, as shells give it.
_SIGNALLED = 128
#: A process is restarted at most this often.
RESTARTS = 10


def run_robots(names: list[str], ros_arguments: list[str], crew: int = 1, respawn: bool = False) -> int:
    """Run robot processes until all have ended.

    SIGINT and SIGTERM are forwarded to them. When a process ends, ``NAME STATUS`` is printed, where NAME is its first
    robot. If this process ends, however it does, the others are killed.

    Args:
        names: names of the robots, which are their namespaces; may contain slashes.
        ros_arguments: arguments after ``--ros-args``, the same for all processes.
        crew: robots in each process; the last process may have fewer.
        respawn: restart a process that was killed by a signal, up to `RESTARTS` times. A process that exits by itself
            is not restarted: it would fail again for the same reason.

    Returns:
        0 if all processes returned 0, else the first other exit status.

    Raises:
        ValueError: robots of different teams would be in one process.
    """
    crews = [names[first : first + crew] for first in range(0, len(names), crew)]
    carrying = [_carrying(group) for group in crews]
    robots = {_fork(own + ros_arguments): index for index, own in enumerate(carrying)}
    restarts = [RESTARTS if respawn else 0] * len(crews)

    def pass_on(number: int, _: FrameType | None) -> None:
        restarts[:] = [0] * len(crews)  # processes that end now are not restarted
        for pid in robots:
            os.kill(pid, number)

    signal.signal(signal.SIGINT, pass_on)
    signal.signal(signal.SIGTERM, pass_on)
    worst = 0
    while robots:
        pid, status = os.wait()
        code = os.waitstatus_to_exitcode(status)
        index = robots.pop(pid)
        again = code < 0 and restarts[index] > 0
        code = code if code >= 0 else _SIGNALLED - code
        print(f"{crews[index][0]} {code}", "restarting" if again else "", flush=True)
        if again:
            restarts[index] -= 1
            robots[_fork(carrying[index] + ros_arguments)] = index
        else:
            worst = worst or code
    return worst


def _carrying(names: list[str]) -> list[str]:
    """ROS arguments of a process that runs these robots."""
    names = [name.strip("/") for name in names]
    teams = {name.rpartition("/")[0] for name in names}
    if len(teams) > 1:
        raise ValueError(f"{', '.join(names)} are of different teams: all robots of a process must be in one")
    crew = ["-p", f"robots:=[{','.join(name.rpartition('/')[2] for name in names)}]"] if len(names) > 1 else []
    return ["-r", f"__ns:=/{names[0]}", *crew]


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
    parser.add_argument("names", nargs="+", metavar="NAME", help="name of a robot, which is its namespace")
    parser.add_argument("--policy", required=True, metavar="FOLDER", help="folder of the robots' policy")
    parser.add_argument("--encoding", choices=ENCODINGS, default="", help="of messages (default: the policy's)")
    parser.add_argument("--backend", choices=BACKENDS, default="torch", help="computes the policy (default: torch)")
    parser.add_argument("--respawn", action="store_true", help="restart processes that are killed by a signal")
    parser.add_argument("--crew", type=int, default=1, metavar="M", help="robots in each process (default: 1)")
    options = parser.parse_args(args[:split])
    if options.crew < 1:
        parser.error(f"--crew {options.crew}: must be at least 1")
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # ends at once during imports: there is nothing to clean up yet
    changes = {"encoding": options.encoding} if options.encoding else {}
    # Errors are left to the robots, because ROS parameters may give them another policy.
    with contextlib.suppress(ModelError):
        preload(Path(options.policy), options.backend, **changes)  # before the fork, so that its memory is shared
    values = {"policy": options.policy, "backend": options.backend, **changes}
    parameters = [part for name, value in values.items() for part in ("-p", f"{name}:={value}")]
    ros_arguments = [*parameters, *args[split + 1 :]]
    try:
        return run_robots(options.names, ros_arguments, options.crew, options.respawn)
    except ValueError as error:
        parser.error(str(error))


if __name__ == "__main__":
    sys.exit(main())
