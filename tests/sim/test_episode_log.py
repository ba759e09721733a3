# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the log says of an episode's begin and end, and how a server is stopped; without ROS."""

from unittest.mock import MagicMock

import numpy as np
import pytest

from magat_sim.case import make_case
from magat_sim.episode_server import EpisodeLimits, EpisodeServer
from magat_sim.episode_states import EpisodeEnd, EpisodeRequest, ExpertPlan
from magat_sim.measures import Flowtime
from magat_sim.simulator import DEFAULT_RULES
from magat_sim.team import Equipment, Team

SECRET = bytes(32)
EPISODE, SEARCH = 7, "search"


class Goal:
    def __init__(self):
        self.cancel_requested = False
        self.ended: list[tuple[str, EpisodeEnd]] = []

    def feed_back(self, _):
        pass

    def succeed(self, end):
        self.ended.append(("succeeded", end))

    def abort(self, end):
        self.ended.append(("aborted", end))

    def cancel(self, end):
        self.ended.append(("cancelled", end))


class Served:
    """A server with the goal of one robot, which needs two steps, in the state ``state``."""

    def __init__(self, state: str):
        team = Team(["a"], [1], peers=0)
        outside = MagicMock()
        outside.expert_ready.return_value, outside.deploying.return_value = True, False
        outside.ask_expert.return_value = SEARCH
        self.log, self.goal = MagicMock(), Goal()
        self.server = EpisodeServer(
            team,
            "direct",
            DEFAULT_RULES,
            EpisodeLimits(60.0, 10.0, 0.1),
            outside,
            MagicMock(),
            MagicMock(),
            self.log,
            lambda: 100.0,
        )
        if state != "gathering":
            team.by_name["a"].answered(100.0)
            team.by_name["a"].reported(100.0, 0, Equipment("digest", "float32", "direct", 1))
        if state != "idle":
            case = make_case(np.zeros((1, 4)), [(0, 0)], [(2, 0)])
            self.server.begin(self.goal, EpisodeRequest(EPISODE, case, 1, 0, 0, 1.1, SECRET))
        if state == "ticking":
            self.server.solved(SEARCH, ExpertPlan(2, Flowtime(2, 2)))

    @property
    def said(self) -> list[tuple[str, str]]:
        """Levels and texts."""
        return [(name, args[0]) for name, args, _ in self.log.method_calls]


def test_an_episode_is_logged_when_it_begins_and_when_it_ends():
    served = Served("ticking")
    for _ in range(6):
        served.server.end_tick()
    assert served.said[0] == ("info", "episode 7 begins: 1 robots on 4x1 cells, T_max 6")
    assert served.said[-1] == ("info", "episode 7 ended after 6 of 6 ticks, 0 of 1 robots arrived")


def test_an_episode_that_is_cancelled_is_logged_and_so_is_a_goal_that_cannot_be_served():
    served = Served("ticking")
    served.goal.cancel_requested = True
    served.server.end_tick()
    assert served.said[-1] == ("info", "episode 7 was cancelled after 1 of 6 ticks, 0 of 1 robots arrived")
    served.server.refuse(other := Goal(), 8, "no map")
    assert served.said[-1] == ("warning", "episode 8 was aborted: no map")
    assert [(how, end.error) for how, end in other.ended] == [("aborted", "no map")]


@pytest.mark.parametrize(
    ("state", "after"),
    [("gathering", ""), ("awaiting", ""), ("ticking", " after 0 of 6 ticks, 0 of 1 robots arrived")],
)
def test_a_server_that_is_stopped_aborts_its_goal_in_every_state(state, after):
    served = Served(state)
    assert not served.server.idle
    assert served.server.stop("it was told to end")
    assert [(how, end.error) for how, end in served.goal.ended] == [("aborted", "it was told to end")]
    assert served.said[-1] == ("warning", f"episode 7 was aborted{after}: it was told to end")
    assert served.server.idle
    assert not served.server.stop("again")
    assert len(served.goal.ended) == 1
