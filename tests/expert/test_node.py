# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The expert as a service: several clients at once, time limits, and an answer to each request at shutdown."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.task import Future

from magat_bringup.environment import loopback, own_domain
from magat_expert.node import ExpertNode
from magat_interfaces.srv import SolveMapf

RING = {"width": 2, "height": 2, "obstacles": [0] * 4, "start_x": [0, 1, 1, 0], "start_y": [0, 0, 1, 1]}
#: Four robots on four cells, two of which are to change places: the search has no end of its own.
HOPELESS = RING | {"goal_x": [1, 0, 1, 0], "goal_y": [0, 0, 1, 1]}
EASY = RING | {"goal_x": [1, 1, 0, 0], "goal_y": [0, 1, 1, 0]}


class CountingExpert(ExpertNode):
    """Knows how many requests it has taken."""

    def __init__(self, **options: object) -> None:
        self.taken = 0
        super().__init__(**options)

    def _begin(self, request: SolveMapf.Request, send: Callable[[SolveMapf.Response], None]) -> None:
        super()._begin(request, send)
        self.taken += 1


class Clients:
    """A running expert, and clients of it with a node each."""

    def __init__(self, context: Context, expert: CountingExpert, end: Callable[[], None]) -> None:
        self.expert = expert
        self.end_expert = end
        self._context = context
        self._executor = SingleThreadedExecutor(context=context)

    def ask(self, time_limit: float, **fields: object) -> Future:
        """The answer to come for a client of its own."""
        node = rclpy.create_node("client", context=self._context)
        self._executor.add_node(node)
        client = node.create_client(SolveMapf, "solve_mapf")
        assert client.wait_for_service(10.0)
        return client.call_async(SolveMapf.Request(**({"w": 1.1} | fields), time_limit=time_limit))

    def spin(self, condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + 10.0
        while not condition():
            assert time.monotonic() < deadline, "it did not come about in 10 s"
            self._executor.spin_once(timeout_sec=0.02)

    def answer(self, future: Future) -> SolveMapf.Response:
        self.spin(future.done)
        return future.result()


@pytest.fixture(scope="module")
def domain() -> Iterator[int]:
    with own_domain() as number, pytest.MonkeyPatch.context() as patch:
        for name, value in loopback(number).items():
            patch.setenv(name, value)
        yield number


@pytest.fixture
def start(domain: int) -> Callable:
    @contextmanager
    def running(**parameters: object) -> Iterator[Clients]:
        context = Context()
        rclpy.init(context=context, domain_id=domain)
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        expert = CountingExpert(context=context, parameter_overrides=overrides)
        executor = EventsExecutor(context=context)
        executor.add_node(expert)
        told_to_end = threading.Event()

        def spin() -> None:
            while not told_to_end.is_set():
                executor.spin_once(timeout_sec=0.05)
            executor.remove_node(expert)
            executor.shutdown()
            expert.destroy_node()

        thread = threading.Thread(target=spin)
        thread.start()
        try:
            yield Clients(context, expert, told_to_end.set)
        finally:
            told_to_end.set()
            thread.join(10.0)
            rclpy.shutdown(context=context)
        assert not thread.is_alive()

    return running


def test_a_long_request_does_not_block_others(start):
    with start() as clients:
        long = clients.ask(60.0, **HOPELESS)
        clients.spin(lambda: clients.expert.taken == 1)
        answers = [clients.answer(clients.ask(60.0, **EASY)) for _ in range(3)]
        assert [answer.status for answer in answers] == [SolveMapf.Response.SOLVED] * 3
        assert answers[0].cost == 4
        assert not long.done()


def test_at_the_end_everybody_has_an_answer(start):
    with start(searches=1) as clients:
        answers = [clients.ask(60.0, **HOPELESS) for _ in range(3)]  # two of them wait for the first
        clients.spin(lambda: clients.expert.taken == 3)
        clients.end_expert()
        for answer in map(clients.answer, answers):
            assert answer.status == SolveMapf.Response.TIMED_OUT
            assert "shutting down" in answer.message


def test_no_search_is_longer_than_the_expert_allows(start):
    with start(max_time_limit=0.2) as clients:
        answer = clients.answer(clients.ask(math.inf, **HOPELESS))
        assert answer.status == SolveMapf.Response.TIMED_OUT
        assert "within 0.2 s" in answer.message
        assert 0.2 <= answer.time < 2.0
        assert "within 0.05 s" in clients.answer(clients.ask(0.05, **HOPELESS)).message


@pytest.mark.parametrize(("time_limit", "fields", "said"), [(math.nan, {}, "time_limit"), (1.0, {"w": 0.5}, "w is")])
def test_an_invalid_request_is_answered(start, time_limit, fields, said):
    with start() as clients:
        answer = clients.answer(clients.ask(time_limit, **(EASY | fields)))
        assert answer.status == SolveMapf.Response.INVALID
        assert said in answer.message


def test_a_failure_of_the_expert_itself_is_answered_and_survived(start, monkeypatch):
    def fail(*_: object, **__: object) -> None:
        raise MemoryError("no memory is left")

    with start() as clients:
        with monkeypatch.context() as patch:
            patch.setattr("magat_expert.node.solve", fail)
            answer = clients.answer(clients.ask(1.0, **EASY))
            assert answer.status == SolveMapf.Response.INVALID
            assert "no memory is left" in answer.message
        assert clients.answer(clients.ask(1.0, **EASY)).status == SolveMapf.Response.SOLVED
