"""The simulator node: runs episodes on a team of robot processes, for whoever calls the RunEpisode action."""

import array
import secrets
import sys
import time
from collections.abc import Callable

import numpy as np
from rclpy.action import CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future

from magat_interfaces.action import RunEpisode
from magat_interfaces.msg import Feature, FeatureBundle, Observation, Preference, RobotStatus, World
from magat_interfaces.srv import SolveMapf
from magat_node import cdr, qos
from magat_node.deferred import DeferredActionServer
from magat_node.parameters import declare_choice, declare_seconds, declare_share, declare_value
from magat_node.run import run_node
from magat_sim.case import Case, InvalidCaseError, draw_case, make_case
from magat_sim.deployment_server import DeploymentServer
from magat_sim.measures import T_MAX_FACTOR, Flowtime, expert_flowtime
from magat_sim.shield import SHIELDS
from magat_sim.simulator import Rules
from magat_sim.streams import episode_streams
from magat_sim.team import Equipment, Team
from magat_sim.ticks import DistributedEpisode, Outcome, ReceivedPreference

#: Seconds between hellos to robots that do not take part.
HELLO_PERIOD = 0.2
#: The expert's answer may take so long beyond its search, seconds.
EXPERT_GRACE = 2.0


class SimulatorNode(Node):
    """Waits for its robots, runs episodes, enforces grid, radio radius and shield."""

    def __init__(self, **options: object) -> None:
        """Expect the robots that the parameter ``robots`` names.

        Raises:
            ValueError: the parameter names no robots, or one twice.
        """
        super().__init__("simulator", **options)
        names = declare_value(
            self, "robots", [f"robot_{i:02d}" for i in range(10)], "names of the robots, which are their namespaces"
        )
        self._ready_timeout = declare_seconds(self, "ready_timeout", 60.0, "wait so long for the team and the expert")
        self._expert_limit = declare_seconds(self, "expert_time_limit", 10.0, "let the expert search so long")
        deadline = declare_seconds(
            self, "tick_deadline", 1.0, "wait so long in a tick for preferences; who is silent then idles"
        )
        self._radio = declare_choice(
            self, "radio", "direct", ["direct", "relayed"], "robots hear each other, or what the simulator hands on"
        )
        self._relay_patience = declare_seconds(
            self, "relay_deadline", 0.1, "wait so long in a tick, in all its rounds, for messages to relay"
        )
        self._rules = Rules(
            link_loss=declare_share(self, "link_loss", 0.0, "share of the radio links that are lost in each tick"),
            shield=declare_choice(self, "shield", "idle", list(SHIELDS), "what keeps robots from colliding"),
        )
        # Who hears the simulator hears everything, where that relays.
        peers = len(names) - 1 if self._radio == "direct" else 0
        self._team = Team(list(names), [secrets.randbits(63) + 1 for _ in names], peers)
        self._goal: ServerGoalHandle | None = None
        self._case: Case | None = None
        self._expert: Flowtime | None = None
        self._episode: DistributedEpisode | None = None
        self._episode_id = 0
        self._begun = 0.0
        self._gathering = False
        self._search: Future | None = None
        self._search_begun = 0.0
        self._started = self._tick_started = 0.0

        depth = qos.shared_depth(len(names))
        self._send = [self.create_publisher(Observation, f"{name}/observation", qos.newest(4)) for name in names]
        self._relay_to: list[Publisher] = []
        if self._radio == "relayed":
            self._relay_to = [self.create_publisher(FeatureBundle, f"{name}/heard", qos.newest(8)) for name in names]
            self.create_subscription(Feature, "feature", self._on_feature, qos.newest(depth), raw=True)
        self._send_world = self.create_publisher(World, "world", qos.reliable(100))
        self.create_subscription(Preference, "preference", self._on_preference, qos.newest(depth))
        self.create_subscription(RobotStatus, "robot_status", self._on_status, qos.reliable(depth))
        self._deployments = DeploymentServer(self, list(names))
        self._solve = self.create_client(SolveMapf, "solve_mapf")
        self._action = DeferredActionServer(
            self,
            RunEpisode,
            "run_episode",
            self._begin,
            goal_callback=lambda _: GoalResponse.REJECT if self._goal else GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        self._deadline = self.create_timer(deadline, self._on_deadline)
        self._deadline.cancel()
        self._relay_deadline = self.create_timer(self._relay_patience, self._on_relay_deadline)
        self._relay_deadline.cancel()
        self.create_timer(HELLO_PERIOD, self._on_beat)

    # --- The team ---

    def _on_beat(self) -> None:
        """Say hello to who is missing; go on with a deployment, or with an episode that waits for it or for robots."""
        for member, publisher in zip(self._team.members, self._send, strict=True):
            if not member.joined:
                publisher.publish(Observation(tick=Observation.HELLO, own_tag=member.nonce))
        self._deployments.beat(self._episode is None and self._search is None)
        if self._gathering:
            self._gather()
        elif self._search is not None:
            self._await_expert(self._search)

    def _on_status(self, message: RobotStatus) -> None:
        equipment = Equipment(message.digest, message.encoding, message.radio, message.rounds)
        for name in message.robots:
            if name in self._team.by_name:
                self._team.by_name[name].reported(time.monotonic(), message.peers_heard, equipment)
        self._deployments.reported(message)

    # --- An episode: begin, gather, ask the expert ---

    def _begin(self, goal: ServerGoalHandle) -> None:
        self._goal = goal
        self._episode = self._expert = None
        self._episode_id = secrets.randbits(63) + 1
        request: RunEpisode.Goal = goal.request
        try:
            self._case = self._requested_case(request)
        except InvalidCaseError as error:
            self._finish(goal.abort, str(error))
            return
        self._begun, self._gathering = time.monotonic(), True
        self._gather()

    def _requested_case(self, request: RunEpisode.Goal) -> Case:
        robots, width, height = len(self._team.members), request.width, request.height
        if len(request.obstacles) == 0:
            return draw_case(request.seed, request.number, width, height, robots, request.density)
        grid = np.asarray(request.obstacles)
        if grid.size != width * height:
            raise InvalidCaseError(f"the map has {grid.size} cells, not {width} x {height}: send one byte a cell")
        columns = [request.start_x, request.start_y, request.goal_x, request.goal_y]
        lengths = [len(column) for column in columns]
        if lengths != [robots] * 4:
            raise InvalidCaseError(
                f"starts and goals of {lengths} coordinates for a team of {robots}: send one a robot"
            )
        cells = np.stack([np.asarray(column, dtype=np.int64) for column in columns], axis=1)
        return make_case(grid.reshape(height, width), cells[:, :2], cells[:, 2:])

    def _gather(self) -> None:
        goal, now = self._goal, time.monotonic()
        assert goal is not None
        if goal.is_cancel_requested:
            self._finish(goal.canceled, "cancelled")
            return
        if self._deployments.busy:
            self._begun = now
            self._feed_back(0, 0)
            return
        missing = self._team.gather(now)
        expert = self._solve.service_is_ready() or goal.request.t_max > 0
        if not missing and expert:
            self._gathering = False
            mismatch = self._team.mismatch(self._radio)
            if mismatch is not None:
                self._finish(goal.abort, mismatch)
            else:
                self._ask_expert()
        elif now - self._begun > self._ready_timeout:
            absent = [*missing, *([] if expert else ["the expert"])]
            mismatch = self._team.mismatch(self._radio)  # what they have said so far may be the reason
            why = f"; {mismatch}" if mismatch is not None else ""
            self._finish(goal.abort, f"not there after {self._ready_timeout:g} s: {', '.join(absent)}{why}")
        else:
            self._feed_back(0, 0)

    def _ask_expert(self) -> None:
        case = self._case
        assert case is not None
        if not self._solve.service_is_ready():
            self._start(None)
            return
        height, width = case.obstacles.shape
        request = SolveMapf.Request(width=width, height=height, w=1.1, time_limit=self._expert_limit)
        request.obstacles = array.array("B", case.obstacles.astype(np.uint8).tobytes())
        request.start_x, request.start_y = (_int16(column) for column in case.starts.T)
        request.goal_x, request.goal_y = (_int16(column) for column in case.goals.T)
        self._search, self._search_begun = self._solve.call_async(request), time.monotonic()
        self._search.add_done_callback(self._on_solved)

    def _on_solved(self, search: Future) -> None:
        answer: SolveMapf.Response = search.result()
        if search is self._search:  # else it was given up
            self._search = None
            self._start(answer)

    def _await_expert(self, search: Future) -> None:
        """The expert may die over its search, and then nobody answers."""
        goal, now, limit = self._goal, time.monotonic(), self._expert_limit + EXPERT_GRACE
        assert goal is not None
        if not goal.is_cancel_requested and now - self._search_begun < limit:
            self._feed_back(0, 0)
            return
        self._search = None
        self._solve.remove_pending_request(search)
        if goal.is_cancel_requested:
            self._finish(goal.canceled, "cancelled")
        elif goal.request.t_max > 0:
            self._start(None)
        elif now - self._begun > self._ready_timeout:
            self._finish(goal.abort, f"the expert did not answer within {limit:g} s: is it alive, or busy with others?")
        else:
            self.get_logger().warning(f"the expert did not answer within {limit:g} s: it is asked again")
            self._gathering = True

    def _start(self, answer: SolveMapf.Response | None) -> None:
        """The first tick, with the expert's answer if it gave one."""
        goal, case = self._goal, self._case
        assert goal is not None and case is not None
        t_max = goal.request.t_max
        if answer is not None and answer.status == SolveMapf.Response.SOLVED:
            paths = np.stack([answer.path_x, answer.path_y], axis=-1).reshape(-1, case.robots, 2)
            self._expert = expert_flowtime(paths, case.goals)
            t_max = t_max or T_MAX_FACTOR * answer.makespan
        elif t_max == 0:
            why = answer.message if answer is not None else "there is none"
            self._finish(goal.abort, f"the expert gives no makespan ({why}): set t_max, or take another case")
            return
        streams = episode_streams(goal.request.seed, goal.request.number, case.robots)
        self._episode = DistributedEpisode(case, t_max, streams, self._rules)
        # A tick takes no longer with many rounds than with one.
        rounds = self._team.equipment.rounds if self._team.equipment is not None else 1
        self._relay_deadline.timer_period_ns = int(1e9 * self._relay_patience / max(rounds, 1))
        self._started = time.monotonic()
        self._publish_world(None)
        if self._episode.simulator.done:
            self._finish(goal.succeed, "")
        else:
            self._look()

    # --- A tick ---

    def _look(self) -> None:
        episode = self._episode
        assert episode is not None
        self._tick_started = time.monotonic()
        for name in self._team.readmit(self._tick_started):
            self.get_logger().info(f"{name} is back")
        strangers = self._team.strangers()
        if strangers:
            self.get_logger().warning(
                f"{', '.join(strangers)}: with another policy, encoding or radio than the team's, and takes no part",
                throttle_duration_sec=5.0,
            )
        sights = episode.look([member.joined for member in self._team.members])
        for member, publisher, sight in zip(self._team.members, self._send, sights, strict=True):
            if not member.joined:
                continue
            message = Observation(episode=self._episode_id, tick=episode.simulator.tick)
            message.stream, message.own_tag = sight.stream, sight.own_tag
            message.audible_tags = array.array("Q", sight.audible_tags)
            message.field_of_view = array.array("B", sight.field_of_view.tobytes())
            publisher.publish(message)
        self._deadline.reset()

    def _on_feature(self, data: bytes) -> None:
        """A message to hand on."""
        feature, episode = cdr.unpack_feature(data), self._episode
        if feature is None or feature.tick == Observation.HELLO or episode is None:
            return
        if feature.episode != self._episode_id or feature.tick != episode.simulator.tick:
            return  # late: the robots that actions it have gone on
        why = episode.relay.receive(feature.round, feature.tag, feature.encoding, feature.payload)
        if why is not None:
            self.get_logger().warning(f"dropped {why}", throttle_duration_sec=5.0)
        elif episode.relay.complete:
            self._hand_on()
        elif self._relay_deadline.is_canceled():
            self._relay_deadline.reset()

    def _on_relay_deadline(self) -> None:
        if self._episode is not None:
            self._hand_on()

    def _hand_on(self) -> None:
        episode = self._episode
        assert episode is not None
        at = (self._episode_id, episode.simulator.tick, episode.relay.round)
        for member, publisher, bundle in zip(self._team.members, self._relay_to, episode.relayed(), strict=True):
            if member.joined:
                publisher.publish(cdr.pack_bundle(*at, bundle.encoding, bundle.payloads))
        self._relay_deadline.cancel()  # until the first message of the next round

    def _on_preference(self, message: Preference) -> None:
        if message.tick == Observation.HELLO:
            member = self._team.by_nonce.get(message.tag)
            if member is not None:
                member.answered(time.monotonic())
            return
        episode = self._episode
        if episode is None or message.episode != self._episode_id or message.tick != episode.simulator.tick:
            return  # late: its tick ended without it, which was counted then
        why = episode.answer(
            message.tag,
            ReceivedPreference(message.primitive, message.heard, message.feature_bytes, message.log_probabilities),
        )
        if why is not None:
            self.get_logger().warning(f"dropped {why}", throttle_duration_sec=5.0)
        elif all(there or not m.joined for there, m in zip(episode.answered, self._team.members, strict=True)):
            self._advance()

    def _on_deadline(self) -> None:
        self._deadline.cancel()
        if self._episode is not None:
            self._advance()

    def _advance(self) -> None:
        goal, episode = self._goal, self._episode
        assert goal is not None and episode is not None
        self._deadline.cancel()
        self._relay_deadline.cancel()
        outcome = episode.advance()
        for name in self._team.account((~outcome.silent).tolist()):
            self.get_logger().warning(f"{name} is absent: it stays where it is until it answers again")
        self._publish_world(outcome)
        simulator = episode.simulator
        self._feed_back(int(simulator.visited.sum()), int(simulator.on_goal.sum()))
        if simulator.done:
            self._finish(goal.succeed, "")
        elif goal.is_cancel_requested:
            self._finish(goal.canceled, "cancelled")
        else:
            self._look()

    # --- What the world is told ---

    def _publish_world(self, outcome: Outcome | None) -> None:
        episode, case = self._episode, self._case
        assert episode is not None and case is not None
        simulator = episode.simulator
        height, width = case.obstacles.shape
        message = World(episode=self._episode_id, tick=simulator.tick, width=width, height=height)
        message.robots = [member.name for member in self._team.members]
        message.x, message.y = (_int16(column) for column in simulator.position.T)
        message.goal_x, message.goal_y = (_int16(column) for column in case.goals.T)
        message.visited = simulator.visited.tolist()
        message.t_max = int(simulator.t_max[0])
        best = self._expert or Flowtime(-1, -1)
        message.expert_flowtime, message.expert_flowtime_strict = best.first_visit, best.last_arrival
        if outcome is None:
            message.obstacles = array.array("B", case.obstacles.astype(np.uint8).tobytes())
            message.action = message.moved = array.array("B", bytes(case.robots))
            message.silent = [False] * case.robots
            message.missing = array.array("H", bytes(2 * case.robots))
        else:
            message.action = array.array("B", outcome.actions.astype(np.uint8).tobytes())
            message.moved = array.array("B", outcome.step.moved.astype(np.uint8).tobytes())
            message.silent = outcome.silent.tolist()
            message.missing = array.array("H", outcome.missing.astype(np.uint16).tobytes())
            message.links = outcome.links
            message.seconds = time.monotonic() - self._tick_started
        self._send_world.publish(message)

    def _feed_back(self, arrived: int, on_goal: int) -> None:
        assert self._goal is not None
        feedback = RunEpisode.Feedback(arrived=arrived, on_goal=on_goal, robots=len(self._team.members))
        feedback.joined = sum(member.joined for member in self._team.members)
        if self._episode is not None:
            feedback.tick = self._episode.simulator.tick
            feedback.t_max = int(self._episode.simulator.t_max[0])
        self._goal.publish_feedback(feedback)

    def _finish(self, end: Callable[[], None], error: str) -> None:
        goal, episode = self._goal, self._episode
        assert goal is not None
        self._deadline.cancel()
        self._relay_deadline.cancel()
        result = RunEpisode.Result(error=error, episode=self._episode_id)
        result.delta_ft = result.delta_ft_strict = float("nan")
        if episode is not None:
            elapsed = time.monotonic() - self._started
            measures = episode.simulator.measures([self._expert])[0]
            for name in (
                "success",
                "success_strict",
                "delta_ft",
                "delta_ft_strict",
                "p_rg",
                "makespan",
                "t_max",
                "ticks",
            ):
                setattr(result, name, getattr(measures, name))
            result.flowtime = measures.flowtime.first_visit
            result.expert_flowtime = self._expert.first_visit if self._expert else 0
            result.moves_blocked = measures.moves_blocked
            result.silent, result.features_missing = episode.silent, episode.features_missing
            result.bytes_per_tick = episode.bytes_per_tick
            result.ticks_per_second = measures.ticks / elapsed if elapsed > 0 else 0.0
        self._goal = self._episode = self._search = None
        self._gathering = False
        self._action.finish(goal, end, result)


def _int16(values: np.ndarray) -> array.array:
    return array.array("h", values.astype(np.int16).tobytes())


def main(args: list[str] | None = None) -> int:
    """Run the simulator until it is told to end. Returns the exit status."""
    return run_node("simulator", SimulatorNode, args)


if __name__ == "__main__":
    sys.exit(main())
