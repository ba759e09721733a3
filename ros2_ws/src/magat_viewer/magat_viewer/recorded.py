"""A recording, as the page shows it. Free of ROS."""

from collections.abc import Collection
from typing import Any

import numpy as np

from magat_recording.tables import RecordedEpisode, TeamRecording
from magat_robot.policy.config import ENCODING_NAMES, OBSERVATION_SHAPE
from magat_robot.policy.policy import Policy
from magat_viewer.detail import RobotTick, TeamSnapshot, detail
from magat_viewer.health import Health
from magat_viewer.watched_episode import WatchedEpisode


class RecordedTeam:
    """A recording, a `magat_viewer.source.Source`: all of an episode is there at once."""

    live = False

    def __init__(self, recording: TeamRecording, policy: Policy | str, title: str) -> None:
        """Show ``recording``, of robots that carry ``policy`` (or why that is not known)."""
        self.title = title
        self._recording, self._policy = recording, policy
        self._health, self._end = Health(), 0.0
        for message in recording.statuses:
            self._end = message.received / 1e9
            self._health.reported(message.message, self._end)
        self._states, self._frames = [], []
        for episode in recording.all_episodes:
            worlds = episode.log.worlds
            state = WatchedEpisode(episode.number, worlds[0])
            frames = [state.frame()]
            for tick in range(1, len(worlds)):
                state.step(worlds[tick])
                frames.append(state.frame())
            self._states.append(state)
            self._frames.append(b"".join(frames))
        self._results = [state.result() for state in self._states]

    def poll(self, chosen: Collection[int]) -> None:
        """Nothing comes."""

    @property
    def newest(self) -> int:
        """Number of the last episode."""
        return len(self._states) - 1

    def results(self) -> list[dict[str, Any]]:
        """Of all episodes."""
        return self._results

    def scene(self, episode: int) -> dict[str, Any]:
        """What stays of an episode."""
        return self._states[episode].scene()

    def frames(self, episode: int, after: int) -> tuple[int, bytes]:
        """All frames, once."""
        last = self._states[episode].tick
        return last, self._frames[episode] if after < last else b""

    def health(self, episode: int) -> dict[str, Any]:
        """How the processes were at the end of the recording, and who was late in this episode."""
        state = self._states[episode]
        return self._health.report(state.robots, state.silences.tolist(), self._end)

    def detail(self, episode: int, tick: int, robot: int) -> dict[str, Any] | None:
        """What is in the bag of a robot at ``tick``."""
        shown = self._recording.all_episodes[episode]
        if tick >= self._states[episode].tick or robot >= len(self._recording.names):
            return None
        said = heard_in(shown, tick, robot)
        if said is None:
            return None
        state = self._states[episode]
        moment = TeamSnapshot(tick, shown.log.positions[tick], state.goals, state.obstacles)
        return detail(robot, moment, said, self._policy)


def heard_in(episode: RecordedEpisode, tick: int, robot: int) -> RobotTick | None:
    """What one robot was told and heard, and what it answered; None if the bag does not have it."""
    of_tick = episode.ticks[tick]
    told = of_tick.observations.get(robot)
    if told is None:
        return None
    tags = told.message.audible_tags
    heard = [of_tick.features[tag, 0].message for tag in tags if (tag, 0) in of_tick.features]
    wish = of_tick.preferences.get(told.message.own_tag)
    return RobotTick(
        np.frombuffer(told.message.field_of_view, dtype=np.uint8).reshape(OBSERVATION_SHAPE),
        len(tags),
        [bytes(feature.payload) for feature in heard],
        ENCODING_NAMES.get(heard[0].encoding, "") if heard else "",
        None if wish is None else wish.message,
    )
