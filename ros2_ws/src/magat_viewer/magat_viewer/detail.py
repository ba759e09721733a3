"""What the chosen robot saw, heard and decided in one tick, as JSON values. Free of ROS.

As a deployed policy's sums have no order, what a robot computed can be computed again, to the last bit, from what it
saw and heard. It saw what it was told. What each neighbour must have said follows from the world. So if the world says
that the robot heard all in range, and wants what it would draw then, all is known of it, and nobody has to listen to
what robots say and answer, at a cost to the team. Otherwise that has to be heard. No message says who sent it, but a
neighbour is known by what it must have said; two that said the same are heard alike.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from magat_robot.policy import payload
from magat_robot.policy.config import ENCODINGS
from magat_sim.field_of_view import Uint8Array, field_of_view, pad
from magat_sim.grid import BoolArray, IntArray
from magat_sim.radio import neighbours

if TYPE_CHECKING:
    from magat_robot.policy.interface import LatentState
    from magat_robot.policy.policy import Policy  # torch takes a second to import, and is not always needed

#: Why nothing is known of a robot's attention: somebody would have to listen to what robots say and answer.
UNHEARD = "which robots it heard is being found out"


@dataclass(frozen=True)
class TeamSnapshot:
    """The team at the begin of a tick. N robots."""

    tick: int
    #: ``[N, 2]`` cells ``(x, y)``.
    positions: IntArray
    #: ``[N, 2]`` cells ``(x, y)``.
    goals: IntArray
    #: ``[H, W]`` bool; None if it is not known.
    obstacles: BoolArray | None

    def views(self, robots: Sequence[int]) -> Uint8Array:
        """``[len(robots), 3, 11, 11]`` what ``robots`` see.

        Raises:
            ValueError: the obstacles are not known.
        """
        if self.obstacles is None:
            raise ValueError("nobody has told where the obstacles are")
        there = np.zeros(self.obstacles.shape, dtype=np.uint8)
        there[self.positions[:, 1], self.positions[:, 0]] = 1
        chosen = np.asarray(robots, dtype=np.int64)
        world = np.zeros(len(chosen), dtype=np.int64)
        grids = pad(self.obstacles[None], 1), pad(there[None], 0)
        return field_of_view(*grids, world, self.positions[chosen], self.goals[chosen])


@dataclass(frozen=True)
class TickOutcome:
    """What became of one robot in a tick, as the world says, and its random stream."""

    silent: bool
    #: Messages in range that it did not hear.
    missing: int
    #: The primitive that it drew.
    action: int
    stream: int


@dataclass(frozen=True)
class RobotTick:
    """What one robot was told and sent, and what it answered, in one tick."""

    #: ``[3, 11, 11]`` uint8.
    view: Uint8Array
    #: How many messages it could hear.
    audible: int
    #: Those of the first round, as they came; None if not all of them are known.
    payloads: Sequence[bytes] | None
    #: Of them, one of `ENCODINGS`; that of the policy if it is another word.
    encoding: str
    #: Its `Preference`; None if it was silent, or nobody listened.
    preference: Any = None
    #: To go by where that is not there because nobody listened.
    fate: TickOutcome | None = None


@dataclass(frozen=True)
class _Reconstruction:
    """What is known of a robot's deciding."""

    #: Why no attention is known.
    why: str
    probabilities: list[float] | None = None
    primitive: int | None = None
    heard: int | None = None
    #: By neighbour and head.
    attention: dict[int, list[float]] = field(default_factory=dict)


def detail(robot: int, moment: TeamSnapshot, said: RobotTick, policy: "Policy | str") -> dict[str, Any]:
    """All that is shown of ``robot`` at ``moment``.

    Args:
        robot: its number.
        moment: where all robots were.
        said: to it, and by it.
        policy: the one that it carries, or why that is not known.

    Returns:
        ``view``: for each channel a text of 121 digits; ``probabilities``: of the five primitives, None if it was
        silent, or nothing can be said; ``neighbours``: who is in range, with ``attention`` (by head; None if that robot
        was not heard, or nothing can be said), and ``why`` nothing can be said.
    """
    near = _near(robot, moment.positions)
    if said.preference is None and said.fate is not None:
        mind = _followed(moment, near, said, said.fate, policy)
    else:
        attention, why = _attention(moment, near, said, policy)
        mind = _Reconstruction(why, attention=attention)
        if (wish := said.preference) is not None:
            mind = _Reconstruction(
                why, _probabilities(wish.log_probabilities), int(wish.primitive), int(wish.heard), attention
            )
    return {
        "kind": "detail",
        "robot": robot,
        "tick": moment.tick,
        "view": ["".join(map(str, channel.ravel().tolist())) for channel in said.view],
        "probabilities": mind.probabilities,
        "primitive": mind.primitive,
        "audible": said.audible,
        "heard": mind.heard,
        "neighbours": [{"robot": other, "attention": mind.attention.get(other)} for other in near],
        "why": mind.why,
    }


def _followed(
    moment: TeamSnapshot, near: list[int], said: RobotTick, fate: TickOutcome, policy: "Policy | str"
) -> _Reconstruction:
    """What a robot must have state that heard all of ``near`` in a tick of at most one round; else nothing."""
    if fate.silent:
        return _Reconstruction("it did not answer")
    if why := _unknowable(moment, policy):
        return _Reconstruction(why, primitive=fate.action)
    assert not isinstance(policy, str)
    unheard = _Reconstruction(UNHEARD, primitive=fate.action)
    if policy.rounds > 1 or fate.missing or said.audible != len(near):
        return unheard
    own = policy.perceive(said.view[None])
    attention, why = {}, _no_attention(policy)
    messages, present = _messages(_spoken(moment, near, policy), _encoding(said, policy))
    if policy.config.communicates:
        attention = _by_neighbour(policy, own, messages, present, near)
    own = policy.hear(own, messages, present)
    decision = policy.decide(own, np.array([fate.stream], dtype=np.uint64), moment.tick)
    if decision.primitives[0] != fate.action:
        return unheard
    return _Reconstruction(why, _probabilities(decision.log_probabilities[0]), fate.action, said.audible, attention)


def _probabilities(logarithms: Any) -> list[float]:
    """From 0 to 1, whatever a robot says: JSON has no other numbers."""
    return np.nan_to_num(np.exp(np.minimum(np.asarray(logarithms, dtype=np.float64), 0.0))).round(4).tolist()


def _near(robot: int, positions: IntArray) -> list[int]:
    row = neighbours(np.zeros(len(positions), dtype=np.int64), positions)[robot]
    return row[row >= 0].tolist()


def _attention(
    moment: TeamSnapshot, near: list[int], said: RobotTick, policy: "Policy | str"
) -> tuple[dict[int, list[float]], str]:
    """How much the robot listened to those of ``near`` that it heard, by head; and why nothing is known of it."""
    if why := _unknowable(moment, policy):
        return {}, why
    assert not isinstance(policy, str)
    if not policy.config.communicates:
        return {}, _no_attention(policy)
    nothing = said.payloads is not None and not said.payloads
    if not near or not said.audible or nothing:
        return {}, ""
    if said.payloads is None:
        return {}, "it did not answer" if said.preference is None else UNHEARD
    encoding = _encoding(said, policy)
    left, heard, spoken = Counter(said.payloads), [], _spoken(moment, near, policy)
    for place, values in enumerate(spoken):
        data = payload.encode(values, encoding)
        if left[data] > 0:
            left[data] -= 1
            heard.append(place)
    if left.total():
        return {}, f"what it heard is not what {policy.config.name} says: do the robots carry another policy?"
    messages, present = _messages(spoken[heard], encoding)
    return _by_neighbour(policy, policy.perceive(said.view[None]), messages, present, [near[at] for at in heard]), ""


def _unknowable(moment: TeamSnapshot, policy: "Policy | str") -> str:
    """Why nothing can be computed again; nothing if it can."""
    if isinstance(policy, str):
        return policy
    return "" if moment.obstacles is not None else "the map is not known before the next episode begins"


def _no_attention(policy: "Policy") -> str:
    """Why there is no attention with this policy; empty if there is."""
    return "" if policy.config.communicates else f"robots with {policy.config.name} and K = 1 do not communicate"


def _encoding(said: RobotTick, policy: "Policy") -> str:
    return said.encoding if said.encoding in ENCODINGS else policy.config.encoding


def _spoken(moment: TeamSnapshot, near: list[int], policy: "Policy") -> npt.NDArray[np.float32]:
    """``[len(near), n]`` what those must have said in the first round."""
    return policy.perceive(moment.views(near)).messages


def _messages(spoken: npt.NDArray[np.float32], encoding: str) -> tuple[npt.NDArray[np.float32], BoolArray]:
    """What one robot hears of it, as `Policy.hear` takes it."""
    return payload.carried(spoken, encoding)[None], np.ones((1, len(spoken)), dtype=bool)


def _by_neighbour(
    policy: "Policy", own: "LatentState", messages: npt.NDArray[np.float32], present: BoolArray, heard: list[int]
) -> dict[int, list[float]]:
    """The attention to each of ``heard``, by head."""
    weights = policy.attention(own, messages, present)[0]
    return {other: weights[:, column].round(4).tolist() for column, other in enumerate(heard)}
