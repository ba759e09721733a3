"""Several robot processes from one: loads the policy and imports ROS once, then forks one a robot, or a crew.

Forked robots share the memory of what was loaded, and start in a fraction of the time; apart from that each is the same
process as one started alone. Forking comes before ROS is initialised: threads and sockets do not survive it.
"""

import argparse
import contextlib
import ctypes
import os
import signal
import sys
import traceback
from pathlib import Path
from types import FrameType

from magat_robot import node
from magat_robot.policy.backends import BACKENDS, preload
from magat_robot.policy.config import ENCODINGS, ModelError

_PR_SET_PDEATHSIG = 1
#: Exit status of a process that a signal ended, as shells give it.
_SIGNALLED = 128
#: How often a process may be started again.
RESTARTS = 10


def run_robots(names: list[str], ros_arguments: list[str], crew: int = 1, respawn: bool = False) -> int:
    """Run robots until all have ended.

    SIGINT and SIGTERM are passed on to them. Each process that ends is reported on standard output, as ``NAME STATUS``
    (of its first robot), and they die with this process, however it ends.

    Args:
        names: of the robots, which are their namespaces; may have slashes.
        ros_arguments: what follows ``--ros-args``, the same for all.
        crew: robots in each process; the last may have fewer.
        respawn: start a process again that a signal has killed, up to `RESTARTS` times. One that ends by itself has
            said why, and would do so again.

    Returns:
        0 if all robots ended well, else the first other exit status.

    Raises:
        ValueError: a process's robots are of different teams.
    """
    crews = [names[first : first + crew] for first in range(0, len(names), crew)]
    carrying = [_carrying(group) for group in crews]
    robots = {_fork(own + ros_arguments): index for index, own in enumerate(carrying)}
    restarts = [RESTARTS if respawn else 0] * len(crews)

    def pass_on(number: int, _: FrameType | None) -> None:
        restarts[:] = [0] * len(crews)  # whom this ends shall stay ended
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
        print(f"{crews[index][0]} {code}", "and is started again" if again else "", flush=True)
        if again:
            restarts[index] -= 1
            robots[_fork(carrying[index] + ros_arguments)] = index
        else:
            worst = worst or code
    return worst


def _carrying(names: list[str]) -> list[str]:
    """ROS arguments of a process that carries these robots."""
    names = [name.strip("/") for name in names]
    teams = {name.rpartition("/")[0] for name in names}
    if len(teams) > 1:
        raise ValueError(f"{', '.join(names)} are of different teams: one process carries robots of one")
    crew = ["-p", f"robots:=[{','.join(name.rpartition('/')[2] for name in names)}]"] if len(names) > 1 else []
    return ["-r", f"__ns:=/{names[0]}", *crew]


def _fork(ros_arguments: list[str]) -> int:
    parent = os.getpid()
    pid = os.fork()
    if pid != 0:
        return pid
    code = 1
    try:
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() == parent:  # else it died before the line above
            code = node.main(["robot", "--ros-args", *ros_arguments])
    except BaseException:  # reported here, since nothing above this frame will run
        traceback.print_exc()
    finally:
        # Not sys.exit(): what the parent registered for its own end is not for its children to run.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def main(args: list[str] | None = None) -> int:
    """Command line: ``robots --policy FOLDER [--crew M] [--respawn] NAME [NAME ...] [--ros-args ...]``."""
    args = sys.argv[1:] if args is None else args
    split = args.index("--ros-args") if "--ros-args" in args else len(args)
    parser = argparse.ArgumentParser(prog="robots", description="One process a robot, forked from this one.")
    parser.add_argument("names", nargs="+", metavar="NAME", help="the robot's name, which is its namespace")
    parser.add_argument("--policy", required=True, metavar="FOLDER", help="that each robot carries")
    parser.add_argument("--encoding", choices=ENCODINGS, default="", help="of messages (default: the policy's)")
    parser.add_argument("--backend", choices=BACKENDS, default="torch", help="computes the policy (default: torch)")
    parser.add_argument("--respawn", action="store_true", help="start a process again that a signal has killed")
    parser.add_argument("--crew", type=int, default=1, metavar="M", help="robots in each process (default: 1)")
    options = parser.parse_args(args[:split])
    if options.crew < 1:
        parser.error("--crew is at least 1")
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # in the middle of an import it has nothing to clean up
    changes = {"encoding": options.encoding} if options.encoding else {}
    # What is wrong with it the robots say, whose parameters have the last word.
    with contextlib.suppress(ModelError):
        preload(Path(options.policy), options.backend, **changes)  # before the fork, so that its memory is shared
    carried = {"policy": options.policy, "backend": options.backend, **changes}
    said = [part for name, value in carried.items() for part in ("-p", f"{name}:={value}")]
    ros_arguments = [*said, *args[split + 1 :]]
    try:
        return run_robots(options.names, ros_arguments, options.crew, options.respawn)
    except ValueError as error:
        parser.error(str(error))


if __name__ == "__main__":
    sys.exit(main())
