# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is found out from a bag of a team whose every message is known, because it is simulated here."""

import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from magat_recording import tables
from magat_recording.attention import attention_received, effective_neighbours, links, relative_attention
from magat_recording.bag import BagError
from magat_recording.deadlocks import deadlocks
from magat_recording.findings import analyze
from magat_recording.report import make_report, save
from magat_recording.tables import TeamRecording


def test_the_measures_are_the_simulators(simulate, small_policy):
    made = simulate(small_policy(), silent=(3, 2), deaf=(5, 1))
    recording = TeamRecording(made.bag)
    episodes = recording.episodes
    for row, measures in zip(episodes.itertuples(), made.measures, strict=True):
        for name in ("success", "success_strict", "delta_ft", "delta_ft_strict", "p_rg", "makespan", "t_max", "ticks",
                     "moves_blocked"):  # fmt: skip
            assert getattr(row, name) == getattr(measures, name), name
        assert row.flowtime == measures.flowtime.first_visit
        assert row.ended
    assert episodes.silent.tolist() == [1, 1]
    assert episodes.features_missing.tolist() == made.missing
    assert sum(made.missing) > 0
    ticks = made.measures[0].ticks
    assert episodes.bytes_per_tick[0] == pytest.approx((sum(100 + i for i in range(6)) * ticks - 102) / (6 * ticks - 1))
    assert len(recording.lost) == 0


def test_each_row_says_what_a_robot_saw_said_and_did(simulate, small_policy):
    made = simulate(small_policy(), episodes=1, silent=(3, 2))
    recording = TeamRecording(made.bag)
    robots, ticks = recording.robots, recording.ticks
    assert recording.names == list(made.names)
    assert len(robots) == 6 * len(ticks) == 6 * made.measures[0].ticks
    late = robots[(robots.tick == 3) & (robots.robot == 2)].iloc[0]
    assert late.silent
    assert late.action == 0
    assert late[["heard", "entropy", "bytes", "compute", "latency"]].isna().all(), "it came too late to count"
    others = robots[~robots.silent]
    assert others.latency.to_numpy() == pytest.approx((others.robot + 1) * 1e-3)
    assert others.compute.unique().tolist() == [0.0015]
    assert (others.heard == others.neighbours).all()
    assert others.entropy.between(0, np.log2(5)).all()
    # A robot is next where its move takes it.
    after = robots.merge(robots.assign(tick=robots.tick - 1), on=["tick", "robot"], suffixes=("", "_next"))
    step = {0: (0, 0), 1: (0, 1), 2: (0, -1), 3: (-1, 0), 4: (1, 0)}
    for row in after.itertuples():
        assert (row.x + step[row.moved][0], row.y + step[row.moved][1]) == (row.x_next, row.y_next)
    assert (ticks.slowest == 5).all()
    assert ticks.links.sum() == robots.neighbours.sum()
    assert ticks.silent.tolist() == [int(tick == 3) for tick in range(len(ticks))]


def test_entropy_is_that_of_the_probabilities(simulate, small_policy):
    recording = TeamRecording(simulate(small_policy(), episodes=1).bag)
    said = recording.all_episodes[0].ticks[0]
    for robot, observation in said.observations.items():
        logs = np.array(said.preferences[observation.message.own_tag].message.log_probabilities)
        by_hand = -sum(np.exp(logs) * np.log2(np.exp(logs)))
        assert recording.robots.entropy[robot] == pytest.approx(by_hand, abs=1e-6)


@pytest.mark.parametrize("kind", ["Observation", "Feature", "Preference", "FeatureBundle"])
def test_a_message_that_the_recording_lacks_is_missed(simulate, small_policy, kind):
    made = simulate(
        small_policy(), episodes=1, relayed=True, lose=lambda k, tick, robot: (k, tick, robot) == (kind, 4, 3)
    )
    lost = TeamRecording(made.bag).lost
    assert lost[["episode", "tick"]].to_numpy().tolist() == [[0, 4]]
    counts = lost.iloc[0][["observations", "features", "preferences", "bundles"]].tolist()
    column = ["Observation", "Feature", "Preference", "FeatureBundle"].index(kind)
    assert counts[column] == 1
    # Without its observation nobody can say which features and preferences are a robot's.
    assert sum(counts) == (3 if kind == "Observation" else 1)


def test_a_preference_that_did_not_come_in_time_is_not_missed(simulate, small_policy):
    made = simulate(small_policy(), silent=(4, 3), lose=lambda kind, tick, r: (kind, tick, r) == ("Preference", 4, 3))
    assert len(TeamRecording(made.bag).lost) == 0


def test_senders_are_known_by_their_tags_only(simulate, small_policy):
    messages = TeamRecording(simulate(small_policy(), episodes=1).bag).messages
    features = messages[messages.kind == "Feature"]
    assert features.groupby("tick").robot.apply(sorted).map(tuple).unique().tolist() == [(0, 1, 2, 3, 4, 5)]
    assert (features["round"] == 0).all()
    assert messages[messages.kind == "RobotStatus"][["episode", "tick", "robot"]].to_numpy().tolist() == [[-1, -1, -1]]
    without = messages[messages.kind == "World"]
    assert (without.robot == -1).all()
    assert (without.episode == 0).all()


def test_an_episode_that_began_before_the_recording_is_left_out(simulate, small_policy):
    made = simulate(small_policy(), lose=lambda kind, tick, robot: kind == "World" and tick == 0)
    with pytest.raises(BagError, match="no complete episode"):
        TeamRecording(made.bag)


def test_one_that_lacks_a_world_is_left_out_and_the_others_are_there(simulate, small_policy):
    seen = []

    def lose(kind: str, tick: int, _: int) -> bool:
        seen.append((kind, tick))
        return kind == "World" and tick == 2 and seen.count(("World", 2)) == 1

    recording = TeamRecording(simulate(small_policy(), lose=lose).bag)
    assert recording.incomplete_episodes == 1
    assert recording.episodes.id.tolist() == [101]


# --- Attention ---


@pytest.mark.parametrize("name", ["MAGAT-F-16", "MAGAT-B-16-P2", "GAT-F-16", "GNN-F-16"])
def test_attention_is_what_the_robots_paid(simulate, small_policy, random_network, name):
    policy, network = small_policy(name), random_network(name)
    recording = TeamRecording(simulate(policy, episodes=1).bag)
    table = links(recording, policy)
    # By the paper's formula, from what is in the bag, robot by robot, in floating point.
    said = recording.all_episodes[0].ticks[1]
    x = {
        robot: np.frombuffer(said.features[o.message.own_tag, 0].message.payload, "<f4").astype(float)
        for robot, o in said.observations.items()
    }
    layer = network.layers[0]
    checked = 0
    for receiver, observation in said.observations.items():
        senders = [said.senders[tag] for tag in observation.message.audible_tags]
        for head in range(policy.config.heads):
            if name.startswith("MAGAT"):
                W = layer.query.weight.detach().numpy().reshape(policy.config.heads, 16, 16)[head]
                scores = [x[receiver] @ W.T @ x[sender] for sender in senders]
            elif name.startswith("GAT"):
                half = np.einsum("fg,hg->hf", layer.taps[0, head].detach(), layer.pair[:, head].detach())
                scores = [half[0] @ x[receiver] + half[1] @ x[sender] for sender in senders]
            else:
                scores = [0.0 for _ in senders]
            weights = np.exp([max(score, 0.2 * score) for score in scores])
            rows = table[(table.tick == 1) & (table.receiver == receiver) & (table["head"] == head)]
            found = rows.set_index("sender").attention
            assert set(found.index) == set(senders)
            assert found[senders].to_numpy() == pytest.approx(weights / weights.sum(), abs=0.05)
            checked += len(senders) > 1
    assert checked > 0


def test_attention_sums_to_one_in_every_round_whatever_the_encoding(simulate, small_policy):
    policy = small_policy("MAGAT-F-16-P2", taps=3, layers=2)
    recording = TeamRecording(simulate(policy, episodes=1, encoding="int8").bag)
    assert recording.rounds == 4
    table = links(recording, policy)
    assert sorted(table["round"].unique()) == [0, 1, 2, 3]
    sums = table.groupby(["tick", "receiver", "round", "head"]).attention.sum()
    assert sums.to_numpy() == pytest.approx(1.0)
    assert len(table) == 4 * 2 * len(links(recording))


def test_a_lost_feature_leaves_its_link_out_and_the_others_share_what_it_would_have_had(simulate, small_policy):
    policy = small_policy()
    made = simulate(policy, episodes=1, lose=lambda kind, tick, robot: (kind, tick, robot) == ("Feature", 2, 1))
    table = links(TeamRecording(made.bag), policy)
    now = table[table.tick == 2]
    assert 1 not in now.sender.tolist()
    assert 1 in table[table.tick == 1].sender.tolist()
    assert now.groupby("receiver").attention.sum().to_numpy() == pytest.approx(1.0)


def test_another_policy_is_refused(simulate, small_policy):
    recording = TeamRecording(simulate(small_policy(), episodes=1).bag)
    with pytest.raises(BagError, match="are not those of MAGAT-F-16"):
        links(recording, small_policy(seed=1))


def test_distance_and_conflict_are_those_of_the_world(simulate, small_policy):
    recording = TeamRecording(simulate(small_policy(), episodes=2).bag)
    robots = recording.robots.set_index(["episode", "tick", "robot"])
    step = np.array([(0, 0), (0, 1), (0, -1), (-1, 0), (1, 0)])
    kinds = set()
    for link in links(recording).itertuples():
        a, b = (robots.loc[(link.episode, link.tick, robot)] for robot in (link.receiver, link.sender))
        here, there = np.array([a.x, a.y]), np.array([b.x, b.y])
        assert link.distance == pytest.approx(np.linalg.norm(here - there))
        assert link.distance <= 7
        one, other = here + step[int(a.action)], there + step[int(b.action)]
        vertex, swap = (one == other).all(), (one == there).all() and (other == here).all()
        assert link.conflict == (vertex or swap)
        kinds.add(bool(link.conflict))
    assert kinds == {True, False}


def test_attention_is_put_in_groups():
    columns = [
        "episode",
        "tick",
        "round",
        "head",
        "receiver",
        "sender",
        "neighbours",
        "distance",
        "conflict",
        "attention",
    ]
    rows = [
        (0, 0, 0, 0, 0, 1, 2, 1.0, True, 0.75),
        (0, 0, 0, 0, 0, 2, 2, 1.5, False, 0.25),
        (0, 0, 0, 0, 1, 0, 1, 1.0, True, 1.0),  # hears one only: nothing to choose
        (0, 1, 0, 0, 0, 1, 2, 3.0, False, 0.5),
        (0, 1, 0, 0, 0, 2, 2, 2.0, False, 0.5),
    ]
    table = pd.DataFrame(rows, columns=columns)
    near = relative_attention(table, "distance")
    assert near.distance.tolist() == [1, 2, 3]
    assert near.relative.tolist() == [1.5, 0.75, 1.0]
    assert near.links.tolist() == [1, 2, 1]
    assert relative_attention(table, "conflict").relative.tolist() == [pytest.approx((0.5 + 1 + 1) / 3), 1.5]
    density = effective_neighbours(table)
    entropy = -(0.75 * np.log(0.75) + 0.25 * np.log(0.25))
    assert density.neighbours.tolist() == [1, 2]
    assert density.effective.tolist() == pytest.approx([1.0, (np.exp(entropy) + 2) / 2])
    assert density.robots.tolist() == [1, 2]
    assert attention_received(table).to_dict() == {
        0: 1.0,
        1: pytest.approx((0.75 + 0.5) / 2),
        2: pytest.approx((0.25 + 0.5) / 2),
    }


# --- Deadlocks ---


def walks(*paths: str, goal: int = 99, silent: tuple[int, ...] = ()) -> pd.DataFrame:
    """Robots on a line; each character is the x of a robot at a tick."""
    rows = [
        (0, tick, robot, int(path[tick]), 0, goal, 0, robot in silent)
        for tick in range(len(paths[0]))
        for robot, path in enumerate(paths)
    ]
    return pd.DataFrame(rows, columns=["episode", "tick", "robot", "x", "y", "goal_x", "goal_y", "silent"])


@pytest.mark.parametrize(
    ("paths", "found"),
    [
        (["0123456789"], []),
        (["0111112345"], []),
        (["0111111111", "9555555555"], [(0, 10, (0,)), (0, 10, (1,))]),
        (["0122222222", "9876333333"], [(1, 9, (0, 1))]),
        (["0121212121", "9876543333"], [(1, 9, (0,))]),
        (["2222222789", "3333333899"], [(0, 8, (0, 1))]),
    ],
    ids=["moving", "waiting for long", "far apart", "head on", "to and fro", "resolved"],
)
def test_deadlocks_are_found(paths, found):
    table = deadlocks(walks(*paths), patience=7)
    assert sorted(zip(table.begin, table.ticks, table.robots, strict=True)) == sorted(found)


def test_who_rests_on_its_goal_is_no_deadlock_and_who_is_silent_is_told():
    assert len(deadlocks(walks("5555555555", goal=5))) == 0
    assert deadlocks(walks("5555555555", silent=(0,))).silent.tolist() == [True]
    assert deadlocks(walks("5555555555")).silent.tolist() == [False]


# --- The command ---


def test_an_analyst_needs_no_ros():
    program = (
        "import sys, magat_recording.attention, magat_recording.findings, magat_recording.charts; print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert "magat_recording" in loaded
    assert not loaded & {"rclpy", "magat_interfaces"}


def test_of_several_policies_that_were_carried_all_are_named(simulate, small_policy):
    made = simulate(small_policy(), digests=["d" * 64, "e" * 64, "d" * 64])
    findings = analyze(made.bag, None, Console(quiet=True))
    assert (
        "carried several policies, MAGAT-F-16 (dddddddddddd), MAGAT-F-16 (eeeeeeeeeeee): record each of them separately"
        in findings.no_attention
    )
    assert findings.policy is None


def test_the_report_is_plain_json_and_pictures_and_tables_are_written(simulate, small_policy, tmp_path):
    made = simulate(small_policy(), silent=(3, 2))
    findings = analyze(made.bag, None, Console(quiet=True))
    assert "there is no policy MAGAT-F-16 (dddddddddddd)" in findings.no_attention
    said = json.loads(json.dumps(make_report(findings).to_json(), allow_nan=False))
    assert said["lost"] == {"observations": 0, "features": 0, "preferences": 0, "bundles": 0}
    assert said["attention"] == {}
    assert [robot["silent"] for robot in said["traffic"]] == [0, 0, 2, 0, 0, 0]
    assert said["traffic"][5]["slowest"] == 1.0
    assert said["tick_seconds"]["p50"] == pytest.approx(0.01)
    save(findings, tmp_path / "out", Console(quiet=True))
    written = {path.name for path in (tmp_path / "out").iterdir()}
    tables = ("episodes", "ticks", "robots", "messages", "lost", "links", "deadlocks")
    assert written == {"timing.png", "decisions.png", *(f"{name}.csv" for name in tables)}
    assert len(pd.read_csv(tmp_path / "out" / "robots.csv")) == len(findings.recording.robots)


def test_a_bag_of_an_older_version_is_refused(simulate, small_policy, monkeypatch):
    made = simulate(small_policy(), episodes=1)
    messages = [
        one._replace(message=SimpleNamespace(episode=1, tick=0)) if one.type.endswith("/World") else one
        for one in tables.read_recording(made.bag)
    ]
    monkeypatch.setattr(tables, "read_recording", lambda bag: messages)
    with pytest.raises(BagError, match="older version"):
        TeamRecording(made.bag)
