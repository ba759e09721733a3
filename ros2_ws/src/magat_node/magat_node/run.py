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

from magat_node.errors import MagatError

#: Longest time in which a node notices a signal, seconds.
REACTION = 0.2
#: Niceness of processes that only record or show the team.
NICENESS = 10
_told_to_end = threading.Event()


def run_node(name: str, create: Callable[[], Node], args: list[str] | None = None) -> int:
    """Create a node and run it until SIGINT or SIGTERM.

    Args:
        name: the logger's name if the node cannot be created.
        create: creates the node. A ValueError is logged as fatal, and ends the process. So is a MagatError that a
            callback raises, or the end of the node.
        args: command-line arguments; those of the process if None.

    Returns:
        The exit status: 0, or 1 after a fatal error.
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
        log, status = node.get_logger(), 0
        try:
            while not _told_to_end.is_set():
                executor.spin_once(timeout_sec=REACTION)  # without a timeout, rclpy 7.1.6 calls nothing
        except MagatError as error:
            log.fatal(str(error))
            status = 1
        executor.remove_node(node)
        try:
            node.destroy_node()
        except MagatError as error:
            log.fatal(str(error))
            status = 1
        return status
    finally:
        rclpy.try_shutdown()


def give_way() -> None:
    """Lower this process's priority below the team's. For tools; call it before the node is created.

    Messages that arrive while the processors are busy wait in the receive buffer.
    """
    os.nice(NICENESS)


def _end(_: int, __: FrameType | None) -> None:
    _told_to_end.set()
