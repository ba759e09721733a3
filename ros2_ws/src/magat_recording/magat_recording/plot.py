"""``magat plot``: pictures of recorded teams for papers, with whom robots listened to, and animations."""

from pathlib import Path

import numpy as np
from rich.console import Console

from magat_node.progress import progress_bars
from magat_pictures.animation import save_animation
from magat_pictures.drawn_episode import DrawnEpisode
from magat_pictures.picture import Attention, save_picture
from magat_recording.attention import links_of
from magat_recording.bag import BagError
from magat_recording.findings import carried_policy
from magat_recording.tables import RecordedEpisode, TeamRecording
from magat_robot.policy.policy import Policy

#: What pictures are written as, and what animations are.
PICTURES, ANIMATION = (".svg", ".png", ".pdf"), ".gif"


def plot(
    bag: Path, episode: int, tick: int | None, robot: str | None, policy: str | None, output: Path, console: Console
) -> None:
    """Draw an episode: all paths, and the links and attention at one tick; or all of it as an animation.

    Args:
        bag: folder or file.
        episode: number of the episode, from 0.
        tick: whose links are drawn; the one with most links if None.
        robot: name of the one whose attention alone is drawn; that of all if None.
        policy: name or folder of what the robots carried; found by its digest if None.
        output: file to write, an animation if it is a GIF.
        console: shows what goes on, and what cannot be drawn.

    Raises:
        BagError: it cannot be read, or there is no such episode, tick or robot in it, or no such kind of file.
        ModelError: there is no policy ``policy``.
    """
    kinds = [*PICTURES, ANIMATION]
    if output.suffix not in kinds:
        raise BagError(f"{output} is none of the files that can be written: end its name in {', '.join(kinds)}")
    with console.status(f"reading {bag}"):
        recording = TeamRecording(bag)
    if not 0 <= episode < len(recording.all_episodes):
        raise BagError(f"{bag} has no episode {episode}: it has 0 to {len(recording.all_episodes) - 1}")
    if robot is not None and robot not in recording.names:
        raise BagError(f"{bag} has no robot {robot!r}: it has {', '.join(recording.names)}")
    shown = recording.all_episodes[episode]
    record = _record(shown, recording)
    at = int(np.argmax([len(pairs) for pairs in record.links])) if tick is None else tick
    if not 0 <= at <= record.steps:
        raise BagError(f"episode {episode} of {bag} has no tick {at}: it has 0 to {record.steps}")
    carried, why = carried_policy(recording, policy)
    if carried is None:
        console.print(f"Without attention: {why}", markup=False)
    chosen = None if robot is None else recording.names.index(robot)
    if output.suffix == ANIMATION:
        with progress_bars(console) as progress:
            task = progress.add_task("drawing")
            attention = _attention(recording, shown, carried)
            if attention is not None and chosen is not None:
                attention = [{link: share for link, share in one.items() if link[0] == chosen} for one in attention]
            save_animation(record, output, lambda done, of: progress.update(task, completed=done, total=of), attention)
    else:
        of_tick = _attention(recording, shown, carried, at)
        save_picture(record, output, at, None if of_tick is None else Attention(of_tick[at], chosen))
    console.print(f"The episode is in {output}", highlight=False)


def _record(episode: RecordedEpisode, recording: TeamRecording) -> DrawnEpisode:
    seen = episode.recording
    carried = recording.equipment.policy if recording.equipment is not None else "unknown policy"
    height, width = seen.obstacles.shape
    return DrawnEpisode(
        obstacles=seen.obstacles,
        goals=seen.goals,
        positions=seen.positions,
        blocked=seen.blocked,
        title=f"{carried}, {width}x{height}, {len(seen.robots)} robots",
    )


def _attention(
    recording: TeamRecording, episode: RecordedEpisode, policy: Policy | None, tick: int | None = None
) -> list[dict[tuple[int, int], float]] | None:
    """By receiver and sender, of all ticks or one, in the first round, the mean over the heads; None if not known."""
    if policy is None or not policy.config.communicates:
        return None
    table = links_of(recording, episode, policy, tick)
    if table is None:
        return None
    found: list[dict[tuple[int, int], float]] = [{} for _ in episode.recording.positions]
    first = table[table["round"] == 0].groupby(["tick", "receiver", "sender"]).attention.mean()
    for (at, receiver, sender), share in first.items():
        found[at][receiver, sender] = share
    return found
