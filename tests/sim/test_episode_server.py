# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The states of an episode and the events that lead from one to the next; without ROS, with a clock that is set."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest

from magat_node.cdr import PackedFeature
from magat_sim.case import Case, make_case
from magat_sim.constants import T_MAX_FACTOR
from magat_sim.episode_server import EXPERT_GRACE, EpisodeLimits, EpisodeServer
from magat_sim.episode_states import AwaitingExpert, EpisodeEnd, EpisodeRequest, ExpertPlan, Gathering, Idle, Ticking
from magat_sim.grid import Primitive
from magat_sim.measures import Flowtime
from magat_sim.simulator import DEFAULT_RULES
from magat_sim.streams import episode_streams
from magat_sim.team import FRESH, SILENT_TICKS, Equipment, Team
from magat_sim.ticks import ReceivedPreference

LIMITS = EpisodeLimits(ready_timeout=60.0, expert_time_limit=10.0, relay_deadline=0.1)
NAMES = ["a", "b", "c"]
EPISODE = 7
SECRET = bytes(range(32))
PLAN = ExpertPlan(makespan=4, flowtime=Flowtime(9, 10))


class FakeDeadline:
    def __init__(self):
        self.timer_period_ns, self.running = 0, False

    def reset(self):
        self.running = True

    def cancel(self):
        self.running = False

    def is_canceled(self):
        return not self.running


class FakeGoal:
    def __init__(self):
        self.cancel_requested = False
        self.progress = []
        self.ended: list[tuple[str, EpisodeEnd]] = []

    def feed_back(self, progress):
        self.progress.append(progress)

    def succeed(self, end):
        self.ended.append(("succeeded", end))

    def abort(self, end):
        self.ended.append(("aborted", end))

    def cancel(self, end):
        self.ended.append(("cancelled", end))


def by_robot(messages: list[tuple[int, object]]) -> list:
    """The message to each robot; None to those that got none."""
    assert len(dict(messages)) == len(messages)
    return [dict(messages).get(robot) for robot in range(len(NAMES))]


class FakeSurroundings:
    def __init__(self):
        self.expert, self.deployment = True, False
        self.asked, self.abandoned = [], []
        self.observations, self.bundles, self.worlds = [], [], []
        self.orders: list[list[int]] = []

    def expert_ready(self):
        return self.expert

    def deploying(self):
        return self.deployment

    def ask_expert(self, case, w):
        self.asked.append((case, w))
        return f"search {len(self.asked)}"

    def abandon(self, search):
        self.abandoned.append(search)

    def send_observations(self, episode, tick, observations):
        self.orders.append([robot for robot, _ in observations])
        self.observations.append((episode, tick, by_robot(observations)))

    def send_bundles(self, episode, tick, number, bundles):
        self.orders.append([robot for robot, _ in bundles])
        self.bundles.append((episode, tick, number, by_robot(bundles)))

    def publish_world(self, state, outcome, seconds):
        self.worlds.append((state.episode.simulator.tick, outcome is None, seconds))


class FakeLog:
    def __init__(self):
        self.lines = []

    def info(self, message):
        self.lines.append(message)

    def warning(self, message, **_):
        self.lines.append(message)


class Bench:
    """A server with fakes around it."""

    def __init__(self, radio: str = "direct", rounds: int = 1):
        self.now = 100.0
        self.equipment = Equipment("digest", "float32", radio, rounds)
        self.team = Team(NAMES, [1, 2, 3], peers=2 if radio == "direct" else 0)
        self.goal, self.outside, self.log = FakeGoal(), FakeSurroundings(), FakeLog()
        self.tick_deadline, self.relay_deadline = FakeDeadline(), FakeDeadline()
        self.server = EpisodeServer(
            self.team,
            radio,
            DEFAULT_RULES,
            LIMITS,
            self.outside,
            self.tick_deadline,
            self.relay_deadline,
            self.log,
            lambda: self.now,
        )

    def robots_ready(self, *names: str) -> None:
        for name in names or NAMES:
            self.team.by_name[name].answered(self.now)
            self.team.by_name[name].reported(self.now, 2, self.equipment)

    def begin(self, t_max: int = 0, case: Case | None = None, expert_w: float = 1.1) -> None:
        self.server.begin(self.goal, EpisodeRequest(EPISODE, case or corridor(), 1, 0, t_max, expert_w, SECRET))

    def begin_ticking(self, t_max: int = 50) -> None:
        self.robots_ready()
        self.begin(t_max)
        self.server.solved("search 1", PLAN)
        assert isinstance(self.server.state, Ticking)

    @property
    def sent(self) -> list:
        """The observations of the current tick."""
        return self.outside.observations[-1][2]

    def prefer(self, primitive: int, *robots: int, **at: int) -> None:
        state = self.server.state
        assert isinstance(state, Ticking)
        where = {"episode": EPISODE, "tick": state.episode.simulator.tick} | at
        for tag in [self.sent[robot].own_tag for robot in robots]:
            self.server.take_preference(**where, tag=tag, preference=ReceivedPreference(primitive, 0, 100))

    @property
    def end(self) -> tuple[str, EpisodeEnd]:
        assert isinstance(self.server.state, Idle)
        assert not self.tick_deadline.running
        assert not self.relay_deadline.running
        (only,) = self.goal.ended
        return only


def corridor(length: int = 6) -> Case:
    """Three robots side by side; each has its goal at the other end of its row."""
    starts = [(0, 0), (0, 1), (0, 2)]
    return make_case(np.zeros((3, length)), starts, [(length - 1, y) for _, y in starts])


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_server_without_a_goal_is_idle_and_ignores_all_events(bench):
    for event in (
        bench.server.beat,
        bench.server.end_tick,
        bench.server.end_round,
        lambda: bench.server.solved("search 1", PLAN),
        lambda: bench.server.take_feature(PackedFeature(EPISODE, 0, 0, 1, 0, b"")),
        lambda: bench.server.take_preference(EPISODE, 0, 1, ReceivedPreference(0, 0, 0)),
    ):
        event()
        assert isinstance(bench.server.state, Idle)
    assert bench.server.between_episodes
    assert bench.outside.observations == bench.outside.worlds == []


def test_it_gathers_until_robots_and_expert_are_there_and_then_asks_the_expert(bench):
    bench.outside.expert = False
    bench.begin(expert_w=5.0)
    assert isinstance(bench.server.state, Gathering)
    bench.robots_ready("a", "b")
    bench.server.beat()
    assert bench.goal.progress[-1] == (0, 0, 0, 0, 2)
    bench.robots_ready("c")
    bench.server.beat()
    assert isinstance(bench.server.state, Gathering), "the expert is missing"
    assert bench.server.between_episodes
    bench.outside.expert = True
    bench.server.beat()
    assert isinstance(bench.server.state, AwaitingExpert)
    assert not bench.server.between_episodes
    ((case, w),) = bench.outside.asked
    assert w == 5.0
    np.testing.assert_array_equal(case.goals, corridor().goals)


def test_a_team_that_does_not_gather_in_time_is_named(bench):
    bench.outside.expert = False
    bench.robots_ready("b")
    bench.begin()
    bench.now += LIMITS.ready_timeout
    bench.server.beat()
    assert isinstance(bench.server.state, Gathering)
    bench.now += 0.1
    bench.server.beat()
    how, end = bench.end
    assert (how, end.error, end.episode) == ("aborted", "not there after 60 s: a, c, the expert", EPISODE)
    assert end.last is None


def test_a_team_that_does_not_fit_together_is_refused(bench):
    bench.robots_ready("a", "b")
    bench.equipment = bench.equipment._replace(encoding="int8")
    bench.robots_ready("c")
    bench.begin()
    how, end = bench.end
    assert how == "aborted"
    assert "the team does not fit together" in end.error
    assert bench.outside.asked == []


def test_a_deployment_holds_the_episode_back_and_its_time_is_not_counted(bench):
    bench.outside.deployment = True
    bench.robots_ready()
    bench.begin()
    bench.now += 2 * LIMITS.ready_timeout
    bench.server.beat()
    assert isinstance(bench.server.state, Gathering)
    assert bench.outside.asked == []
    bench.outside.deployment = False
    bench.server.beat()
    assert isinstance(bench.server.state, Gathering), "what the robots said is stale, but the wait begins anew"
    bench.robots_ready()
    bench.server.beat()
    assert isinstance(bench.server.state, AwaitingExpert)


def test_without_an_expert_an_episode_with_t_max_begins_at_once(bench):
    bench.outside.expert = False
    bench.robots_ready()
    bench.begin(t_max=9)
    assert isinstance(bench.server.state, Ticking)
    assert bench.server.state.expert is None
    assert bench.server.state.episode.simulator.t_max == [9]


def test_the_first_tick_begins_with_the_experts_answer(bench):
    bench.robots_ready()
    bench.begin()
    bench.now += 3.0
    bench.server.solved("search 1", PLAN)
    state = bench.server.state
    assert isinstance(state, Ticking)
    assert state.episode.simulator.t_max == [T_MAX_FACTOR * PLAN.makespan]
    assert state.expert == PLAN.flowtime
    assert state.started == state.tick_started == bench.now
    assert bench.outside.worlds == [(0, True, 0.0)]
    episode, tick, observations = bench.outside.observations[0]
    assert (episode, tick, [o is not None for o in observations]) == (EPISODE, 0, [True] * 3)
    assert bench.tick_deadline.running


def test_an_expert_without_a_solution_needs_a_t_max(bench):
    bench.robots_ready()
    bench.begin()
    bench.server.solved("search 1", None, "timed out")
    how, end = bench.end
    assert how == "aborted"
    assert end.error == "the expert gives no makespan (timed out): set t_max, or take another case"


def test_an_expert_without_a_solution_does_no_harm_with_t_max(bench):
    bench.robots_ready()
    bench.begin(t_max=9)
    bench.server.solved("search 1", None, "timed out")
    assert isinstance(bench.server.state, Ticking)


def test_a_silent_expert_is_asked_again_until_the_patience_is_over(bench):
    bench.robots_ready()
    bench.begin()
    for number in range(1, 6):
        bench.now += LIMITS.expert_time_limit + EXPERT_GRACE - 0.1
        bench.server.beat()
        assert bench.outside.abandoned[number - 1 :] == []
        bench.now += 0.2
        bench.server.beat()
        assert bench.outside.abandoned[number - 1 :] == [f"search {number}"]
        if number < 5:
            assert isinstance(bench.server.state, Gathering)
            assert "did not answer within 12 s: it is asked again" in bench.log.lines[-1]
            bench.robots_ready()
            bench.server.beat()
            assert isinstance(bench.server.state, AwaitingExpert)
            bench.server.solved(f"search {number}", PLAN)
            assert isinstance(bench.server.state, AwaitingExpert), "an abandoned search does not count any more"
    how, end = bench.end
    assert how == "aborted"
    assert end.error == "the expert did not answer within 12 s: is it alive, or busy with others?"


def test_a_silent_expert_is_not_needed_with_t_max(bench):
    bench.robots_ready()
    bench.begin(t_max=9)
    bench.now += LIMITS.expert_time_limit + EXPERT_GRACE
    bench.server.beat()
    assert isinstance(bench.server.state, Ticking)
    assert bench.outside.abandoned == ["search 1"]


def test_a_goal_can_be_cancelled_in_every_state(bench):
    def gathering(one: Bench) -> None:
        one.begin()
        one.goal.cancel_requested = True
        one.server.beat()

    def awaiting(one: Bench) -> None:
        one.robots_ready()
        one.begin()
        one.goal.cancel_requested = True
        one.server.beat()
        assert one.outside.abandoned == ["search 1"]

    def ticking(one: Bench) -> None:
        one.begin_ticking()
        one.goal.cancel_requested = True
        one.server.beat()
        assert isinstance(one.server.state, Ticking), "it ends with its tick"
        one.server.end_tick()

    cases: list[Callable[[Bench], None]] = [gathering, awaiting, ticking]
    for cancel in cases:
        one = Bench()
        cancel(one)
        how, end = one.end
        assert (how, end.error) == ("cancelled", "cancelled")
        assert (end.last is not None) == (cancel is ticking)


def test_a_tick_ends_when_all_preferences_are_there(bench):
    bench.begin_ticking()
    bench.now += 0.5
    bench.prefer(Primitive.RIGHT, 0, 2)
    assert len(bench.outside.worlds) == 1
    bench.prefer(Primitive.RIGHT, 1)
    assert bench.outside.worlds[1:] == [(1, False, 0.5)]
    assert bench.goal.progress[-1] == (1, 50, 0, 0, 3)
    assert bench.outside.observations[-1][:2] == (EPISODE, 1)
    assert bench.server.state.tick_started == bench.now
    assert bench.server.state.started == bench.now - 0.5


def test_at_the_deadline_silent_robots_idle_and_are_absent_after_some_ticks(bench):
    bench.begin_ticking()
    for _ in range(SILENT_TICKS):
        bench.prefer(Primitive.RIGHT, 0, 1)
        bench.server.end_tick()
    assert "c is absent" in bench.log.lines[-1]
    assert [sent is not None for sent in bench.sent] == [True, True, False]
    bench.prefer(Primitive.RIGHT, 0, 1)
    assert bench.server.state.episode.simulator.tick == SILENT_TICKS + 1, "an absent robot is not waited for"
    bench.robots_ready("c")
    bench.prefer(Primitive.RIGHT, 0, 1)
    assert "c is back" in bench.log.lines
    assert [sent is not None for sent in bench.sent] == [True, True, True]


def test_preferences_of_another_tick_or_episode_are_ignored(bench):
    bench.begin_ticking()
    bench.prefer(Primitive.RIGHT, 0, 1, 2, tick=1)
    bench.prefer(Primitive.RIGHT, 0, 1, 2, episode=EPISODE + 1)
    assert not bench.server.state.episode.answered.any()
    bench.server.take_preference(EPISODE, 0, 12345, ReceivedPreference(0, 0, 0))
    assert "dropped a preference under a tag that was not given out" in bench.log.lines[-1]


def test_an_episode_ends_well_when_all_robots_stand_on_their_goals(bench):
    bench.robots_ready()
    bench.begin(case=corridor(3))
    bench.server.solved("search 1", PLAN)
    for _ in range(2):
        bench.now += 1.0
        bench.prefer(Primitive.RIGHT, 0, 1, 2)
    how, end = bench.end
    assert (how, end.error, end.elapsed) == ("succeeded", "", 2.0)
    assert end.last.episode.simulator.visited.all()
    assert bench.goal.progress[-1].on_goal == 3


def test_an_episode_ends_at_t_max(bench):
    bench.begin_ticking(t_max=2)
    for _ in range(2):
        bench.server.end_tick()
    assert bench.end[0] == "succeeded"


def test_a_case_that_is_solved_at_the_start_has_no_tick(bench):
    case = make_case(np.zeros((3, 3)), [(0, 0), (1, 1), (2, 2)], [(0, 0), (1, 1), (2, 2)])
    bench.robots_ready()
    bench.begin(case=case)
    bench.server.solved("search 1", ExpertPlan(0, Flowtime(0, 0)))
    assert bench.end[0] == "succeeded"
    assert bench.outside.worlds == [(0, True, 0.0)]
    assert bench.outside.observations == []


def test_a_server_runs_one_episode_after_another(bench):
    bench.begin_ticking(t_max=1)
    bench.server.end_tick()
    assert bench.end[0] == "succeeded"
    bench.now += 10 * FRESH
    bench.goal = FakeGoal()
    bench.begin(t_max=1)
    bench.server.solved("search 2", PLAN)
    assert bench.outside.observations[-1][1] == 0, "robots that took part need not gather again"
    bench.server.end_tick()
    assert bench.end[0] == "succeeded"


def test_a_round_is_relayed_when_all_messages_are_there():
    bench = Bench("relayed", rounds=2)
    bench.begin_ticking()
    assert bench.relay_deadline.timer_period_ns == 5e7, "the deadline is shared by all rounds"
    for number in range(2):
        for robot, running in ((1, True), (0, True), (2, False)):
            tag = bench.sent[robot].own_tag
            bench.server.take_feature(PackedFeature(EPISODE, 0, number, tag, 0, bytes([robot])))
            assert bench.relay_deadline.running == running
        episode, tick, sent, bundles = bench.outside.bundles[-1]
        assert (episode, tick, sent) == (EPISODE, 0, number)
        assert [sorted(bundle.payloads) for bundle in bundles] == [[b"\1", b"\2"], [b"\0", b"\2"], [b"\0", b"\1"]]


def test_a_round_ends_without_messages_that_are_late():
    bench = Bench("relayed")
    bench.begin_ticking()
    bench.server.take_feature(PackedFeature(EPISODE, 0, 0, bench.sent[0].own_tag, 0, b"x"))
    bench.server.end_round()
    assert [len(bundle.payloads) for bundle in bench.outside.bundles[-1][3]] == [0, 1, 1]
    assert not bench.relay_deadline.running
    bench.server.take_feature(PackedFeature(EPISODE, 0, 0, bench.sent[1].own_tag, 0, b"x"))
    assert "dropped a message of round 0, while round 1 is under way" in bench.log.lines[-1]


@pytest.mark.parametrize("radio", ["direct", "relayed"])
def test_what_is_sent_in_a_tick_goes_out_in_random_order(radio: str) -> None:
    """In a fixed order the arrival of features would tell the robots' numbers."""
    bench = Bench(radio)
    bench.begin_ticking(t_max=400)
    for _ in range(300):
        if radio == "relayed":
            bench.server.end_round()
        bench.prefer(Primitive.IDLE, 0, 1, 2)
    orders = bench.outside.orders
    assert {tuple(order) for order in orders} == set(itertools.permutations(range(3)))
    # A third of the time each, with a standard deviation of at most 0.027.
    for place, robot in itertools.product(range(3), repeat=2):
        assert 0.17 < sum(order[place] == robot for order in orders) / len(orders) < 0.5


def test_the_streams_of_a_team_follow_from_the_secret_of_the_goal(bench: Bench) -> None:
    bench.begin_ticking()
    streams = [sent.stream for sent in bench.sent]
    assert streams == episode_streams(1, 0, 3, SECRET).robots.tolist()
    assert streams != episode_streams(1, 0, 3).robots.tolist()
