"""The paper's planners without learning: HCA and Replan. Neither is complete, and neither bounds its cost."""

from numpy.typing import ArrayLike

from magat_expert import _core
from magat_expert.instance import validate_count, validate_instance, validate_time_limit
from magat_expert.solver import Solution, StopFlag, solution_of

#: A seed is a number of 64 bits.
_MAX_SEED = 2**64 - 1
#: Robots that circle round each other add a cell a step to their paths: this keeps them within memory.
_MOST_STEPS = 1_000_000


def solve_hca(
    obstacles: ArrayLike,
    starts: ArrayLike,
    goals: ArrayLike,
    time_limit: float = 10.0,
    orders: int = 20,
    seed: int = 0,
    stop: StopFlag | None = None,
) -> Solution:
    """Hierarchical Cooperative A*: one robot after another, each around the paths of those before it.

    Silver: "Cooperative Pathfinding", AIIDE 2005. Each robot searches space-time with its exact distances (robots
    ignored) as heuristic and takes the path that arrives first. It rests on its goal for ever, and so arrives there
    only when nobody before it passes any more. The robots go first in the order of their numbers; when one finds no
    path, all begin again in an order shuffled by `seed`, in which that one is first.

    The status is SOLVED; INCOMPLETE after `orders` orders without a solution, when there may still be one;
    NO_SOLUTION, TIMED_OUT or STOPPED as in `solve`. Other Python threads run meanwhile.

    Args:
        obstacles: bool `[H, W]`, indexed `[y, x]`, True on obstacles.
        starts: int `[N, 2]`, cells `(x, y)`, x to the right, y up.
        goals: int `[N, 2]`, cells `(x, y)`.
        time_limit: seconds; infinity for none.
        orders: how many orders to try, from 1, which is the algorithm without restarts.
        seed: of the orders, 0 to 2^64 - 1. The same arguments give the same paths, unless the time limit strikes.
        stop: once set, by any thread, the search ends with the status STOPPED.

    Raises:
        InvalidInstanceError: the instance or a parameter makes no sense; the message says what to do.
    """
    time_limit = validate_time_limit(time_limit)
    orders = validate_count(orders, "orders", 1, 2**31 - 1)
    seed = validate_count(seed, "seed", 0, _MAX_SEED)
    instance = validate_instance(obstacles, starts, goals)
    return solution_of(
        _core.solve_hca(instance.obstacles, instance.starts, instance.goals, time_limit, orders, seed, stop), instance
    )


def solve_replan(
    obstacles: ArrayLike,
    starts: ArrayLike,
    goals: ArrayLike,
    time_limit: float = 10.0,
    max_steps: int | None = None,
    seed: int = 0,
    stop: StopFlag | None = None,
) -> Solution:
    """Global re-planning: each robot follows a shortest path, and plans anew where a step meets a conflict.

    The paper's baseline `Replan` (after Wang et al., "Mobile Robot Path Planning in Dynamic Environments Through
    Globally Guided Reinforcement Learning", RA-L 2020). In each time step the robots decide one after another, in an
    order shuffled by `seed`. A step is in conflict if another robot goes to its cell, or stands there and has not
    decided to leave it. The robot then takes an A* path around the present cells of all others and around where they go
    in this step, or waits if there is none. Robots that have arrived stay where they are.

    The status is SOLVED if all have arrived; INCOMPLETE after `max_steps` steps, or as soon as nobody can move any
    more; NO_SOLUTION, TIMED_OUT or STOPPED as in `solve`. All but NO_SOLUTION come with the paths walked until then,
    which are free of conflicts, and with who has `arrived`. Other Python threads run meanwhile.

    Args:
        obstacles: bool `[H, W]`, indexed `[y, x]`, True on obstacles.
        starts: int `[N, 2]`, cells `(x, y)`, x to the right, y up.
        goals: int `[N, 2]`, cells `(x, y)`.
        time_limit: seconds; infinity for none.
        max_steps: the time steps that the robots get, T_max, from 0 to 1,000,000. None is 3 times the longest of the
            shortest paths: T_max of an expert that delays nobody.
        seed: of the orders, 0 to 2^64 - 1. The same arguments give the same paths, unless the time limit strikes.
        stop: once set, by any thread, the search ends with the status STOPPED.

    Raises:
        InvalidInstanceError: the instance or a parameter makes no sense; the message says what to do.
    """
    time_limit = validate_time_limit(time_limit)
    steps = -1 if max_steps is None else validate_count(max_steps, "max_steps", 0, _MOST_STEPS)
    seed = validate_count(seed, "seed", 0, _MAX_SEED)
    instance = validate_instance(obstacles, starts, goals)
    return solution_of(
        _core.solve_replan(instance.obstacles, instance.starts, instance.goals, time_limit, steps, seed, stop), instance
    )
