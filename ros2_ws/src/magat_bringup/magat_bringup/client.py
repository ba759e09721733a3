# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The client of the RunEpisode action: requests episodes and keeps their World messages."""

from collections.abc import Callable
from dataclasses import dataclass

from rclpy.action import ActionClient
from rclpy.task import Future
from std_msgs.msg import Empty

from magat_bringup.processes import TeamProcesses
from magat_interfaces.action import RunEpisode
from magat_node.errors import TeamError
from magat_node.text import shortened
from magat_node.topics import RECORDER_READY, WORLD
from magat_node.visitor import Visitor
from magat_recording.world_log import WorldLog, WorldLogs
from magat_sim.episode_states import NO_MAKESPAN

#: How long to wait for the simulator to appear, seconds.
SIMULATOR_TIMEOUT = 60.0
#: How long to wait for the simulator to accept or refuse an episode, seconds. It answers at once unless it was killed;
#: the middleware takes some time to notice that.
ACCEPTANCE = 5.0
#: How long to wait until the recorder receives from the whole team, seconds.
RECORDER_TIMEOUT = 120.0
#: How long the last messages of an episode may trail behind its result, seconds.
TRAILING = 5.0
#: Most characters of the reason why an episode was not run.
_LONGEST_ERROR = 1000


@dataclass(frozen=True)
class EpisodeOutcome:
    """The result of an episode and its World messages."""

    result: RunEpisode.Result
    recording: WorldLog

    @property
    def recorded(self) -> bool:
        """Whether all World messages of the episode came."""
        return self.recording.complete and len(self.recording.worlds) == self.result.ticks + 1


class EpisodeError(TeamError):
    """The simulator could not run an episode."""

    def __init__(self, result: RunEpisode.Result) -> None:
        """Take the result, whose ``error`` says why."""
        super().__init__(f"the episode failed: {shortened(result.error, _LONGEST_ERROR)}")
        self.result = result
        #: Whether the reason is its case, so that other episodes can be run.
        self.of_case = result.error.startswith(NO_MAKESPAN)


class EpisodeClient(Visitor):
    """Runs episodes on a team, in a ``with`` statement; Ctrl-C and SIGTERM raise KeyboardInterrupt while it waits."""

    def __init__(self, team: TeamProcesses, domain: int, namespace: str = "") -> None:
        """Join the team in ``namespace`` and ROS domain ``domain``; its processes are watched while waiting."""
        super().__init__("episode_client", namespace or "/", domain)
        self._team = team
        self._action = ActionClient(self.node, RunEpisode, "run_episode")
        #: The episode's id is in its result only, so the worlds of others that speak in its name are kept apart.
        self._logs = WorldLogs()
        WORLD.subscription(self.node, self._logs.add, depth=1000)

    def wait_for_simulator(self, timeout: float = SIMULATOR_TIMEOUT) -> None:
        """Wait until episodes can be asked for, at most for ``timeout`` seconds.

        Raises:
            TeamError: a process ended, or there is no simulator in time.
        """
        if not self.spin(self._action.server_is_ready, timeout):
            raise TeamError(f"no simulator after {timeout:g} s")

    def wait_for_recorder(self) -> None:
        """Wait until the team's recorder misses nothing.

        Raises:
            TeamError: a process ended, or the recorder does not receive from the whole team in time.
        """
        ready: list[Empty] = []
        RECORDER_READY.subscription(self.node, ready.append)
        came = self.spin(lambda: bool(ready) or "recorder" in self._team.given_up, RECORDER_TIMEOUT)
        if "recorder" in self._team.given_up:
            raise TeamError(f"the recorder {self._team.given_up['recorder']}: no episode was run")
        if not came:
            raise TeamError(f"the recorder does not receive from the whole team after {RECORDER_TIMEOUT:g} s")

    def run(self, goal: RunEpisode.Goal, on_feedback: Callable[[RunEpisode.Feedback], None]) -> EpisodeOutcome:
        """Run one episode; run it again from the start if the simulator is killed and restarted.

        Raises:
            EpisodeError: the simulator could not run the episode.
            TeamError: a process ended, or the simulator is busy.
        """
        result = None
        while result is None:
            self.wait_for_simulator()
            result = self._result_of(goal, on_feedback)
        if result.error:
            raise EpisodeError(result)
        # Its World messages are only drawn: one that does not come must not cost the result.
        self.spin(lambda: self._outcome(result).recorded, TRAILING)
        outcome = self._outcome(result)
        self._logs.clear()
        return outcome

    def _outcome(self, result: RunEpisode.Result) -> EpisodeOutcome:
        return EpisodeOutcome(result, self._logs.of(result.episode))

    def _result_of(
        self, goal: RunEpisode.Goal, on_feedback: Callable[[RunEpisode.Feedback], None]
    ) -> RunEpisode.Result | None:
        """The simulator's result; None if the simulator was killed."""
        starts = self._team.starts("simulator")

        def arrives(future: Future, timeout: float) -> bool:
            self.spin(lambda: future.done() or self._team.starts("simulator") > starts, timeout)
            return future.done()

        accepted = self._action.send_goal_async(goal, feedback_callback=lambda message: on_feedback(message.feedback))
        if not arrives(accepted, ACCEPTANCE):
            return None
        handle = accepted.result()
        if not handle.accepted:
            raise TeamError("the simulator is busy with another episode: wait for its end")
        ended = handle.get_result_async()
        return ended.result().result if arrives(ended, float("inf")) else None

    def watch(self) -> None:
        """Check the team's processes.

        Raises:
            TeamError: a process of the team ended.
        """
        self._team.check()
