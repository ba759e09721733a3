"""Several robot processes from one: imports torch and ROS once, then forks one process a robot.

Forked robots share the memory of what was imported, and start in a fraction of the time; apart from that each is the
same process as one started alone. Forking comes before ROS is initialised: threads and sockets do not survive it.
"""

import argparse
import ctypes
import os
import signal
import sys
import traceback
from types import FrameType

import torch  # noqa: F401  imported here, before the fork, so that its memory is shared

from magat_robot import node

_PR_SET_PDEATHSIG = 1
#: Exit status of a process that a signal ended, as shells give it.
_SIGNALLED = 128


def run_robots(names: list[str], ros_arguments: list[str]) -> int:
    """Run robots until all have ended.

    SIGINT and SIGTERM are passed on to them. Each robot that ends is reported on standard output, as ``NAME STATUS``,
    and the robots die with this process, however it ends.

    Args:
        names: their names, which are their namespaces; may have slashes.
        ros_arguments: what follows ``--ros-args``, the same for all.

    Returns:
        0 if all robots ended well, else the first other exit status.
    """
    robots = {_fork(name, ros_arguments): name for name in names}

    def pass_on(number: int, _: FrameType | None) -> None:
        for pid in robots:
            os.kill(pid, number)

    signal.signal(signal.SIGINT, pass_on)
    signal.signal(signal.SIGTERM, pass_on)
    worst = 0
    while robots:
        pid, status = os.wait()
        code = os.waitstatus_to_exitcode(status)
        code = code if code >= 0 else _SIGNALLED - code
        print(f"{robots.pop(pid)} {code}", flush=True)
        worst = worst or code
    return worst


def _fork(name: str, ros_arguments: list[str]) -> int:
    parent = os.getpid()
    pid = os.fork()
    if pid != 0:
        return pid
    code = 1
    try:
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() == parent:  # else it died before the line above
            code = node.main(["robot", "--ros-args", "-r", f"__ns:=/{name.strip('/')}", *ros_arguments])
    except BaseException:  # reported here, since nothing above this frame will run
        traceback.print_exc()
    finally:
        # Not sys.exit(): what the parent registered for its own end is not for its children to run.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def main(args: list[str] | None = None) -> int:
    """Command line: ``robots NAME [NAME ...] [--ros-args ...]``."""
    args = sys.argv[1:] if args is None else args
    split = args.index("--ros-args") if "--ros-args" in args else len(args)
    parser = argparse.ArgumentParser(prog="robots", description="One process a robot, forked from this one.")
    parser.add_argument("names", nargs="+", metavar="NAME", help="the robot's name, which is its namespace")
    return run_robots(parser.parse_args(args[:split]).names, args[split + 1 :])


if __name__ == "__main__":
    sys.exit(main())
