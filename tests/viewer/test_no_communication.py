# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Teams whose robots do not communicate (K = 1) are shown, analysed and drawn, without attention."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from magat_recording.attention import links
from magat_recording.findings import analyze
from magat_recording.plot import plot
from magat_recording.report import make_report, save, show
from magat_recording.tables import TeamRecording
from magat_robot.policy.policy import Policy
from magat_robot.policy.store import save as save_policy
from magat_viewer.detail import TeamSnapshot, TickOutcome, robot_detail
from magat_viewer.recorded import RecordedTeam, recorded_tick

WHY = "robots with MAGAT-F-16 and K = 1 do not communicate"


@pytest.fixture
def policy(small_policy) -> Policy:
    return small_policy(taps=1)


@pytest.mark.parametrize("encoding", ["float32", "int8"])
def test_a_page_shows_decisions_without_attention(simulate, policy, encoding):
    recording = TeamRecording(simulate(policy, episodes=1, encoding=encoding).bag)
    [episode] = recording.all_episodes
    team, in_range = RecordedTeam(recording, policy, ""), 0
    for tick, robot in itertools.product(range(4), range(6)):
        recorded = team.detail(0, tick, robot)
        assert recorded.no_attention == WHY
        assert all(one.attention is None for one in recorded.neighbours)
        observation = episode.ticks[tick].observations[robot].message
        preference = episode.ticks[tick].preferences[observation.own_tag].message
        assert recorded.probabilities == pytest.approx(np.exp(preference.log_probabilities), abs=1e-4)
        in_range += len(recorded.neighbours)
        # A live page has the world only, and computes the rest.
        world, after = episode.log, episode.log.worlds[tick + 1]
        snapshot = TeamSnapshot(tick, world.positions[tick], world.goals, world.obstacles)
        outcome = TickOutcome(after.silent[robot], after.missing[robot], after.action[robot])
        messages = replace(recorded_tick(episode, tick, robot), payloads=None, preference=None, outcome=outcome)
        assert robot_detail(robot, snapshot, messages, policy) == recorded
    assert in_range > 0


def test_links_have_no_attention(simulate, policy):
    recording = TeamRecording(simulate(policy, episodes=1).bag)
    table = links(recording, policy)
    assert len(table) > 0
    assert table.equals(links(recording))


def test_analyze_says_why_there_is_no_attention(simulate, random_network, policy, tmp_path, capsys):
    save_policy(random_network(taps=1), tmp_path / "policy", "")
    findings = analyze(simulate(policy).bag, str(tmp_path / "policy"), Console(quiet=True))
    assert findings.no_attention == WHY
    values = json.loads(json.dumps(make_report(findings).to_json(), allow_nan=False))
    assert values["attention"] == {}
    assert set(values["lost"].values()) == {0}
    show(findings, Console(width=200))
    assert WHY in capsys.readouterr().out
    save(findings, tmp_path / "out", Console(quiet=True))
    assert not (tmp_path / "out" / "attention.png").exists()


@pytest.mark.parametrize("name", ["one.svg", "one.gif"])
def test_plot_draws_links_instead_of_attention(simulate, random_network, policy, tmp_path, name):
    save_policy(random_network(taps=1), tmp_path / "policy", "")
    plot(simulate(policy).bag, 0, None, None, str(tmp_path / "policy"), tmp_path / name, Console(quiet=True))
    assert (tmp_path / name).stat().st_size > 1000
