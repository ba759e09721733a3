# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Running a node until SIGINT or SIGTERM."""

import os
import signal
import time
from collections.abc import Callable
from types import FrameType
from typing import Protocol, runtime_checkable

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from magat_node.errors import MagatError
from magat_node.shell import ShellError, check_shell

#: Longest time in which a node notices a signal, seconds.
REACTION = 0.2
#: How long a node that ends goes on, so that its last messages are sent, seconds.
FAREWELL = 0.3
#: How long to wait for a clock where time is simulated, seconds.
CLOCK_TIMEOUT = 5.0
#: Niceness of processes that only record or show the team.
NICENESS = 10
# No threading.Event: its lock is not reentrant, and a second signal may interrupt the handler of the first.
_told_to_end = False
_failures: list[MagatError] = []


@runtime_checkable
class Ending(Protocol):
    """A node that has to tell others when it ends."""

    def end(self) -> bool:
        """Called once, before the node is destroyed; returns whether there are messages to be sent."""


def run_node(name: str, create: Callable[[], Node], args: list[str] | None = None) -> int:
    """Create a node and run it until SIGINT or SIGTERM.

    Args:
        name: the logger's name if the node cannot be created.
        create: creates the node. A ValueError is logged as fatal, and ends the process. So does a MagatError that the
            node raises when it is destroyed.
        args: command-line arguments; those of the process if None.

    Returns:
        The exit status: 0, or 1 if the node could not be created, or has ended by `fail`.
    """
    # rclpy's own handlers shut the context down during a running callback, which then fails. These only set a flag.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end)
    log = rclpy.logging.get_logger(name)
    try:
        check_shell()
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except (ShellError, RuntimeError) as error:  # the types of rcl's errors are not public
        log.fatal(" ".join(str(error).split()))
        return 1
    try:
        try:
            node = create()
        except ValueError as error:
            log.fatal(str(error))
            return 1
        log = node.get_logger()
        _run(node)
        try:
            node.destroy_node()
        except MagatError as error:
            fail(error)
        for failure in _failures:
            log.fatal(str(failure))
        return 1 if _failures else 0
    finally:
        rclpy.try_shutdown()


def _run(node: Node) -> None:
    executor = EventsExecutor()
    executor.add_node(node)
    begun, clock_checked = time.monotonic(), False
    while not _told_to_end:
        executor.spin_once(timeout_sec=REACTION)  # without a timeout, rclpy 7.1.6 calls nothing
        if not clock_checked and time.monotonic() - begun > CLOCK_TIMEOUT:
            clock_checked = True
            _check_clock(node)
    if isinstance(node, Ending) and node.end():
        begun = time.monotonic()
        while time.monotonic() - begun < FAREWELL:
            executor.spin_once(timeout_sec=FAREWELL / 10)
    executor.remove_node(node)


def _check_clock(node: Node) -> None:
    """Warn of a simulated time that does not begin: no timer of the node would ever fire."""
    if node.get_parameter("use_sim_time").value and node.get_clock().now().nanoseconds == 0:
        node.get_logger().warning(
            f"use_sim_time is true, and there is no message on /clock after {CLOCK_TIMEOUT:g} s: this node waits until "
            "there is one. Start what publishes it, or set use_sim_time to false"
        )


def fail(error: MagatError) -> None:
    """End the node of `run_node` with a fatal error; for callbacks, whose exceptions rclpy logs with a traceback."""
    global _told_to_end
    _failures.append(error)
    _told_to_end = True


def give_way() -> None:
    """Lower this process's priority below the team's. For tools; call it before the node is created.

    Messages that arrive while the processors are busy wait in the receive buffer.
    """
    os.nice(NICENESS)


def _end(_: int, __: FrameType | None) -> None:
    global _told_to_end
    _told_to_end = True
