# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The client keeps the worlds of its own episode, whatever strangers publish."""

import time
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest
from hostile import HOSTILE, ONE_ROBOT

from magat_bringup.client import EpisodeClient, EpisodeError
from magat_bringup.environment import loopback, own_domain
from magat_interfaces.action import RunEpisode
from magat_interfaces.msg import World
from magat_node import qos
from magat_node.deferred import SingleGoalActionServer

TICKS = 5


class Team:
    """Processes that run for ever."""

    def __init__(self) -> None:
        self.given_up: dict[str, str] = {}

    def starts(self, name: str) -> int:
        return 1

    def check(self) -> None:
        pass


@pytest.fixture
def asked(monkeypatch) -> Iterator[SimpleNamespace]:
    """A client, and a simulator in the same process that publishes garbage between its worlds."""
    with own_domain() as domain:
        for name, value in loopback(domain).items():
            monkeypatch.setenv(name, value)
        with EpisodeClient(Team(), domain) as client:
            publisher = client.node.create_publisher(World, "world", qos.reliable(1000))
            ends = SimpleNamespace(error="", lost=())

            def begin(goal) -> None:
                robot = {**ONE_ROBOT, "width": 9, "goal_x": [8], "t_max": 9}
                for tick in range(TICKS + 1):
                    for data in HOSTILE["world"]:
                        publisher.publish(data)
                    publisher.publish(World(episode=100 + tick, robots=["mallory"], **ONE_ROBOT))
                    if tick not in ends.lost:
                        obstacles = [0] * 9 if tick == 0 else []
                        publisher.publish(
                            World(episode=7, tick=tick, robots=["alice"], obstacles=obstacles, **robot | {"x": [tick]})
                        )
                goal.succeed(RunEpisode.Result(episode=7, ticks=TICKS, error=ends.error))

            SingleGoalActionServer(client.node, RunEpisode, "run_episode", begin)
            yield SimpleNamespace(client=client, ends=ends)


def test_worlds_of_strangers_do_not_end_an_episode(asked, capfd):
    outcome = asked.client.run(RunEpisode.Goal(), lambda feedback: None)
    assert outcome.recorded
    np.testing.assert_array_equal(outcome.recording.positions[:, 0, 0], range(TICKS + 1))
    assert outcome.recording.robots == ["alice"]
    said = capfd.readouterr().err
    assert said.count("[episode_client]: dropped") == 1
    assert len(said) < 600


def test_a_world_that_is_lost_does_not_cost_the_result(asked, monkeypatch):
    monkeypatch.setattr("magat_bringup.client.TRAILING", 0.2)
    asked.ends.lost = (3,)
    begun = time.monotonic()
    outcome = asked.client.run(RunEpisode.Goal(), lambda feedback: None)
    assert not outcome.recorded
    assert outcome.result.ticks == TICKS
    assert time.monotonic() - begun < 10.0


@pytest.mark.parametrize(
    ("error", "of_case"), [("the expert gives no makespan (no solution): set t_max", True), ("not there: bob", False)]
)
def test_an_episode_that_was_not_run_says_whether_its_case_is_the_reason(asked, error, of_case):
    asked.ends.error = error
    with pytest.raises(EpisodeError, match="the episode failed: ") as raised:
        asked.client.run(RunEpisode.Goal(), lambda feedback: None)
    assert raised.value.of_case is of_case
