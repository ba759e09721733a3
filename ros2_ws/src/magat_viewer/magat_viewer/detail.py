"""What the chosen robot saw, heard and decided in one tick, as JSON values. Free of ROS.

Attention is on no topic, but it can be computed again from what was seen and heard: as a deployed policy's sums have no
order, it is, to the last bit, what the robot computed. No message says who sent it. But what each neighbour must have
said follows from the world, to the last bit, too, and by that each is known. Two that said the same are heard alike.
So nobody has to listen to features, at a cost to the team, for as long as the robot says that it heard all in range,
and wants what it should want then.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from magat_robot.policy import payload
from magat_robot.policy.config import ENCODINGS, OBSERVATION_SHAPE
from magat_sim.field_of_view import Uint8Array, field_of_view, pad
from magat_sim.grid import BoolArray, IntArray
from magat_sim.radio import neighbours

if TYPE_CHECKING:
    from magat_robot.policy.interface import Encoding
    from magat_robot.policy.policy import Policy  # torch takes a second to import, and is not always needed

#: Why nothing is known of a robot's attention: somebody would have to listen to the features.
UNHEARD = "which robots it heard is being found out"
#: Two probabilities that differ by less are the same: a `Preference` carries float32.
_CLOSE = 1e-5


@dataclass(frozen=True)
class Moment:
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
class Said:
    """What one robot was told and sent, and what it answered, in one tick."""

    #: ``[3, 11, 11]`` uint8.
    view: Uint8Array
    #: How many messages it could hear.
    audible: int
    #: Those of the first round, as they came; None if nobody listened.
    payloads: Sequence[bytes] | None
    #: Of them, one of `ENCODINGS`; that of the policy if it is another word.
    encoding: str
    #: Its `Preference`; None if it was silent.
    preference: Any = None


def detail(robot: int, moment: Moment, said: Said, policy: "Policy | str") -> dict[str, Any]:
    """All that is shown of ``robot`` at ``moment``.

    Args:
        robot: its number.
        moment: where all robots were.
        said: to it, and by it.
        policy: the one that it carries, or why that is not known.

    Returns:
        ``view``: for each channel a text of 121 digits; ``probabilities``: of the five primitives, None if it was
        silent; ``neighbours``: who is in range, with ``attention`` (by head; None if that robot was not heard, or
        nothing can be said), and ``why`` nothing can be said.
    """
    near = _near(robot, moment.positions)
    weights, why = _weights(moment, near, said, policy)
    preference = said.preference
    return {
        "kind": "detail",
        "robot": robot,
        "tick": moment.tick,
        "view": ["".join(map(str, channel.ravel().tolist())) for channel in said.view],
        "probabilities": None if preference is None else _probabilities(preference.log_probabilities),
        "primitive": None if preference is None else int(preference.primitive),
        "audible": said.audible,
        "heard": None if preference is None else int(preference.heard),
        "milliseconds": None if preference is None else preference.compute_us / 1e3,
        "neighbours": [{"robot": other, "attention": weights.get(other)} for other in near],
        "why": why,
    }


def _probabilities(logarithms: Any) -> list[float]:
    """From 0 to 1, whatever a robot says: JSON has no other numbers."""
    return np.nan_to_num(np.exp(np.minimum(logarithms, 0.0))).round(4).tolist()


def _near(robot: int, positions: IntArray) -> list[int]:
    row = neighbours(np.zeros(len(positions), dtype=np.int64), positions)[robot]
    return row[row >= 0].tolist()


def _weights(moment: Moment, near: list[int], said: Said, policy: "Policy | str") -> tuple[dict[int, list[float]], str]:
    """How much the robot listened to those of ``near`` that it heard, by head; and why nothing is known of it."""
    if isinstance(policy, str):
        return {}, policy
    if policy.config.taps == 1:
        return {}, f"robots with {policy.config.name} do not talk"
    if moment.obstacles is None:
        return {}, "the map is not known before the next episode begins"
    nothing = said.payloads is not None and not said.payloads
    if not near or not said.audible or nothing:
        return {}, ""
    encoding = said.encoding if said.encoding in ENCODINGS else policy.config.encoding
    spoken = policy.encode(moment.views(near)).messages
    if said.payloads is not None:
        left, heard = Counter(said.payloads), []
        for place, values in enumerate(spoken):
            data = payload.encode(values, encoding)
            if left[data] > 0:
                left[data] -= 1
                heard.append(place)
        if left.total():
            return {}, f"what it heard is not what {policy.config.name} says: do the robots carry another policy?"
    elif said.preference is None:
        return {}, "it did not answer"
    elif said.preference.heard == said.audible == len(near):
        heard = list(range(len(near)))
    else:
        return {}, UNHEARD
    messages = payload.carried(spoken[heard], encoding)[None]
    present = np.ones((1, len(heard)), dtype=bool)
    own = policy.encode(said.view.reshape(1, *OBSERVATION_SHAPE))
    if said.payloads is None and not _wanted(policy, policy.hear(own, messages, present), said.preference):
        return {}, UNHEARD
    weights = policy.attention(own, messages, present)
    return {near[place]: weights[0, :, column].round(4).tolist() for column, place in enumerate(heard)}, ""


def _wanted(policy: "Policy", own: "Encoding", preference: Any) -> bool:
    """Whether a robot that knows ``own`` after the first round wants what it said; after more, nothing is known."""
    if policy.rounds > 1:
        return True
    [weights] = policy.weights(own)
    return bool(np.allclose(weights / weights.sum(), np.exp(preference.log_probabilities), atol=_CLOSE))
