# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The action server that gives a team another policy: between two episodes, to all robots or to none."""

import secrets
import time
from dataclasses import dataclass

from rclpy.node import Node

from magat_interfaces.action import DeployPolicy
from magat_interfaces.msg import Deployment as DeploymentMessage
from magat_interfaces.msg import RobotStatus
from magat_node.deferred import RunningGoal, SingleGoalActionServer
from magat_node.parameters import declare_seconds
from magat_node.topics import DEPLOYMENT
from magat_sim.deployment import Deployment, Order, RobotReport

_STATES = {
    Order.PREPARE: DeployPolicy.Feedback.PREPARING,
    Order.SWITCH: DeployPolicy.Feedback.SWITCHING,
    Order.ROLL_BACK: DeployPolicy.Feedback.ROLLING_BACK,
}


@dataclass(frozen=True)
class _Running:
    """A deployment under way, and the goal that asked for it."""

    goal: RunningGoal
    deployment: Deployment


class DeploymentServer:
    """Part of the simulator's node, which knows when no episode is under way."""

    def __init__(self, node: Node, robots: list[str]) -> None:
        """Offer the action on ``node``, for a team of ``robots``."""
        self._robots = robots
        #: Of the robots after each order, seconds.
        self.patience = declare_seconds(
            node,
            "deploy_timeout",
            20.0,
            "how long to wait for the robots after each order of a deployment",
            fixed=False,
        )
        self._log = node.get_logger()
        self._running: _Running | None = None
        self._last = DeploymentMessage()
        #: The order that brought the policy that the team carries; None if it is the first one.
        self._carried: DeploymentMessage | None = None
        self._send = DEPLOYMENT.publisher(node)
        self._action = SingleGoalActionServer(node, DeployPolicy, "deploy_policy", lambda _: None)

    @property
    def busy(self) -> bool:
        """A deployment is under way, or waits for the end of an episode: the next episode has to wait."""
        return self._action.goal is not None

    def stop(self, why: str) -> bool:
        """Abort the goal, if there is one, because of ``why``; returns whether there was one."""
        goal = self._action.goal
        if goal is None:
            return False
        parted = ": robots may have different policies, deploy again" if self._running is not None else ""
        self._log.warning(f"a deployment was aborted: {why}")
        self._running = None
        goal.abort(DeployPolicy.Result(error=f"{why}{parted}"))
        return True

    def reported(self, status: RobotStatus) -> None:
        """Take the status of a process."""
        if self._running is not None:
            report = RobotReport(status.deployment, status.prepared, status.refusal)
            self._running.deployment.reported(status.robots, report)
            self._advance(self._running)

    def beat(self, between_episodes: bool) -> None:
        """Go on; to be called several times a second. Its feedback tells the client that the simulator is alive."""
        goal = self._action.goal
        if goal is None:
            return
        if self._running is not None:
            self._advance(self._running)
        elif goal.cancel_requested:
            goal.cancel(DeployPolicy.Result(error="cancelled"))
        elif between_episodes:
            number = secrets.randbits(63) + 1
            self._running = _Running(goal, Deployment(number, self._robots, time.monotonic(), self.patience))
            self._log.info(f"deployment {number} begins: digest {goal.request.digest[:12]}")
            self._give(self._running, Order.PREPARE)
        self._feed_back()

    def _feed_back(self) -> None:
        if self._action.goal is not None:
            feedback = DeployPolicy.Feedback(state=DeployPolicy.Feedback.WAITING, robots=len(self._robots))
            if self._running is not None:
                deployment = self._running.deployment
                feedback.state, feedback.done = _STATES[deployment.order], deployment.done
            self._action.goal.feed_back(feedback)

    def _advance(self, running: _Running) -> None:
        deployment, now = running.deployment, time.monotonic()
        order = deployment.cancel(now) if running.goal.cancel_requested else deployment.advance(now)
        if order is not None:
            self._give(running, order)
        elif deployment.ended(now):
            self._settle(running)

    def _give(self, running: _Running, order: Order) -> None:
        message = DeploymentMessage(deployment=running.deployment.number, order=order)
        if order is not Order.ROLL_BACK:
            message.digest, message.files = running.goal.request.digest, running.goal.request.files
        self._send.publish(message)
        self._last = message
        self._feed_back()

    def _settle(self, running: _Running) -> None:
        goal, deployment = running.goal, running.deployment
        if not deployment.error:
            self._carried = self._last
        elif self._carried is not None:
            self._send.publish(self._carried)  # a robot that comes back from now on is to carry what the others do
        self._running = None
        result = DeployPolicy.Result(error=deployment.error, deployment=deployment.number)
        end = goal.succeed if not deployment.error else goal.cancel if goal.cancel_requested else goal.abort
        if deployment.error:
            self._log.warning(f"deployment {deployment.number} ended, the robots keep their policy: {deployment.error}")
        else:
            self._log.info(f"deployment {deployment.number} ended: all robots have the new policy")
        end(result)
