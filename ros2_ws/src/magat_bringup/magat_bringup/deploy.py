# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat deploy``: sends a policy to the robots of a team that runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rclpy.action import ActionClient
from rclpy.task import Future
from rich.console import Console

from magat_interfaces.action import DeployPolicy
from magat_interfaces.msg import PolicyFile, RobotStatus
from magat_node.errors import TeamError, UnusableMessageError
from magat_node.progress import progress_bars
from magat_node.status_check import status_fault
from magat_node.teams import find_team
from magat_node.topics import ROBOT_STATUS
from magat_node.visitor import Visitor
from magat_robot.policy.config import ModelError, PolicyConfig
from magat_robot.policy.folder import read_files, read_folder
from magat_robot.policy.payload import longest_payload

#: How long to wait for the status of every robot, seconds; a running robot sends it every 2 s.
STATUS_TIMEOUT = 10.0
#: How long the simulator may be silent, seconds. Unless it was killed, it answers at once and sends feedback several
#: times a second.
SILENCE = 10.0

_STATES = {
    DeployPolicy.Feedback.WAITING: "waiting for the end of the episode",
    DeployPolicy.Feedback.PREPARING: "robots load the policy",
    DeployPolicy.Feedback.SWITCHING: "robots switch",
    DeployPolicy.Feedback.ROLLING_BACK: "robots roll back",
}


def deploy(folder: Path, namespace: str | None, console: Console) -> None:
    """Send the policy in ``folder`` to the team of this environment's ROS domain.

    Args:
        folder: of the policy.
        namespace: of the team; None if there is only one.
        console: shows what goes on.

    Raises:
        ModelError: it cannot be used, or does not fit the team's radio.
        TeamError: there is no such team, or the robots keep their policy because one of them cannot switch.
        KeyboardInterrupt: interrupted; the robots keep their policy.
    """
    config, digest, _ = read_folder(folder)
    files = [PolicyFile(name=name, data=data) for name, data in read_files(folder).items()]
    with console.status("looking for a team"):
        team = find_team(namespace)
    with Visitor("deployer", team.namespace) as visitor:
        with console.status("waiting for the status of the robots"):
            check_fit(config, _statuses(visitor, team.robots))
        _Request(visitor, console).run(DeployPolicy.Goal(digest=digest, files=files))
    console.print(
        f"{len(team.robots)} robots use {config.name} ({digest[:12]}) from the next episode on", highlight=False
    )


def check_fit(config: PolicyConfig, statuses: Mapping[str, RobotStatus]) -> None:
    """Check that a policy's messages are not too long for any robot's radio.

    Args:
        config: of the policy.
        statuses: by robot.

    Raises:
        ModelError: they are; it names the robots.
    """
    tight = {
        name: said.max_payload
        for name, said in statuses.items()
        if longest_payload(config, said.encoding) > said.max_payload
    }
    if tight:
        encoding = next(iter(statuses.values())).encoding
        raise ModelError(
            f"{config.name} sends up to {longest_payload(config, encoding)} bytes in a message, as {encoding}, and the "
            f"radio of {', '.join(sorted(tight))} carries {min(tight.values())}: nothing was sent. Start the robots "
            "with a greater max_payload, or another encoding"
        )


def _statuses(visitor: Visitor, robots: list[str]) -> dict[str, RobotStatus]:
    """The current status of each robot."""
    said: dict[str, RobotStatus] = {}

    def note(status: RobotStatus) -> None:
        wrong = status_fault(status)
        if wrong is not None:
            raise UnusableMessageError(f"a status in which {wrong}")
        said.update(dict.fromkeys(status.robots, status))

    ROBOT_STATUS.subscription(visitor.node, note, robots=len(robots))
    visitor.spin(lambda: said.keys() >= set(robots), STATUS_TIMEOUT)
    missing = sorted(set(robots) - said.keys())
    if missing:
        raise TeamError(f"no status from {', '.join(missing)} for {STATUS_TIMEOUT:g} s: nothing was sent")
    return said


@dataclass
class _Request:
    """One goal of the simulator's action, followed to its end."""

    visitor: Visitor
    console: Console
    _feedback: DeployPolicy.Feedback = field(default_factory=DeployPolicy.Feedback)
    _heard: int = 0

    def run(self, goal: DeployPolicy.Goal) -> None:
        """Return when all robots carry the policy; errors as of `deploy`."""
        action = ActionClient(self.visitor.node, DeployPolicy, "deploy_policy")
        if not self.visitor.spin(action.server_is_ready, SILENCE):
            raise TeamError(f"no simulator answers within {SILENCE:g} s")
        accepted = action.send_goal_async(goal, feedback_callback=self._on_feedback)
        self._follow(accepted)
        handle = accepted.result()
        if not handle.accepted:
            raise TeamError("another policy is being deployed: wait until that has ended")
        ended = handle.get_result_async()
        try:
            self._follow(ended)
        except KeyboardInterrupt:
            handle.cancel_goal_async()
            raise
        if ended.result().result.error:
            raise TeamError(f"the policy is not deployed, the robots keep their old one: {ended.result().result.error}")

    def _on_feedback(self, said: DeployPolicy.Impl.FeedbackMessage) -> None:
        self._feedback = said.feedback
        self._heard += 1

    def _follow(self, future: Future) -> None:
        """Wait until ``future`` is done, as long as the simulator sends feedback."""
        with progress_bars(self.console) as progress:
            task = progress.add_task("")
            heard = self._heard

            def news() -> bool:
                return future.done() or self._heard > heard

            while self.visitor.spin(news, SILENCE):
                if future.done():
                    return
                heard, said = self._heard, self._feedback
                progress.update(task, description=_STATES[said.state], completed=said.done, total=said.robots or None)
        raise TeamError(
            f"no message from the simulator for {SILENCE:g} s. If it was killed during the deployment, robots may have "
            "different policies: deploy again"
        )
