"""The action by which a team gets another policy: between two episodes, on all robots or on none."""

import secrets
import time

from rclpy.action import CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from magat_interfaces.action import DeployPolicy
from magat_interfaces.msg import Deployment as DeploymentMessage
from magat_interfaces.msg import RobotStatus
from magat_node import qos
from magat_node.deferred import DeferredActionServer
from magat_node.parameters import declare_seconds
from magat_sim.deployment import Deployment, Order, RobotReport

_STATES = {
    Order.PREPARE: DeployPolicy.Feedback.PREPARING,
    Order.SWITCH: DeployPolicy.Feedback.SWITCHING,
    Order.ROLL_BACK: DeployPolicy.Feedback.ROLLING_BACK,
}


class DeploymentServer:
    """Part of the simulator's node, which knows when no episode is under way."""

    def __init__(self, node: Node, robots: list[str]) -> None:
        """Offer the action on ``node``, for a team of ``robots``."""
        self._robots = robots
        self._patience = declare_seconds(
            node, "deploy_timeout", 20.0, "wait so long for the robots after each order of a deployment"
        )
        self._goal: ServerGoalHandle | None = None
        self._deployment: Deployment | None = None
        self._said = DeploymentMessage()
        #: The order that has aggregated the policy which the team carries; None if it is the first one.
        self._carried: DeploymentMessage | None = None
        self._send = node.create_publisher(DeploymentMessage, "deployment", qos.latched(1))
        self._action = DeferredActionServer(
            node,
            DeployPolicy,
            "deploy_policy",
            self._begin,
            goal_callback=lambda _: GoalResponse.REJECT if self._goal else GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    @property
    def busy(self) -> bool:
        """A deployment is under way, or waits for the end of an episode: the next one has to wait."""
        return self._goal is not None

    def _begin(self, goal: ServerGoalHandle) -> None:
        self._goal = goal
        self._deployment = None

    def reported(self, status: RobotStatus) -> None:
        """Take the status of a process."""
        if self._deployment is not None:
            report = RobotReport(status.deployment, status.prepared, status.refusal)
            self._deployment.reported(status.robots, report)
            self._advance()

    def beat(self, between_episodes: bool) -> None:
        """Go on; called several times a second, by which the client knows that the simulator is alive."""
        if self._goal is None:
            return
        if self._deployment is not None:
            self._advance()
        elif self._goal.is_cancel_requested:
            self._finish("cancelled", 0)
        elif between_episodes:
            number = secrets.randbits(63) + 1
            self._deployment = Deployment(number, self._robots, time.monotonic(), self._patience)
            self._give(Order.PREPARE)
        self._feed_back()

    def _feed_back(self) -> None:
        if self._goal is not None:
            feedback = DeployPolicy.Feedback(state=DeployPolicy.Feedback.WAITING, robots=len(self._robots))
            if self._deployment is not None:
                feedback.state, feedback.done = _STATES[self._deployment.order], self._deployment.done
            self._goal.publish_feedback(feedback)

    def _advance(self) -> None:
        goal, deployment, now = self._goal, self._deployment, time.monotonic()
        assert goal is not None and deployment is not None
        order = deployment.cancel(now) if goal.is_cancel_requested else deployment.advance(now)
        if order is not None:
            self._give(order)
        elif deployment.ended(now):
            self._settle(deployment)

    def _give(self, order: Order) -> None:
        goal, deployment = self._goal, self._deployment
        assert goal is not None and deployment is not None
        message = DeploymentMessage(deployment=deployment.number, order=order)
        if order is not Order.ROLL_BACK:
            message.digest, message.files = goal.request.digest, goal.request.files
        self._send.publish(message)
        self._said = message
        self._feed_back()

    def _settle(self, deployment: Deployment) -> None:
        if not deployment.error:
            self._carried = self._said
        elif self._carried is not None:
            self._send.publish(self._carried)  # who comes back from now on is to carry what the others do
        self._finish(deployment.error, deployment.number)

    def _finish(self, error: str, number: int) -> None:
        goal = self._goal
        assert goal is not None
        self._goal = self._deployment = None
        end = goal.succeed if not error else goal.canceled if goal.is_cancel_requested else goal.abort
        self._action.finish(goal, end, DeployPolicy.Result(error=error, deployment=number))
