"""Running a node until it is told to end."""

import os
import signal
import threading
from collections.abc import Callable
from types import FrameType

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

#: How long a node may take to notice that it should end, seconds.
REACTION = 0.2
#: Of a process that only listens.
NICENESS = 10
_told_to_end = threading.Event()


def run_node(name: str, create: Callable[[], Node], args: list[str] | None = None) -> int:
    """Create a node and run it until SIGINT or SIGTERM.

    Args:
        name: to log under if there will be no node.
        create: makes the node; a ValueError that it raises is fatal, and its message is for the user.
        args: command line; that of the process if None.

    Returns:
        The exit status: 0, or 1 if the node could not be created.
    """
    # rclpy's own handlers shut the context down under a running callback, which then fails. These only set a flag.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end)
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    try:
        try:
            node = create()
        except ValueError as error:
            rclpy.logging.get_logger(name).fatal(str(error))
            return 1
        executor = EventsExecutor()
        executor.add_node(node)
        while not _told_to_end.is_set():
            executor.spin_once(timeout_sec=REACTION)  # without a timeout, rclpy 7.1.6 calls nothing
        executor.remove_node(node)
        node.destroy_node()
        return 0
    finally:
        rclpy.try_shutdown()


def give_way() -> None:
    """Let the team go first where processors are busy; for who only listens to it, before its node is made.

    What comes meanwhile waits in the receive buffer.
    """
    os.nice(NICENESS)


def _end(_: int, __: FrameType | None) -> None:
    _told_to_end.set()
