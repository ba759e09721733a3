"""Services and actions that answer later."""

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.action import ActionServer
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

#: Results are kept for clients that ask late for so long, seconds. By rclpy's default it is 15 minutes, in which every
#: change of a goal is told with the states of thousands of others.
RESULT_TIMEOUT = 10


def create_deferred_service(
    node: Node, service_type: type, name: str, handle: Callable[[Any, Callable[[Any], None]], None]
) -> None:
    """Create a service whose requests are answered by work that goes on after the callback.

    rclpy sends what a callback returns, and an EventsExecutor serves nobody else until then. Here the callback starts
    the work and returns.

    Args:
        node: that offers the service.
        service_type: of the service.
        name: of the service, as `Node.create_service` takes it.
        handle: called in the executor's thread with the request and a function that sends the response, which may be
            called at any time until the node is destroyed, once, in any thread.
    """
    service = node.create_service(service_type, name, lambda request, _: request)
    send = service.send_response

    # The executor sends the callback's result, here the request itself, to the client of the request with this header.
    def begin(request: Any, header: Any) -> None:
        handle(request, partial(send, header=header))

    service.send_response = begin


class DeferredActionServer(ActionServer):
    """An action server whose goals are ended by events to come.

    rclpy runs a goal in a callback, and one that awaits keeps an EventsExecutor busy. Here the callback starts the work
    and returns; `finish` ends the goal when the result is there.
    """

    def __init__(
        self, node: Node, action_type: type, name: str, start: Callable[[ServerGoalHandle], None], **options: object
    ) -> None:
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
