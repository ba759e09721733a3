# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recorded team as a source for the page. Free of ROS."""

from collections.abc import Collection

import numpy as np

from magat_recording.tables import RecordedEpisode, TeamRecording
from magat_robot.policy.computed import ComputedPolicy
from magat_robot.policy.config import ENCODING_NAMES, OBSERVATION_SHAPE
from magat_viewer.detail import RobotDetail, RobotTick, TeamSnapshot, robot_detail
from magat_viewer.health import HealthReport, TeamHealth
from magat_viewer.watched_episode import EpisodeResult, Scene, WatchedEpisode


class RecordedTeam:
    """A recording as a `magat_viewer.source.Source`. All frames of an episode are sent at once."""

    live = False

    def __init__(self, recording: TeamRecording, policy: ComputedPolicy | str, title: str) -> None:
        """Show ``recording``; ``policy`` is that of the robots, or the reason why it is not known."""
        self.title = title
        self._recording, self._policy = recording, policy
        self._health, self._end = TeamHealth(), 0.0
        for message in recording.statuses:
            self._end = message.received / 1e9
            self._health.add_status(message.message, self._end)
        self._watched: list[WatchedEpisode] = []
        self._frames: list[bytes] = []
        for episode in recording.all_episodes:
            worlds = episode.log.worlds
            watched = WatchedEpisode(episode.number, worlds[0])
            frames = [watched.frame()]
            for tick in range(1, len(worlds)):
                watched.step(worlds[tick])
                frames.append(watched.frame())
            self._watched.append(watched)
            self._frames.append(b"".join(frames))
        self._results = [watched.result() for watched in self._watched]

    def poll(self, chosen: Collection[int]) -> None:
        """Do nothing: a recording does not change."""

    @property
    def newest(self) -> int:
        """Number of the last episode."""
        return len(self._watched) - 1

    def results(self) -> list[EpisodeResult]:
        """The results of all episodes."""
        return self._results

    def scene(self, episode: int) -> Scene:
        """What does not change during an episode."""
        return self._watched[episode].scene()

    def frames(self, episode: int, after: int) -> tuple[int, bytes]:
        """The last tick, and all frames of an episode; no frames after the last tick."""
        last = self._watched[episode].tick
        return last, self._frames[episode] if after < last else b""

    def health(self, episode: int) -> HealthReport:
        """The health at the end of the recording, with the silent robots of this episode."""
        watched = self._watched[episode]
        return self._health.report(watched.robots, watched.silences.tolist(), self._end)

    def detail(self, episode: int, tick: int, robot: int) -> RobotDetail | None:
        """The detail of a robot at ``tick``; None if the recording does not have its observation."""
        shown, watched = self._recording.all_episodes[episode], self._watched[episode]
        if tick >= watched.tick or robot >= len(self._recording.names):
            return None
        messages = recorded_tick(shown, tick, robot)
        if messages is None:
            return None
        snapshot = TeamSnapshot(tick, shown.log.positions[tick], watched.goals, watched.obstacles)
        return robot_detail(robot, snapshot, messages, self._policy)


def recorded_tick(episode: RecordedEpisode, tick: int, robot: int) -> RobotTick | None:
    """The messages to and from one robot in one tick; None if the recording does not have its observation."""
    messages = episode.ticks[tick]
    received = messages.observations.get(robot)
    if received is None:
        return None
    observation = received.message
    tags = observation.audible_tags
    features = [messages.features[tag, 0].message for tag in tags if (tag, 0) in messages.features]
    preference = messages.preferences.get(observation.own_tag)
    return RobotTick(
        field_of_view=np.frombuffer(observation.field_of_view, dtype=np.uint8).reshape(OBSERVATION_SHAPE),
        audible=len(tags),
        stream=observation.stream,
        payloads=[bytes(feature.payload) for feature in features],
        encoding=ENCODING_NAMES.get(features[0].encoding, "") if features else "",
        preference=None if preference is None else preference.message,
    )
