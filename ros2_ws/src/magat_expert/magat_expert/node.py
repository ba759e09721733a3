# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The expert as a ROS 2 service. It only translates between `SolveMapf` and `magat_expert.solve`."""

import sys
from array import array
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from magat_node.imports import quiet_imports

with quiet_imports():
    import numpy as np
    from rclpy.node import Node

    from magat_expert.instance import DEFAULT_MEMORY_LIMIT, MAX_MEMORY_LIMIT, InvalidInstanceError, validate_time_limit
    from magat_expert.solver import Solution, SolveStatus, StopFlag, solve
    from magat_interfaces.srv import SolveMapf
    from magat_node.deferred import create_deferred_service
    from magat_node.parameters import declare_count, declare_seconds
    from magat_node.run import run_node
    from magat_node.text import shortened

_STATUS = {
    SolveStatus.SOLVED: SolveMapf.Response.SOLVED,
    SolveStatus.NO_SOLUTION: SolveMapf.Response.NO_SOLUTION,
    SolveStatus.TIMED_OUT: SolveMapf.Response.TIMED_OUT,
    SolveStatus.STOPPED: SolveMapf.Response.TIMED_OUT,
    SolveStatus.MEMORY_LIMIT: SolveMapf.Response.TIMED_OUT,  # the message names the limit
}


class ExpertNode(Node):
    """Serves `solve_mapf`, several requests at a time.

    Searches run in threads and release the GIL. If all threads are busy, further requests wait; their time limits count
    from the start of their searches. Destroying the node ends the searches and answers all requests that it has
    received.
    """

    def __init__(self, **options: object) -> None:
        """Offer the service."""
        super().__init__("expert", **options)
        searches = declare_count(self, "searches", 4, "number of searches at the same time", at_most=64)
        self._longest = declare_seconds(self, "max_time_limit", 60.0, "longest search for a request")
        self._memory_limit = declare_count(
            self, "memory_limit", DEFAULT_MEMORY_LIMIT, "MiB that a search may take", at_most=MAX_MEMORY_LIMIT
        )
        self._pool = ThreadPoolExecutor(searches, thread_name_prefix="search")
        self._stop = StopFlag()
        create_deferred_service(self, SolveMapf, "solve_mapf", self._begin)

    def _begin(self, request: SolveMapf.Request, send: Callable[[SolveMapf.Response], None]) -> None:
        self._pool.submit(self._answer, request, send)

    def _answer(self, request: SolveMapf.Request, send: Callable[[SolveMapf.Response], None]) -> None:
        response = SolveMapf.Response()
        try:
            self._solve(request, response)
        except InvalidInstanceError as error:
            response.status = SolveMapf.Response.INVALID
            response.message = str(error)
            self.get_logger().warning(f"refused a request: {error}", throttle_duration_sec=5.0)
        except Exception as error:  # the client must get an answer in any case
            why = f"the expert failed: {shortened(repr(error), 300)}"
            response = SolveMapf.Response(status=SolveMapf.Response.INVALID, message=why)
            self.get_logger().error(response.message)
        try:
            send(response)
        except Exception as error:
            self.get_logger().error(f"could not send a response: {error!r}")

    def _solve(self, request: SolveMapf.Request, response: SolveMapf.Response) -> None:
        obstacles, starts, goals = instance_of(request)
        time_limit = min(validate_time_limit(request.time_limit), self._longest)
        solution = solve(
            obstacles, starts, goals, request.w, time_limit, stop=self._stop, memory_limit=self._memory_limit
        )
        fill_response(response, solution, time_limit, self._memory_limit)
        self.get_logger().info(
            f"{len(starts)} robots on {request.width}x{request.height} cells: {solution.status.name} in "
            f"{solution.seconds:.3f} s, cost {solution.cost}, lower bound {solution.lower_bound}"
        )

    def destroy_node(self) -> None:
        """End the searches, answer all requests, and destroy the node."""
        self._stop.set()
        self._pool.shutdown()
        super().destroy_node()


def instance_of(request: SolveMapf.Request) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The obstacles (uint8 `[H, W]`), starts and goals (int16 `[N, 2]`) of a request.

    Raises:
        InvalidInstanceError: the arrays of the request do not fit together.
    """
    obstacles = np.asarray(request.obstacles, dtype=np.uint8)
    if obstacles.size != request.width * request.height:
        raise InvalidInstanceError(
            f"obstacles hold {obstacles.size} cells, but the map has {request.width} x {request.height}: "
            "send one byte per cell, row by row from y = 0"
        )
    lengths = {name: len(getattr(request, name)) for name in ("start_x", "start_y", "goal_x", "goal_y")}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise InvalidInstanceError(
            f"the arrays of the robots differ in length ({listed}): send one entry per robot in each"
        )
    starts = np.column_stack([request.start_x, request.start_y]).astype(np.int16)
    goals = np.column_stack([request.goal_x, request.goal_y]).astype(np.int16)
    return obstacles.reshape(request.height, request.width), starts, goals


def fill_response(
    response: SolveMapf.Response, solution: Solution, time_limit: float, memory_limit: int = DEFAULT_MEMORY_LIMIT
) -> None:
    """Write the outcome of a search of at most `time_limit` seconds and `memory_limit` MiB into a response."""
    response.status = _STATUS[solution.status]
    response.lower_bound = float(solution.lower_bound)
    response.time = solution.seconds
    if solution.paths is not None:
        # As an array, because a list takes twenty times the memory.
        response.path_x, response.path_y = (array("h", solution.paths[..., axis].tobytes()) for axis in (0, 1))
        response.cost = solution.cost
        response.makespan = solution.makespan
    elif solution.status is SolveStatus.NO_SOLUTION:
        response.message = "there is no solution: these robots would have to pass each other where they cannot"
    elif solution.status is SolveStatus.STOPPED:
        response.message = "the expert is shutting down"
    elif solution.status is SolveStatus.MEMORY_LIMIT:
        response.message = (
            f"not solved within {memory_limit} MiB: allow a larger w, or raise the expert's parameter memory_limit"
        )
    else:
        response.message = (
            f"not solved within {time_limit:g} s: allow more time or a larger w; there may be no solution"
        )


def main(args: list[str] | None = None) -> int:
    """Run the expert until SIGINT or SIGTERM. Returns the exit status."""
    return run_node("expert", ExpertNode, args)


if __name__ == "__main__":
    sys.exit(main())
