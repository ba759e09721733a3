# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Services and actions that answer later than in their callback."""

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

#: How long results are kept for clients that ask late, seconds. rclpy's default is 15 minutes; every status message
#: would then list thousands of goals that have ended.
RESULT_TIMEOUT = 10


def create_deferred_service(
    node: Node, service_type: type, name: str, handle: Callable[[Any, Callable[[Any], None]], None]
) -> None:
    """Create a service whose requests are answered by work that goes on after the callback.

    rclpy sends what a callback returns, and an EventsExecutor runs no other callback until then. Here the callback
    starts the work and returns.

    Args:
        node: the node that offers the service.
        service_type: the type of the service.
        name: the name of the service, as `Node.create_service` takes it.
        handle: called in the executor's thread with the request and a function that sends the response. That function
            may be called once, in any thread, at any time until the node is destroyed.
    """
    service = node.create_service(service_type, name, lambda request, _: request)
    send = service.send_response

    # The executor sends the callback's result, here the request itself, to the client of the request with this header.
    def begin(request: Any, header: Any) -> None:
        handle(request, partial(send, header=header))

    service.send_response = begin


class DeferredActionServer(ActionServer):
    """An action server whose goals are ended by later events.

    rclpy runs a goal in a callback, and a callback that awaits keeps an EventsExecutor busy. Here the callback starts
    the work and returns; `finish` ends the goal when the result is there.
    """

    def __init__(
        self, node: Node, action_type: type, name: str, start: Callable[[ServerGoalHandle], None], **options: object
    ) -> None:
        """Offer the action ``name`` on ``node``; ``start`` is called with each goal that is accepted."""
        options = {"result_timeout": RESULT_TIMEOUT} | options
        super().__init__(node, action_type, name, lambda goal: None, **options)
        self._start = start

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: object) -> None:
        """Called by rclpy when the goal has begun to execute."""
        self._start(goal_handle)

    def finish(self, goal_handle: ServerGoalHandle, end: Callable[[], None], result: object) -> None:
        """End the goal by ``end`` (one of its succeed, abort and canceled) and send ``result``."""

        def execute(_: ServerGoalHandle) -> object:
            end()
            return result

        super().notify_execute(goal_handle, execute)


class RunningGoal:
    """The goal of a `SingleGoalActionServer`. It ends once, by `succeed`, `abort` or `cancel`."""

    def __init__(self, server: "SingleGoalActionServer", handle: ServerGoalHandle) -> None:
        """Wrap rclpy's ``handle``."""
        self._server, self._handle = server, handle
        #: The goal message.
        self.request: Any = handle.request

    @property
    def cancel_requested(self) -> bool:
        """The client has asked to cancel it."""
        return self._handle.is_cancel_requested

    def feed_back(self, feedback: object) -> None:
        """Send a feedback message."""
        self._handle.publish_feedback(feedback)

    def succeed(self, result: object) -> None:
        """End it as succeeded."""
        self._end(self._handle.succeed, result)

    def abort(self, result: object) -> None:
        """End it as aborted."""
        self._end(self._handle.abort, result)

    def cancel(self, result: object) -> None:
        """End it as cancelled, which its client has asked for."""
        self._end(self._handle.canceled, result)

    def _end(self, end: Callable[[], None], result: object) -> None:
        self._server.goal = None
        self._server.finish(self._handle, end, result)


class SingleGoalActionServer(DeferredActionServer):
    """An action server that serves one goal at a time, rejects others meanwhile, and accepts requests to cancel."""

    def __init__(self, node: Node, action_type: type, name: str, begin: Callable[[RunningGoal], None]) -> None:
        """Offer the action ``name`` on ``node``; ``begin`` is called with each goal that is accepted."""
        #: The goal that is being served.
        self.goal: RunningGoal | None = None
        self._begin = begin
        self._log, self._name = node.get_logger(), name
        super().__init__(
            node,
            action_type,
            name,
            self._accepted,
            goal_callback=self._asked,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def _asked(self, _: object) -> GoalResponse:
        if self.goal is None:
            return GoalResponse.ACCEPT
        self._log.warning(f"{self._name}: rejected a goal, because another is being served")
        return GoalResponse.REJECT

    def _accepted(self, handle: ServerGoalHandle) -> None:
        self.goal = RunningGoal(self, handle)
        self._begin(self.goal)
