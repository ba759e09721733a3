# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Processes of a team are watched: log lines are passed on, and killed processes are restarted, or not."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from magat_bringup.processes import TeamProcesses
from magat_bringup.team import Command, TeamFile, TeamPlan
from magat_node.errors import TeamError
from magat_node.restarts import RESTARTS


@dataclass(frozen=True)
class OneProgram(TeamPlan):
    """A team of one process, which runs ``program``; the page, if it is an ``observer``."""

    program: str = ""
    observer: bool = False

    def commands(self) -> list[Command]:
        folder = self.policy
        (folder / "program_of_a_test.py").write_text(self.program)
        name = "viewer" if self.observer else "simulator"
        return [Command(name, "", "", "program_of_a_test", observer=self.observer)]


@pytest.fixture
def start(tmp_path, monkeypatch):
    """Starts a team that runs a program; with what it says."""
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    started = []

    def make(program, respawn=True, observer=False):
        said = []
        plan = OneProgram(TeamFile.numbered(1), Path(tmp_path), respawn=respawn, program=program, observer=observer)
        started.append(TeamProcesses(plan, tmp_path / "logs", {}, lambda *line: said.append(line)))
        return started[-1], said

    yield make
    for team in started:
        team.stop()


def until(team, condition):
    deadline = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < deadline
        team.check()
        time.sleep(0.01)


SPEAK = """
import sys, time
sys.stdout.write("first\\nsec"); sys.stdout.flush(); time.sleep(0.3)
print("ond"); time.sleep(60)
"""


def test_lines_are_told_when_they_are_whole(start):
    team, said = start(SPEAK)
    until(team, lambda: len(said) == 2)
    assert said == [("simulator", "first"), ("simulator", "second")]


def test_who_is_killed_is_started_again_a_number_of_times(start):
    team, said = start("import time; print('here'); time.sleep(60)")
    for times in range(1, RESTARTS + 2):
        until(team, lambda times=times: said.count(("simulator", "here")) == times)
        assert team.starts("simulator") == times
        os.kill(team.pids("simulator")[0], signal.SIGKILL)
    with pytest.raises(TeamError, match="simulator: killed by signal 9, 11 times in 10 minutes, not started again"):
        until(team, lambda: False)
    assert sum("killed by signal 9, restarted" in line for _, line in said) == RESTARTS


def test_who_is_killed_stays_dead_if_the_plan_says_so(start):
    team, _ = start("import time; print('here', flush=True); time.sleep(60)", respawn=False)
    os.kill(team.pids("simulator")[0], signal.SIGTERM)
    with pytest.raises(TeamError, match="killed by signal 15, not started again"):
        until(team, lambda: False)


def test_who_ends_by_itself_has_said_why(start):
    team, _ = start("print('a reason'); raise SystemExit(3)")
    with pytest.raises(TeamError, match=r"ended with status 3, not started again\. Its last lines:\n  a reason"):
        until(team, lambda: False)
    assert team.starts("simulator") == 1


def test_an_observer_that_fails_is_given_up_and_the_team_goes_on(start):
    team, said = start("print('a reason ' + 400 * 'x'); raise SystemExit(3)", observer=True)
    until(team, lambda: "viewer" in team.given_up)
    assert team.starts("viewer") == 3
    assert "ended with status 3, 3 times in 10 minutes, not started again (a reason xxx" in team.given_up["viewer"]
    assert len(team.given_up["viewer"]) < 500
    errors = [line for _, line in said if line.startswith("[ERROR]")]
    assert len(errors) == 1
    assert "[viewer]" in errors[0]
    assert "the team goes on without it" in errors[0]
    team.check()
    team.stop()


def test_an_observer_that_is_killed_is_started_again(start):
    team, said = start("import time; print('here', flush=True); time.sleep(60)", observer=True)
    until(team, lambda: ("viewer", "here") in said)
    os.kill(team.pids("viewer")[0], signal.SIGKILL)
    until(team, lambda: said.count(("viewer", "here")) == 2)
    assert team.given_up == {}
