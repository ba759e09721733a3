"""Running a node until SIGINT or SIGTERM."""

import os
import signal
import threading
from collections.abc import Callable
from types import FrameType

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

#: Longest time in which a node notices a signal, seconds.
REACTION = 0.2
#: Niceness of processes that only record or show the team.
NICENESS = 10
_told_to_end = threading.Event()


def run_node(name: str, create: Callable[[], Node], args: list[str] | None = None) -> int:
    """Create a node and run it until SIGINT or SIGTERM.

    Args:
        name: the logger's name if the node cannot be created.
        create: creates the node. A ValueError is logged as fatal, and ends the process.
        args: command-line arguments; those of the process if None.

    Returns:
        The exit status: 0, or 1 if the node could not be created.
    """
    # rclpy's own handlers shut the context down during a running callback, which then fails. These only set a flag.
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
    """Lower this process's priority below the team's. For tools; call it before the node is created.

    Messages that arrive while the processors are busy wait in the receive buffer.
    """
    os.nice(NICENESS)


def _end(_: int, __: FrameType | None) -> None:
    _told_to_end.set()
