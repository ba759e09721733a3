# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Collision shielding: turns the actions of robots into moves that never collide."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from magat_robot.policy.visit_memory import count_visits
from magat_sim.grid import BoolArray, IntArray, Primitive

#: In place of a robot's index where there is none.
NO_ROBOT = -1
#: Memory of ``pibt-memory``, visits: long enough to leave large pockets.
MEMORY = 256
#: Subtracted from the log-probability of a primitive for each earlier visit of the cell that it leads to.
RETURN_PENALTY = 2.0
# In place of cells that no robot may enter.
_WALL = -1


@dataclass(frozen=True)
class Scene:
    """The state from which a shield decides: positions and actions of R robots.

    Cells are numbered across all worlds, so that cells of different worlds differ.
    """

    #: ``[R]`` the cell of each robot.
    place: IntArray
    #: ``[R, 5]`` the cell that each primitive leads to.
    leads: IntArray
    #: ``[R, 5]`` bool, whether that cell is free of obstacles.
    free: BoolArray
    #: ``[R, 5]`` the robot that is in that cell now, or `NO_ROBOT`; the robot itself for IDLE.
    ahead: IntArray
    #: ``[R]`` the action that each robot sampled; IDLE for silent robots.
    actions: IntArray
    #: ``[R, 5]`` float32, the log-probabilities that each robot sent; not checked.
    log_probabilities: npt.NDArray[np.float32]
    #: ``[R]`` bool, robots that sent no preference; they stay where they are.
    silent: BoolArray
    #: ``[R]`` steps since each robot was on its goal, or since the start.
    waited: IntArray
    #: ``[R, MEMORY]`` int32, the cells of each robot's last visits, see `Trails`. A trail begins at the start, or when
    #: the robot leaves its goal.
    trail: npt.NDArray[np.integer]
    #: ``[R]`` random numbers, all different within a world; they resolve ties.
    draw: npt.NDArray[np.float64]

    @property
    def returns(self) -> IntArray:
        """``[R, 5]`` how often each robot entered the cell that each primitive leads to, the first time not counted.

        Waiting is no visit, so IDLE is no return if it is sampled. If the sampled move is a return, IDLE counts as more
        returns than any move. Otherwise the robot might wait for ever, because waiting does not change its trail.
        """
        counted = np.maximum(count_visits(self.trail, self.leads) - 1, 0)
        counted[:, Primitive.IDLE] = 0
        returning = counted[np.arange(len(counted)), self.actions] > 0
        counted[returning, Primitive.IDLE] = self.trail.shape[1]
        return counted


#: Returns the primitives (``[R]`` int64) that the robots of a scene make. None leads to a collision.
Shield = Callable[[Scene], IntArray]


def idle_shield(scene: Scene) -> IntArray:
    """The paper's shield: illegal moves become IDLE, as do moves that become illegal thereby.

    Two robots that would swap cells both idle. If several robots move to one cell that is or becomes free, the one with
    the lowest draw moves. A robot may follow another into the cell that it leaves, also in rotations of three or more.
    """
    robots = np.arange(len(scene.actions))
    target, ahead = scene.leads[robots, scene.actions], scene.ahead[robots, scene.actions]
    moves = (scene.actions != Primitive.IDLE) & scene.free[robots, scene.actions]
    other = np.maximum(ahead, 0)
    moves &= ~(moves & (ahead != NO_ROBOT) & moves[other] & (target[other] == scene.place))
    by_draw = robots[moves][np.argsort(scene.draw[moves])]
    winners = by_draw[np.unique(target[by_draw], return_index=True)[1]]
    moves = np.zeros(len(robots), dtype=bool)
    moves[winners] = True
    while True:
        blocked = moves & (ahead != NO_ROBOT) & ~moves[other]
        if not blocked.any():
            return np.where(moves, scene.actions, Primitive.IDLE)
        moves &= ~blocked


def pibt_shield(scene: Scene) -> IntArray:
    """Priority inheritance with backtracking, with each robot's own ranking of the primitives (see `ranking`).

    The robot that has been away from its goal longest has the highest priority; ties are resolved by the lowest draw.
    A robot in the target cell of another inherits its priority and chooses next. If it finds no cell, the other robot
    takes the next primitive of its ranking. A silent robot is an obstacle. (Okumura et al.: Priority inheritance with
    backtracking, AIJ 2022. For learned policies: Veerapaneni et al., 2024, whose CS-PIBT ranks in the same way.)
    """
    return _pibt(scene, ranking(scene.actions, scene.log_probabilities))


def pibt_memory_shield(scene: Scene) -> IntArray:
    """Like `pibt_shield`, but primitives that lead back to earlier cells are ranked lower: an exploration rule.

    A policy without memory may oscillate in a pocket of obstacles that is wider than its field of view until the
    episode ends. (Korf's real-time search, AIJ 1990, leaves such pockets in the same way.) Visits count, not instants:
    a robot that waits is not pushed for it.

    This is more than a shield. The memory is central, in the cells of the map, which no robot knows. And moves depend
    on the past, while the paper's policy is time-invariant. The option `visit_memory` of a policy is the same rule in
    the robot, see `magat_robot.policy.visit_memory`.
    """
    returns = np.where(scene.silent[:, None], 0, scene.returns)  # silent robots do not move
    return _pibt(scene, ranking(scene.actions, scene.log_probabilities, returns))


def _pibt(scene: Scene, ranked: IntArray) -> IntArray:
    order = np.lexsort((scene.draw, -scene.waited, ~scene.silent))
    leads = np.where(scene.free, scene.leads, _WALL)
    choices = [
        list(zip(*columns, strict=True))
        for columns in zip(
            *(np.take_along_axis(values, ranked, axis=1).tolist() for values in (leads, scene.ahead)),
            ranked.tolist(),
            strict=True,
        )
    ]
    place = scene.place.tolist()
    made = [int(Primitive.IDLE)] * len(place)
    goes: dict[int, int] = {}  # the cell that each robot goes to
    taken = {_WALL}
    for first in order.tolist():
        if first in goes:
            continue
        # Each robot in the chain has chosen the cell of the next one.
        chain = [(first, iter(choices[first]))]
        while chain:
            robot, left = chain[-1]
            for to, ahead, primitive in left:
                if to in taken or (ahead != NO_ROBOT and goes.get(ahead) == place[robot]):
                    continue
                goes[robot], made[robot] = to, primitive
                taken.add(to)
                if ahead == NO_ROBOT or ahead in goes:
                    chain.clear()  # the last robot's cell is free, so all can go
                else:
                    chain.append((ahead, iter(choices[ahead])))
                break
            else:
                # It stays, in the cell that the robot before it has chosen.
                goes[robot], made[robot] = place[robot], int(Primitive.IDLE)
                chain.pop()
    return np.array(made, dtype=np.int64)


def ranking(actions: IntArray, log_probabilities: npt.ArrayLike, returns: npt.ArrayLike = 0) -> IntArray:
    """Each robot's ranking of the primitives.

    The sampled action comes first, unless it is a return, so that a robot without conflicts makes its action, as with
    any shield. The others follow by decreasing log-probability minus `RETURN_PENALTY` for each return; ties are
    resolved in the order of the primitives. NaN ranks last.

    Args:
        actions: ``[R]`` the sampled actions.
        log_probabilities: ``[R, 5]``, any numbers.
        returns: ``[R, 5]`` as in `Scene`; 0: none.

    Returns:
        ``[R, 5]`` int64, a permutation of the primitives in each row.
    """
    scores = np.nan_to_num(np.asarray(log_probabilities, dtype=np.float64), nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    counted = np.broadcast_to(returns, scores.shape)
    first = (np.arange(scores.shape[1]) == actions[:, None]) & (counted == 0)
    return np.lexsort((RETURN_PENALTY * counted - scores, ~first), axis=1)


def blocked(actions: IntArray, moved: IntArray) -> BoolArray:
    """Which robots sampled a move and did not make it; bool, of the shape of both arrays."""
    return (actions != Primitive.IDLE) & (actions != moved)


SHIELDS: Mapping[str, Shield] = {"idle": idle_shield, "pibt": pibt_shield, "pibt-memory": pibt_memory_shield}
#: Version of each shield. Raise it with every change after which a shield makes other moves: results that were measured
#: before are then measured again.
SHIELD_VERSIONS: Mapping[str, int] = {**dict.fromkeys(SHIELDS, 1), "pibt-memory": 2}
