# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node that joins a team for the time of one command."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import Self

import rclpy
from rclpy.action import ActionClient
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from magat_node import interruption


class Visitor:
    """A ``node`` for use in a ``with`` statement; its callbacks run only in `spin`."""

    def __init__(self, name: str, namespace: str = "/", domain: int | None = None) -> None:
        """Create the node ``name`` in ``namespace``, in ROS domain ``domain``; in the environment's domain if None."""
        self._deferred = ExitStack()
        self._deferred.enter_context(interruption.deferred())
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node(name, context=self._context, namespace=namespace)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)

    def spin(self, until: Callable[[], bool], timeout: float = float("inf")) -> bool:
        """Run callbacks until the condition ``until`` holds; False if it does not within ``timeout`` seconds.

        Raises:
            KeyboardInterrupt: SIGINT or SIGTERM has arrived.
        """
        deadline = time.monotonic() + timeout
        while not until():
            interruption.check()
            self.watch()
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.1)
        return True

    def watch(self) -> None:
        """Called repeatedly in `spin`. Override it to raise errors that should end the spinning."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._deferred.close()
        self._executor.remove_node(self.node)
        # The executor refers to callbacks, and their object may refer to the executor: a cycle that the garbage
        # collector does not find. Action clients are not destroyed with their node. Both would keep the node and its
        # threads alive.
        self._executor.shutdown()
        for waitable in list(self.node.waitables):
            if isinstance(waitable, ActionClient):
                waitable.destroy()
        self.node.destroy_node()
        self._context.try_shutdown()
