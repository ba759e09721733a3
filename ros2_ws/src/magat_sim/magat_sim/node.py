# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulator node: translates between ROS and `EpisodeServer`, which runs episodes on a team of robot processes."""

import array
import secrets
import sys
import time
from collections.abc import Sequence
from typing import Any

from magat_node.imports import quiet_imports

with quiet_imports():
    import numpy as np
    from rclpy.node import Node
    from rclpy.publisher import Publisher
    from rclpy.task import Future

    from magat_interfaces.action import RunEpisode
    from magat_interfaces.msg import Observation, Preference, RobotStatus, World
    from magat_interfaces.srv import SolveMapf
    from magat_node import cdr, topics
    from magat_node.deferred import RunningGoal, SingleGoalActionServer
    from magat_node.errors import UnusableMessageError
    from magat_node.names import check_robot_name
    from magat_node.parameters import SettableParameters, declare_choice, declare_seconds, declare_share, declare_value
    from magat_node.run import run_node
    from magat_node.status_check import status_fault
    from magat_node.unpredictable import shuffled
    from magat_sim.case import Case, InvalidCaseError, draw_case, make_case
    from magat_sim.constants import EXPERT_W
    from magat_sim.deployment_server import DeploymentServer
    from magat_sim.episode_server import EpisodeLimits, EpisodeServer
    from magat_sim.episode_states import EpisodeEnd, EpisodeRequest, ExpertPlan, Progress, Ticking
    from magat_sim.measures import Flowtime, expert_flowtime
    from magat_sim.relay import Bundle
    from magat_sim.shield import SHIELDS
    from magat_sim.simulator import Rules
    from magat_sim.streams import SECRET_BYTES, InvalidSecretError, check_secret
    from magat_sim.team import Equipment, Team
    from magat_sim.ticks import Outcome, ReceivedPreference, RobotObservation

#: Seconds between hellos to robots that do not take part.
HELLO_PERIOD = 0.2
#: Parameters that can be set between episodes.
SETTABLE = [
    *("ready_timeout", "expert_time_limit", "tick_deadline", "relay_deadline", "deploy_timeout"),
    *("link_loss", "shield"),
]


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
        for name in names:
            check_robot_name(name)
        radio = declare_choice(
            self, "radio", "direct", ["direct", "relayed"], "robots hear each other, or what the simulator relays"
        )
        self._declare_settable()
        # With a relayed radio no robot needs to hear another.
        peers = len(names) - 1 if radio == "direct" else 0
        self._team = Team(list(names), [secrets.randbits(63) + 1 for _ in names], peers)

        size = len(names)
        self._send = [topics.OBSERVATION.publisher(self, robot=name) for name in names]
        self._relay_to: list[Publisher] = []
        if radio == "relayed":
            self._relay_to = [topics.HEARD.publisher(self, robot=name) for name in names]
            topics.FEATURE.subscription(self, self._on_feature, robots=size, raw=True)
        # Tools take a simulator for complete when this publisher is there: it comes after those above.
        self._send_world = topics.WORLD.publisher(self)
        topics.PREFERENCE.subscription(self, self._on_preference, robots=size)
        topics.ROBOT_STATUS.subscription(self, self._on_status, robots=size)
        self._deployments = DeploymentServer(self, list(names))
        self._solve = self.create_client(SolveMapf, "solve_mapf")
        self._action = SingleGoalActionServer(self, RunEpisode, "run_episode", self._begin)
        self._server: EpisodeServer = EpisodeServer(
            self._team,
            radio,
            self._rules(),
            self._limits(),
            self,
            self.create_timer(self._value("tick_deadline"), lambda: self._server.end_tick()),
            self.create_timer(self._value("relay_deadline"), lambda: self._server.end_round()),
            self.get_logger(),
            time.monotonic,
        )
        self._server.tick_deadline.cancel()
        self._server.relay_deadline.cancel()
        self.create_timer(HELLO_PERIOD, self._on_beat)
        self._settable = SettableParameters(self, SETTABLE, self._refuse, self._apply)

    # --- Parameters that can be set between episodes ---

    def _declare_settable(self) -> None:
        declare_seconds(self, "ready_timeout", 60.0, "how long to wait for the team and the expert", fixed=False)
        declare_seconds(self, "expert_time_limit", 10.0, "how long the expert may search", fixed=False)
        meaning = "how long to wait in a tick for preferences; a robot that is silent then idles"
        declare_seconds(self, "tick_deadline", 1.0, meaning, fixed=False)
        meaning = "how long to wait in a tick, in all its rounds, for messages to relay"
        declare_seconds(self, "relay_deadline", 0.1, meaning, fixed=False)
        declare_share(self, "link_loss", 0.0, "share of the radio links that are lost in each tick", fixed=False)
        declare_choice(self, "shield", "idle", list(SHIELDS), "what keeps robots from colliding", fixed=False)

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _rules(self) -> Rules:
        return Rules(link_loss=self._value("link_loss"), shield=self._value("shield"))

    def _limits(self) -> EpisodeLimits:
        return EpisodeLimits(*map(self._value, ("ready_timeout", "expert_time_limit", "relay_deadline")))

    def _refuse(self, changes: dict[str, Any]) -> str:
        if not self._server.idle or self._deployments.busy:
            return f"{', '.join(changes)}: can be set between episodes only: wait for the end of the current goal"
        if changes.get("shield", "idle") not in SHIELDS:
            return f"there is no shield {changes['shield']!r}: choose one of {list(SHIELDS)}"
        return ""

    def _apply(self) -> None:
        self._server.rules, self._server.limits = self._rules(), self._limits()
        self._server.tick_deadline.timer_period_ns = round(1e9 * self._value("tick_deadline"))
        self._deployments.patience = self._value("deploy_timeout")

    def end(self) -> bool:
        """Abort what is under way, so that clients do not wait for a simulator that is gone."""
        why = "the simulator was told to end"
        return any([self._server.stop(why), self._deployments.stop(why)])

    # --- From ROS ---

    def _on_beat(self) -> None:
        """Say hello to the missing robots; go on with a deployment, or with an episode that waits."""
        for member, publisher in shuffled(zip(self._team.members, self._send, strict=True)):
            if not member.joined:
                publisher.publish(Observation(tick=Observation.HELLO, own_tag=member.nonce))
        self._deployments.beat(self._server.between_episodes)
        self._server.beat()

    def _on_status(self, message: RobotStatus) -> None:
        wrong = status_fault(message)
        if wrong is not None:
            raise UnusableMessageError(f"a status in which {wrong}")
        equipment = Equipment(message.digest, message.encoding, message.radio, message.rounds)
        for name in message.robots:
            if name in self._team.by_name:
                self._team.by_name[name].reported(time.monotonic(), message.peers_heard, equipment)
        self._deployments.reported(message)

    def _on_feature(self, data: bytes) -> None:
        feature = cdr.unpack_feature(data)
        if feature is not None:  # damaged otherwise
            self._server.take_feature(feature)

    def _on_preference(self, message: Preference) -> None:
        if message.tick == Observation.HELLO:
            member = self._team.by_nonce.get(message.tag)
            if member is not None:
                member.answered(time.monotonic())
            return
        preference = ReceivedPreference(
            message.primitive, message.heard, message.feature_bytes, message.log_probabilities
        )
        self._server.take_preference(message.episode, message.tick, message.tag, preference)

    def _begin(self, running: RunningGoal) -> None:
        message, goal, episode = running.request, _EpisodeGoal(running, self._team), secrets.randbits(63) + 1
        try:
            case = _requested_case(message, len(self._team.members))
            secret = check_secret(bytes(message.secret) or secrets.token_bytes(SECRET_BYTES))
        except (InvalidCaseError, InvalidSecretError) as error:
            self._server.refuse(goal, episode, str(error))
            return
        w = message.expert_w or EXPERT_W
        self._server.begin(goal, EpisodeRequest(episode, case, message.seed, message.number, message.t_max, w, secret))

    # --- To ROS: the Surroundings of the episode server ---

    def expert_ready(self) -> bool:
        """The expert's service is there."""
        return self._solve.service_is_ready()

    def deploying(self) -> bool:
        """A deployment is under way, or waits for the end of an episode."""
        return self._deployments.busy

    def ask_expert(self, case: Case, w: float) -> Future:
        """Send a SolveMapf request; its answer goes to `EpisodeServer.solved`."""
        height, width = case.obstacles.shape
        request = SolveMapf.Request(width=width, height=height, w=w, time_limit=self._server.limits.expert_time_limit)
        request.obstacles = array.array("B", case.obstacles.astype(np.uint8).tobytes())
        request.start_x, request.start_y = (_int16(column) for column in case.starts.T)
        request.goal_x, request.goal_y = (_int16(column) for column in case.goals.T)

        def on_solved(search: Future) -> None:
            answer: SolveMapf.Response = search.result()
            self._server.solved(search, _plan(answer, case), answer.message)

        search = self._solve.call_async(request)
        search.add_done_callback(on_solved)
        return search

    def abandon(self, search: object) -> None:
        """Forget a SolveMapf request."""
        self._solve.remove_pending_request(search)

    def send_observations(self, episode: int, tick: int, observations: Sequence[tuple[int, RobotObservation]]) -> None:
        """Send an Observation to each of these robots."""
        for robot, observation in observations:
            message = Observation(episode=episode, tick=tick, moved=observation.moved)
            message.stream, message.own_tag = observation.stream, observation.own_tag
            message.audible_tags = array.array("Q", observation.audible_tags)
            message.field_of_view = array.array("B", observation.field_of_view.tobytes())
            self._send[robot].publish(message)

    def send_bundles(self, episode: int, tick: int, number: int, bundles: Sequence[tuple[int, Bundle]]) -> None:
        """Send a FeatureBundle to each of these robots."""
        for robot, bundle in bundles:
            data = cdr.pack_bundle(episode, tick, number, bundle.encoding, bundle.payloads)
            self._relay_to[robot].publish(data)

    def publish_world(self, state: Ticking, outcome: Outcome | None, seconds: float) -> None:
        """Publish the World after a tick, or at the start."""
        simulator, case = state.episode.simulator, state.request.case
        height, width = case.obstacles.shape
        message = World(episode=state.request.episode, tick=simulator.tick, width=width, height=height)
        message.robots = [member.name for member in self._team.members]
        message.x, message.y = (_int16(column) for column in simulator.position.T)
        message.goal_x, message.goal_y = (_int16(column) for column in case.goals.T)
        message.visited = simulator.visited.tolist()
        message.t_max = int(simulator.t_max[0])
        best = state.expert or Flowtime(-1, -1)
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
            message.seconds = seconds
        self._send_world.publish(message)


class _EpisodeGoal:
    """A RunEpisode goal as the episode server sees it."""

    def __init__(self, goal: RunningGoal, team: Team) -> None:
        self._goal, self._team = goal, team

    @property
    def cancel_requested(self) -> bool:
        return self._goal.cancel_requested

    def feed_back(self, progress: Progress) -> None:
        self._goal.feed_back(RunEpisode.Feedback(robots=len(self._team.members), **progress._asdict()))

    def succeed(self, end: EpisodeEnd) -> None:
        self._goal.succeed(_result(end))

    def abort(self, end: EpisodeEnd) -> None:
        self._goal.abort(_result(end))

    def cancel(self, end: EpisodeEnd) -> None:
        self._goal.cancel(_result(end))


def _requested_case(request: RunEpisode.Goal, robots: int) -> Case:
    width, height = request.width, request.height
    if len(request.obstacles) == 0:
        return draw_case(request.seed, request.number, width, height, robots, request.density)
    grid = np.asarray(request.obstacles)
    if grid.size != width * height:
        raise InvalidCaseError(f"the map has {grid.size} cells, not {width} x {height}: send one byte a cell")
    columns = [request.start_x, request.start_y, request.goal_x, request.goal_y]
    lengths = [len(column) for column in columns]
    if lengths != [robots] * 4:
        raise InvalidCaseError(f"starts and goals of {lengths} coordinates for a team of {robots}: send one a robot")
    cells = np.stack([np.asarray(column, dtype=np.int64) for column in columns], axis=1)
    return make_case(grid.reshape(height, width), cells[:, :2], cells[:, 2:])


def _plan(answer: SolveMapf.Response, case: Case) -> ExpertPlan | None:
    if answer.status != SolveMapf.Response.SOLVED:
        return None
    paths = np.stack([answer.path_x, answer.path_y], axis=-1).reshape(-1, case.robots, 2)
    return ExpertPlan(answer.makespan, expert_flowtime(paths, case.goals))


def _result(end: EpisodeEnd) -> RunEpisode.Result:
    result = RunEpisode.Result(error=end.error, episode=end.episode)
    result.delta_ft = result.delta_ft_strict = float("nan")
    if end.last is None:
        return result
    episode, expert = end.last.episode, end.last.expert
    result.secret = end.last.request.secret
    measures = episode.simulator.measures([expert])[0]
    for name in ("success", "success_strict", "delta_ft", "delta_ft_strict", "p_rg", "makespan", "t_max", "ticks"):
        setattr(result, name, getattr(measures, name))
    result.flowtime = measures.flowtime.first_visit
    result.expert_flowtime = expert.first_visit if expert else 0
    result.moves_blocked = measures.moves_blocked
    result.silent, result.features_missing = episode.silent, episode.features_missing
    result.bytes_per_tick = episode.bytes_per_tick
    result.ticks_per_second = measures.ticks / end.elapsed if end.elapsed > 0 else 0.0
    if end.error:  # it ended too early to be compared with the expert
        result.delta_ft = result.delta_ft_strict = float("nan")
    return result


def _int16(values: np.ndarray) -> array.array:
    return array.array("h", values.astype(np.int16).tobytes())


def main(args: list[str] | None = None) -> int:
    """Run the simulator until SIGINT or SIGTERM. Returns the exit status."""
    return run_node("simulator", SimulatorNode, args)


if __name__ == "__main__":
    sys.exit(main())
