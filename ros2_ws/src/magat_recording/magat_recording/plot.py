# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat plot``: pictures and animations of recorded episodes, with the robots' attention."""

from pathlib import Path

import numpy as np
from rich.console import Console

from magat_node.progress import progress_bars
from magat_pictures.animation import save_animation
from magat_pictures.drawn_episode import DrawnEpisode
from magat_pictures.picture import Attention, save_picture
from magat_recording.attention import episode_links
from magat_recording.bag import BagError
from magat_recording.findings import attention_policy
from magat_recording.tables import RecordedEpisode, TeamRecording
from magat_robot.policy.computed import ComputedPolicy

#: File types of pictures and of animations.
PICTURES, ANIMATION = (".svg", ".png", ".pdf"), ".gif"


def plot(
    bag: Path, episode: int, tick: int | None, robot: str | None, policy: str | None, output: Path, console: Console
) -> None:
    """Draw an episode: all paths, and the links and attention of one tick; or the whole episode as an animation.

    Args:
        bag: folder or file.
        episode: number of the episode, from 0.
        tick: the tick whose links are drawn; the one with most links if None.
        robot: name of the only robot whose attention is drawn; all robots if None.
        policy: name or folder of the robots' policy; found by its digest if None.
        output: file to write, an animation if it is a GIF.
        console: shows the progress, and why there is no attention.

    Raises:
        BagError: the bag cannot be read, it has no such episode, tick or robot, or ``output`` has an unknown file type.
        ModelError: there is no policy ``policy``.
    """
    kinds = [*PICTURES, ANIMATION]
    if output.suffix not in kinds:
        raise BagError(f"{output} has an unknown file type: end its name in {', '.join(kinds)}")
    with console.status(f"reading {bag}"):
        recording = TeamRecording(bag)
    if not 0 <= episode < len(recording.all_episodes):
        raise BagError(f"{bag} has no episode {episode}: it has 0 to {len(recording.all_episodes) - 1}")
    if robot is not None and robot not in recording.names:
        raise BagError(f"{bag} has no robot {robot!r}: it has {', '.join(recording.names)}")
    shown = recording.all_episodes[episode]
    drawn = _drawn_episode(shown, recording)
    at = int(np.argmax([len(pairs) for pairs in drawn.links])) if tick is None else tick
    if not 0 <= at <= drawn.steps:
        raise BagError(f"episode {episode} of {bag} has no tick {at}: it has 0 to {drawn.steps}")
    carried, no_attention = attention_policy(recording, policy)
    if no_attention:
        console.print(f"Without attention: {no_attention}", markup=False)
    chosen = None if robot is None else recording.names.index(robot)
    if output.suffix == ANIMATION:
        with progress_bars(console) as progress:
            task = progress.add_task("drawing")
            attention = _attention(shown, carried)
            if attention is not None and chosen is not None:
                attention = [{link: share for link, share in one.items() if link[0] == chosen} for one in attention]
            save_animation(drawn, output, lambda done, of: progress.update(task, completed=done, total=of), attention)
    else:
        of_tick = _attention(shown, carried, at)
        save_picture(drawn, output, at, None if of_tick is None else Attention(of_tick[at], chosen))
    console.print(f"The episode is in {output}", highlight=False)


def _drawn_episode(episode: RecordedEpisode, recording: TeamRecording) -> DrawnEpisode:
    log = episode.log
    policy = recording.last_status.policy if recording.last_status is not None else "unknown policy"
    height, width = log.obstacles.shape
    return DrawnEpisode(
        obstacles=log.obstacles,
        goals=log.goals,
        positions=log.positions,
        blocked=log.blocked,
        title=f"{policy}, {width}x{height}, {len(log.robots)} robots",
    )


def _attention(
    episode: RecordedEpisode, policy: ComputedPolicy | None, tick: int | None = None
) -> list[dict[tuple[int, int], float]] | None:
    """For each instant the attention of the first round by receiver and sender, mean over heads; None if there is none.

    Args:
        episode: of the recording.
        policy: of the robots; None if it is not known.
        tick: the only tick whose attention is computed; all if None.
    """
    if policy is None or not policy.config.communicates:
        return None
    table = episode_links(episode, policy, tick)
    if table is None:
        return None
    found: list[dict[tuple[int, int], float]] = [{} for _ in episode.log.positions]
    first = table[table["round"] == 0].groupby(["tick", "receiver", "sender"]).attention.mean()
    for (at, receiver, sender), share in first.items():
        found[at][receiver, sender] = share
    return found
