"""The expert as a ROS 2 service. It only translates between `SolveMapf` and `magat_expert.solve`."""

import sys
from concurrent.futures import ThreadPoolExecutor, wait

import numpy as np
from rclpy.node import Node

from magat_expert.instance import InvalidInstanceError
from magat_expert.solver import Solution, SolveStatus, StopFlag, solve
from magat_interfaces.srv import SolveMapf
from magat_node.run import run_node, told_to_end

_STATUS = {
    SolveStatus.SOLVED: SolveMapf.Response.SOLVED,
    SolveStatus.NO_SOLUTION: SolveMapf.Response.NO_SOLUTION,
    SolveStatus.TIMED_OUT: SolveMapf.Response.TIMED_OUT,
    SolveStatus.STOPPED: SolveMapf.Response.TIMED_OUT,
}


class ExpertNode(Node):
    """Serves `solve_mapf`, one request after another.

    The service callback waits for the search: this executor sends what a callback returns, and knows none
    that answers later. Further requests wait in the middleware meanwhile. A shutdown ends the search.
    """

    def __init__(self) -> None:
        super().__init__("expert")
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="search")
        self._service = self.create_service(SolveMapf, "solve_mapf", self._solve)

    def _solve(self, request: SolveMapf.Request, response: SolveMapf.Response) -> SolveMapf.Response:
        try:
            obstacles, starts, goals = instance_of(request)
            solution = self._search(obstacles, starts, goals, request.w, request.time_limit)
        except InvalidInstanceError as error:
            response.status = SolveMapf.Response.INVALID
            response.message = str(error)
            self.get_logger().warning(f"refused a request: {error}")
            return response
        fill_response(response, solution, request)
        self.get_logger().info(
            f"{len(starts)} robots on {request.width}x{request.height} cells: {solution.status.name} in "
            f"{solution.seconds:.3f} s, cost {solution.cost}, lower bound {solution.lower_bound}"
        )
        return response

    def _search(
        self, obstacles: np.ndarray, starts: np.ndarray, goals: np.ndarray, w: float, time_limit: float
    ) -> Solution:
        # In a thread of its own, so that this one can see the word to end.
        stop = StopFlag()
        search = self._pool.submit(solve, obstacles, starts, goals, w, time_limit, stop=stop)
        while not search.done():
            wait([search], timeout=0.1)
            if told_to_end():
                stop.set()
        return search.result()


def instance_of(request: SolveMapf.Request) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Obstacles uint8 `[H, W]`, starts and goals int16 `[N, 2]` of a request.

    Raises:
        InvalidInstanceError: the arrays of the request do not fit together.
    """
    obstacles = np.asarray(request.obstacles, dtype=np.uint8)
    if obstacles.size != request.width * request.height:
        raise InvalidInstanceError(
            f"obstacles hold {obstacles.size} cells, and the map has {request.width} x {request.height}: "
            "send one byte a cell, row by row from y = 0"
        )
    lengths = {name: len(getattr(request, name)) for name in ("start_x", "start_y", "goal_x", "goal_y")}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise InvalidInstanceError(
            f"the arrays of the robots differ in length ({listed}): send one entry a robot in each"
        )
    starts = np.column_stack([request.start_x, request.start_y]).astype(np.int16)
    goals = np.column_stack([request.goal_x, request.goal_y]).astype(np.int16)
    return obstacles.reshape(request.height, request.width), starts, goals


def fill_response(response: SolveMapf.Response, solution: Solution, request: SolveMapf.Request) -> None:
    """Writes a solution into the response to the request that it answers."""
    response.status = _STATUS[solution.status]
    response.lower_bound = float(solution.lower_bound)
    response.time = solution.seconds
    if solution.paths is not None:
        response.path_x = solution.paths[..., 0].ravel().tolist()
        response.path_y = solution.paths[..., 1].ravel().tolist()
        response.cost = solution.cost
        response.makespan = solution.makespan
    elif solution.status is SolveStatus.NO_SOLUTION:
        response.message = "these robots would have to pass each other where nobody can: there is no solution"
    elif solution.status is SolveStatus.STOPPED:
        response.message = "the expert is shutting down"
    else:
        response.message = (
            f"not solved within {request.time_limit:g} s: allow more time or a larger w; there may be no solution"
        )


def main(args: list[str] | None = None) -> int:
    """Run the expert until it is told to end. Returns the exit status."""
    return run_node("expert", ExpertNode, args)


if __name__ == "__main__":
    sys.exit(main())
