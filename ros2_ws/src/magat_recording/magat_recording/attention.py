"""Whom the robots of a recording listened to: attention, computed again from what they sent, with their own policy.

Attention is on no topic. But the sums of a deployed policy have no order (`magat_robot.policy.fixed_point`), so what
is computed from the recorded observations and features is, to the last bit, what the robots computed.
"""

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pandas as pd

from magat_recording.bag import BagError
from magat_recording.tables import RecordedEpisode, RecordedTick, TeamRecording
from magat_robot.policy import payload
from magat_robot.policy.config import ENCODING_NAMES, OBSERVATION_SHAPE
from magat_robot.policy.policy import Policy
from magat_sim.grid import DELTAS, IntArray


def links(recording: TeamRecording, policy: Policy | None = None) -> pd.DataFrame:
    """Who could hear whom, from how far, and how much it listened.

    Args:
        recording: of the team.
        policy: the one that the robots carry; without it there are no columns ``round``, ``head`` and ``attention``.

    Returns:
        One row a tick, receiver and sender, and with a policy round and head. Columns: ``episode``, ``tick``,
        ``receiver``, ``sender``; ``distance`` (cells, Euclidean); ``neighbours`` (of the receiver); ``conflict`` (both
        want the same cell, or each other's); ``round``, ``head``, ``attention``: the weight e_ij, which of all that a
        receiver hears is 1 in sum (or, of a GNN that adds up, 1 each). Features that the recording lacks are left out.

    Raises:
        BagError: the features are not what ``policy`` makes of the observations.
    """
    parts = [part for episode in recording.all_episodes if (part := _links(recording, episode, policy)) is not None]
    if not parts:
        return pd.DataFrame(columns=["episode", "tick", "receiver", "sender", "distance", "neighbours", "conflict"])
    return pd.concat(parts, ignore_index=True)


def links_of(
    recording: TeamRecording, episode: RecordedEpisode, policy: Policy, tick: int | None = None
) -> pd.DataFrame | None:
    """As `links`, of ``episode`` alone, and of one tick of it if that is given; None if nobody heard anybody.

    Raises:
        BagError: the features are not what ``policy`` makes of the observations.
    """
    if tick is not None:
        episode = replace(episode, ticks=defaultdict(RecordedTick, {tick: episode.ticks[tick]}))
    return _links(recording, episode, policy)


def _links(recording: TeamRecording, episode: RecordedEpisode, policy: Policy | None) -> pd.DataFrame | None:
    """Those of one episode; all its observations are rows of one batch."""
    rows = [(tick, said, robot) for tick, said in episode.steps() for robot in sorted(said.observations)]
    row_of = {(tick, robot): row for row, (tick, _, robot) in enumerate(rows)}
    audible = [_audible(said, robot) for _, said, robot in rows]
    most = max(map(len, audible), default=0)
    if most == 0:
        return None
    senders = np.full((len(rows), most), -1)
    heard = np.full((len(rows), most), -1)
    for index, ((at, _, _), robots) in enumerate(zip(rows, audible, strict=True)):
        senders[index, : len(robots)] = robots
        heard[index, : len(robots)] = [row_of[at, robot] for robot in robots]
    row, place = np.nonzero(senders >= 0)
    tick, receiver = np.array([(tick, robot) for tick, _, robot in rows]).T
    sender = senders[row, place]
    positions = episode.recording.positions
    here, there = positions[tick[row], receiver[row]], positions[tick[row], sender]
    action = positions[:-1] + DELTAS[episode.recording.action]
    table = pd.DataFrame(
        {
            "episode": episode.number,
            "tick": tick[row],
            "receiver": receiver[row],
            "sender": sender,
            "distance": np.hypot(*(here - there).T),
            "neighbours": (senders >= 0).sum(axis=1)[row],
            "conflict": _conflict(here, there, action[tick[row], receiver[row]], action[tick[row], sender]),
        }
    )
    if policy is None or not policy.config.communicates:
        return table
    parts = []
    for number, (weights, present) in enumerate(_weights(recording, rows, heard, policy)):
        known = present[row, place]
        for head in range(weights.shape[1]):
            part = table[known].assign(round=number, head=head, attention=weights[row, head, place][known])
            parts.append(part)
    return pd.concat(parts, ignore_index=True)


def _audible(said: RecordedTick, robot: int) -> list[int]:
    """The robots that one can hear, as far as the recording knows who they are."""
    tags = said.observations[robot].message.audible_tags
    return sorted(said.senders[tag] for tag in tags if tag in said.senders)


def _conflict(here: IntArray, there: IntArray, action: IntArray, other: IntArray) -> np.ndarray:
    """``[L]`` bool: a vertex conflict of what two robots want, or a swap conflict."""
    vertex = (action == other).all(axis=1)
    swap = (action == there).all(axis=1) & (other == here).all(axis=1)
    return vertex | swap


def _weights(
    recording: TeamRecording, rows: list[tuple[int, RecordedTick, int]], heard: IntArray, policy: Policy
) -> list[tuple[np.ndarray, np.ndarray]]:
    """By round: how much each row listens to each place, ``[R, P, M]``, and which places hold a message, ``[R, M]``."""
    views = [np.frombuffer(said.observations[robot].message.field_of_view, np.uint8) for _, said, robot in rows]
    own = policy.perceive(np.stack(views).reshape(-1, *OBSERVATION_SHAPE))
    result = []
    for number, size in enumerate(policy.config.message_sizes):
        sent = np.zeros((len(rows), size), dtype=np.float32)
        there = np.zeros(len(rows), dtype=bool)
        encoding = policy.config.encoding
        for row, (_, said, robot) in enumerate(rows):
            feature = said.features.get((said.observations[robot].message.own_tag, number))
            if feature is not None:
                encoding, there[row] = ENCODING_NAMES[feature.message.encoding], True
                sent[row] = payload.decode(feature.message.payload, size, encoding, policy.config.largest)
        if not (payload.carried(own.messages, encoding) == sent)[there].all() and number == 0:
            raise BagError(
                f"the recorded features are not those of {policy.config.name} ({policy.digest[:12]}): name the policy "
                "that the robots carried (robots of the backend echo carry none)"
            )
        places = np.maximum(heard, 0)
        present = (heard >= 0) & there[places]
        messages = sent[places]
        result.append((policy.attention(own, messages, present), present))
        own = policy.hear(own, messages, present)
    return result


def preference_for(links: pd.DataFrame, by: str) -> pd.DataFrame:
    """How much more than all others alike a robot listens to some.

    Args:
        links: with attention; those of robots that hear only one are left out, because that has all of it.
        by: a column to group by; of distances those up to 1, to 2 and so on.

    Returns:
        One row a group: its value (column ``by``); ``relative`` (attention times neighbours: 1 where all weigh alike),
        ``half_width`` of its 95 % interval (normal approximation), ``links``.
    """
    some = links[links.neighbours > 1]
    key = np.ceil(some.distance).astype(int) if by == "distance" else some[by]
    return _means((some.attention * some.neighbours).rename("relative"), key.rename(by), "links")


def listened_to(links: pd.DataFrame) -> pd.DataFrame:
    """To how many of its neighbours a robot effectively listens: the perplexity of its attention.

    Returns:
        One row a number of ``neighbours``: ``effective`` (from 1: to one only, to all of them: to all alike),
        ``half_width`` of its 95 % interval, ``robots`` (how often).
    """
    weights = links.attention.clip(lower=1e-12)
    entropy = (-weights * np.log(weights)).groupby([links[name] for name in _ONE_ROBOT]).sum()
    return _means(
        np.exp(entropy).rename("effective"),
        entropy.index.get_level_values("neighbours").to_series(entropy.index),
        "robots",
    )


def received(links: pd.DataFrame) -> pd.Series:
    """By sender: the attention that all who hear a robot pay to it in a tick, mean over ticks, rounds and heads."""
    together = links.groupby(["episode", "tick", "round", "head", "sender"]).attention.sum()
    return together.groupby("sender").mean()


_ONE_ROBOT = ["episode", "tick", "round", "head", "receiver", "neighbours"]


def _means(values: pd.Series, key: pd.Series, counted: str) -> pd.DataFrame:
    groups = values.groupby(key.rename(key.name or "neighbours"))
    table = pd.DataFrame({values.name: groups.mean(), "half_width": 1.959964 * groups.sem(), counted: groups.count()})
    return table.reset_index()
