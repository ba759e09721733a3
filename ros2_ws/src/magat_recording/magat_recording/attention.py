# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Attention of a recorded team, computed again from its messages with the robots' own policy.

Attention is on no topic. But the sums of a deployed policy do not depend on their order
(`magat_robot.policy.fixed_point`), so attention that is computed from the recorded observations and features equals
that of the robots, to the last bit.
"""

from collections import defaultdict
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from magat_recording.bag import BagError
from magat_recording.tables import RecordedEpisode, RecordedTick, TeamRecording
from magat_robot.policy import payload
from magat_robot.policy.computed import ComputedPolicy
from magat_robot.policy.config import ENCODING_NAMES, OBSERVATION_SHAPE
from magat_sim.grid import DELTAS, BoolArray, IntArray
from magat_sim.measures import Z_95

#: The columns by which one robot's attention in one round is found.
_ONE_ROBOT = ["episode", "tick", "round", "head", "receiver", "neighbours"]


def links(recording: TeamRecording, policy: ComputedPolicy | None = None) -> pd.DataFrame:
    """The radio links of all ticks, with the attention that the receiver pays to the sender.

    Args:
        recording: of the team.
        policy: the one that the robots carry. Without it, or if its robots do not communicate (K = 1), there are no
            columns ``round``, ``head`` and ``attention``.

    Returns:
        One row for each tick, receiver and sender, and with a policy for each round and head. Columns: ``episode``,
        ``tick``, ``receiver``, ``sender``; ``distance`` (cells, Euclidean); ``neighbours`` (of the receiver);
        ``conflict`` (both robots want the same cell, or each other's); ``round``, ``head``; ``attention`` (the weight
        e_ij of Eq. 7, whose sum over a receiver's messages is 1; with a GNN that is not normalised each is 1). Features
        that the recording lacks have no rows.

    Raises:
        BagError: the features are not what ``policy`` computes from the observations.
    """
    parts = [part for episode in recording.all_episodes if (part := episode_links(episode, policy)) is not None]
    if not parts:
        return pd.DataFrame(columns=["episode", "tick", "receiver", "sender", "distance", "neighbours", "conflict"])
    return pd.concat(parts, ignore_index=True)


def episode_links(
    episode: RecordedEpisode, policy: ComputedPolicy | None, tick: int | None = None
) -> pd.DataFrame | None:
    """As `links`, of ``episode`` alone, and of one tick of it if that is given; None if there are no links.

    Raises:
        BagError: the features are not what ``policy`` computes from the observations.
    """
    if tick is not None:
        episode = replace(episode, ticks=defaultdict(RecordedTick, {tick: episode.ticks[tick]}))
    # All observations of the episode are the rows of one batch.
    rows = [(at, messages, robot) for at, messages in episode.steps() for robot in sorted(messages.observations)]
    row_of = {(at, robot): row for row, (at, _, robot) in enumerate(rows)}
    audible = [_audible_robots(messages, robot) for _, messages, robot in rows]
    most = max(map(len, audible), default=0)
    if most == 0:
        return None
    senders = np.full((len(rows), most), -1)
    sender_rows = np.full((len(rows), most), -1)
    for index, ((at, _, _), robots) in enumerate(zip(rows, audible, strict=True)):
        senders[index, : len(robots)] = robots
        sender_rows[index, : len(robots)] = [row_of[at, robot] for robot in robots]
    table = _link_table(episode, rows, senders)
    if policy is None or not policy.config.communicates:
        return table
    row, place = np.nonzero(senders >= 0)
    parts = []
    for number, (weights, present) in enumerate(_weights(rows, sender_rows, policy)):
        known = present[row, place]
        for head in range(weights.shape[1]):
            part = table[known].assign(round=number, head=head, attention=weights[row, head, place][known])
            parts.append(part)
    return pd.concat(parts, ignore_index=True)


def _link_table(episode: RecordedEpisode, rows: list[tuple[int, RecordedTick, int]], senders: IntArray) -> pd.DataFrame:
    """The columns of `links` that need no policy; ``senders`` are ``[R, M]`` robots, -1 in empty places."""
    row, place = np.nonzero(senders >= 0)
    tick, receiver = np.array([(at, robot) for at, _, robot in rows]).T
    sender = senders[row, place]
    positions = episode.log.positions
    here, there = positions[tick[row], receiver[row]], positions[tick[row], sender]
    target = positions[:-1] + DELTAS[episode.log.action]
    return pd.DataFrame(
        {
            "episode": episode.number,
            "tick": tick[row],
            "receiver": receiver[row],
            "sender": sender,
            "distance": np.hypot(*(here - there).T),
            "neighbours": (senders >= 0).sum(axis=1)[row],
            "conflict": _conflict(here, there, target[tick[row], receiver[row]], target[tick[row], sender]),
        }
    )


def _audible_robots(messages: RecordedTick, robot: int) -> list[int]:
    """The robots that ``robot`` can hear, as far as the recording has their observations."""
    tags = messages.observations[robot].message.audible_tags
    return sorted(messages.senders[tag] for tag in tags if tag in messages.senders)


def _conflict(here: IntArray, there: IntArray, target: IntArray, other_target: IntArray) -> BoolArray:
    """``[L]`` bool: a vertex conflict or a swap conflict of the moves that two robots want, all ``[L, 2]`` cells."""
    vertex = (target == other_target).all(axis=1)
    swap = (target == there).all(axis=1) & (other_target == here).all(axis=1)
    return vertex | swap


def _weights(
    rows: list[tuple[int, RecordedTick, int]], sender_rows: IntArray, policy: ComputedPolicy
) -> list[tuple[npt.NDArray[np.float64], BoolArray]]:
    """For each round the attention of rows to places, ``[R, P, M]``, and which places hold a message, ``[R, M]``."""
    views = [np.frombuffer(messages.observations[robot].message.field_of_view, np.uint8) for _, messages, robot in rows]
    latent = policy.perceive(np.stack(views).reshape(-1, *OBSERVATION_SHAPE))
    result = []
    for number, size in enumerate(policy.config.message_sizes):
        sent = np.zeros((len(rows), size), dtype=np.float32)
        recorded = np.zeros(len(rows), dtype=bool)
        encoding = policy.config.encoding
        for row, (_, messages, robot) in enumerate(rows):
            feature = messages.features.get((messages.observations[robot].message.own_tag, number))
            if feature is not None:
                encoding, recorded[row] = ENCODING_NAMES[feature.message.encoding], True
                sent[row] = payload.decode(feature.message.payload, size, encoding, policy.config.largest)
        if number == 0 and not (payload.round_trip(latent.messages, encoding) == sent)[recorded].all():
            raise BagError(
                f"the recorded features are not those of {policy.config.name} ({policy.digest[:12]}): name the policy "
                "that the robots carried (robots with the backend echo carry none)"
            )
        places = np.maximum(sender_rows, 0)
        present = (sender_rows >= 0) & recorded[places]
        received = sent[places]
        result.append((policy.attention(latent, received, present), present))
        latent = policy.hear(latent, received, present)
    return result


def relative_attention(links: pd.DataFrame, by: str) -> pd.DataFrame:
    """Attention relative to an equal share, by groups of links.

    Args:
        links: with attention. Robots with one neighbour are ignored, because it gets all of their attention.
        by: the column to group by. Distances are rounded up to whole cells.

    Returns:
        One row for each group: its value (column ``by``); ``relative`` (mean of attention times neighbours: 1 if a
        robot weighs all neighbours alike); ``half_width`` of its 95 % interval; ``links`` (how many).
    """
    several = links[links.neighbours > 1]
    key = np.ceil(several.distance).astype(int) if by == "distance" else several[by]
    return _means((several.attention * several.neighbours).rename("relative"), key.rename(by), "links")


def effective_neighbours(links: pd.DataFrame) -> pd.DataFrame:
    """The perplexity of a robot's attention: how many neighbours it effectively attends to.

    Returns:
        One row for each number of ``neighbours``: ``effective`` (mean; 1: one neighbour gets all attention, or
        ``neighbours``: all get the same); ``half_width`` of its 95 % interval; ``robots`` (sample size: robots
        in all ticks).
    """
    weights = links.attention.clip(lower=1e-12)
    entropy = (-weights * np.log(weights)).groupby([links[name] for name in _ONE_ROBOT]).sum()
    return _means(
        np.exp(entropy).rename("effective"),
        entropy.index.get_level_values("neighbours").to_series(entropy.index),
        "robots",
    )


def attention_received(links: pd.DataFrame) -> pd.Series:
    """By sender: the sum of the attention of all its receivers in a tick, mean over ticks, rounds and heads."""
    sums = links.groupby(["episode", "tick", "round", "head", "sender"]).attention.sum()
    return sums.groupby("sender").mean()


def _means(values: pd.Series, key: pd.Series, counted: str) -> pd.DataFrame:
    groups = values.groupby(key.rename(key.name or "neighbours"))
    table = pd.DataFrame({values.name: groups.mean(), "half_width": Z_95 * groups.sem(), counted: groups.count()})
    return table.reset_index()
