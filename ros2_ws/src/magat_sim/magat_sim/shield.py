"""Collision shielding: turns what robots want into moves that never collide."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from magat_sim.grid import BoolArray, IntArray, Primitive

NOBODY = -1
#: How far back a shield with memory knows where a robot was, steps: long enough to fill pockets that open late.
MEMORY = 256
#: What each return takes from the logarithm of a probability.
RETURN_PENALTY = 2.0
#: Instead of a place in a robot's past.
NOWHERE = -1
# Instead of places where no robot may be.
_WALL = -1


@dataclass(frozen=True)
class Scene:
    """Where R robots are, where they could go, and what they want.

    Places are cells, numbered through all worlds: those of separate worlds are separate places.
    """

    #: ``[R]`` where each robot is.
    place: IntArray
    #: ``[R, 5]`` where each primitive leads.
    leads: IntArray
    #: ``[R, 5]`` bool, no obstacle is there.
    free: BoolArray
    #: ``[R, 5]`` the robot that is there now, or `NOBODY`; the robot itself for IDLE.
    ahead: IntArray
    #: ``[R]`` the primitive each robot drew; IDLE where it was silent.
    actions: IntArray
    #: ``[R, 5]`` how much each likes the primitives: logarithms of probabilities, or whatever it sent.
    log_probabilities: npt.NDArray[np.float32]
    #: ``[R]`` bool, who said nothing: it stays where it is.
    silent: BoolArray
    #: ``[R]`` steps since each was on its goal, or since the start.
    waited: IntArray
    #: ``[R, MEMORY]`` where each was at the last instants, now included, in any order; `NOWHERE` until it was last on
    #: its goal, or before the start.
    trail: IntArray
    #: ``[R]`` random numbers of the episode, all different within a world.
    draw: npt.NDArray[np.float64]

    @property
    def returns(self) -> IntArray:
        """``[R, 5]`` at how many instants of its trail, but the first, each was where each primitive leads."""
        return np.maximum((self.trail[:, None] == self.leads[:, :, None]).sum(axis=2) - 1, 0)


#: ``[R]`` the primitives that the robots of a scene make, none of which leads to a collision.
Shield = Callable[[Scene], IntArray]


def idle_shield(scene: Scene) -> IntArray:
    """The paper's shield: an illegal move becomes IDLE, and what that makes illegal in turn becomes IDLE too.

    Two robots that would swap cells both idle. Of several that want one cell that is or becomes free, the one with the
    lowest draw moves. Following a robot into the cell that it leaves is allowed, and so are rotations of three or more.
    """
    robots = np.arange(len(scene.actions))
    target, ahead = scene.leads[robots, scene.actions], scene.ahead[robots, scene.actions]
    moves = (scene.actions != Primitive.IDLE) & scene.free[robots, scene.actions]
    other = np.maximum(ahead, 0)
    moves &= ~(moves & (ahead != NOBODY) & moves[other] & (target[other] == scene.place))
    by_draw = robots[moves][np.argsort(scene.draw[moves])]
    winners = by_draw[np.unique(target[by_draw], return_index=True)[1]]
    moves = np.zeros(len(robots), dtype=bool)
    moves[winners] = True
    while True:
        blocked = moves & (ahead != NOBODY) & ~moves[other]
        if not blocked.any():
            return np.where(moves, scene.actions, Primitive.IDLE)
        moves &= ~blocked


def pibt_shield(scene: Scene) -> IntArray:
    """Priority inheritance with backtracking, each robot after its own ranking of the primitives (see `ranking`).

    Who has been away from its goal for longest chooses first; among equals, the lowest draw. A robot that stands in the
    way of one that has chosen inherits its priority and chooses next; when it finds no way, the first one has to choose
    again. A silent robot is a wall. (Okumura et al.: Priority inheritance with backtracking, AIJ 2022; with learned
    policies: Veerapaneni et al., 2024, whose CS-PIBT ranks likewise.)
    """
    return _pibt(scene, ranking(scene.actions, scene.log_probabilities))


def pibt_memory_shield(scene: Scene) -> IntArray:
    """As `pibt_shield`, but robots that come back to where they were go elsewhere.

    A policy that knows no more than it sees goes to and fro in a pocket of obstacles that is wider than that, until the
    episode ends. (Korf's real-time search, AIJ 1990, leaves such pockets in the same way.)
    """
    returns = np.where(scene.silent[:, None], 0, scene.returns)  # a wall stays where it is
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
    goes: dict[int, int] = {}  # place that each robot goes to
    taken = {_WALL}
    for first in order.tolist():
        if first in goes:
            continue
        # Each robot in the chain has chosen the place of the next one.
        chain = [(first, iter(choices[first]))]
        while chain:
            robot, left = chain[-1]
            for to, ahead, primitive in left:
                if to in taken or (ahead != NOBODY and goes.get(ahead) == place[robot]):
                    continue
                goes[robot], made[robot] = to, primitive
                taken.add(to)
                if ahead == NOBODY or ahead in goes:
                    chain.clear()  # nobody is in the way of the last one, so all can go
                else:
                    chain.append((ahead, iter(choices[ahead])))
                break
            else:
                # It stays, in the place that the one before it had chosen.
                goes[robot], made[robot] = place[robot], int(Primitive.IDLE)
                chain.pop()
    return np.array(made, dtype=np.int64)


def ranking(actions: IntArray, log_probabilities: npt.ArrayLike, returns: npt.ArrayLike = 0) -> IntArray:
    """In which order robots would like to make the primitives.

    The primitive drawn comes first, unless it is a return, so that a robot that nobody hinders makes what it drew, as
    under any shield. The others follow by falling probability, less `RETURN_PENALTY` for each return; equal ones in the
    order of the primitives. What is no number counts as the least.

    Args:
        actions: ``[R]`` the primitives drawn.
        log_probabilities: ``[R, 5]``, any numbers.
        returns: ``[R, 5]`` as in `Scene`, or 0: none counts.

    Returns:
        ``[R, 5]``, each row all primitives.
    """
    liking = np.nan_to_num(np.asarray(log_probabilities, dtype=np.float64), nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    counted = np.broadcast_to(returns, liking.shape)
    first = (np.arange(liking.shape[1]) == actions[:, None]) & (counted == 0)
    return np.lexsort((RETURN_PENALTY * counted - liking, ~first), axis=1)


def blocked(actions: IntArray, moved: IntArray) -> BoolArray:
    """Who drew a move and did not make it; arrays of any one shape."""
    return (actions != Primitive.IDLE) & (actions != moved)


SHIELDS: Mapping[str, Shield] = {"idle": idle_shield, "pibt": pibt_shield, "pibt-memory": pibt_memory_shield}
