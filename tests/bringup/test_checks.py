# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `magat run` refuses before it starts a process."""

import json
from dataclasses import replace
from pathlib import Path
from unittest import mock

import pytest
from team_secret import SECRET

from magat_bringup.run_plan import RunPlan
from magat_cli.main import main
from magat_robot.policy.models import find_policy

POLICY = "MAGAT-F-128"


@pytest.fixture(autouse=True)
def _nothing_starts():
    with mock.patch("magat_bringup.run.TeamProcesses", side_effect=AssertionError("a process was started")):
        yield


def refused(capfd, tmp_path: Path, *options: str) -> str:
    """What `magat run` prints before it ends with status 1."""
    output = [] if "--output" in options else ["--output", str(tmp_path / "run")]
    assert main(["run", *options, *output]) == 1
    out, err = capfd.readouterr()
    assert out == ""
    return " ".join(err.split())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--robots", "500"], "500 robots do not fit on a 20x20 map"),
        (["--density", "1"], "do not fit on a 20x20 map of obstacle density 1.0"),
        (["--width", "70000"], "a map of 70000x20 cells is too large: give at most 65535 cells a side"),
        (["--width", "5000", "--height", "5000"], "a map of 5000x5000 cells"),
        (["--seed", "-1"], "the seed -1 is out of range"),
        (["--first", "-3"], "the cases -3 to 6 are out of range"),
        (["--first", "4294967290"], "the cases 4294967290 to 4294967299 are out of range"),
        (["--params", "none.yaml"], "the parameter file none.yaml cannot be read"),
        (["--episodes", "3", "--require", "4"], "--require 4 cannot be met by 3 episodes"),
        (["--interface", "none0"], "no interface 'none0'"),
    ],
)
def test_what_cannot_run_is_refused(capfd, tmp_path, options, said):
    assert said in refused(capfd, tmp_path, *options)


def test_a_damaged_policy_is_refused(capfd, tmp_path):
    policy = tmp_path / "damaged"
    policy.mkdir()
    source = find_policy(POLICY)
    (policy / "config.json").write_text((source / "config.json").read_text())
    weights = bytearray((source / "model.safetensors").read_bytes())
    weights[-1] ^= 1
    (policy / "model.safetensors").write_bytes(weights)
    assert "is damaged or of another policy" in refused(capfd, tmp_path, "--policy", str(policy))
    (policy / "config.json").write_text(json.dumps({}))
    assert "config.json is damaged" in refused(capfd, tmp_path, "--policy", str(policy))


def test_a_bag_that_exists_is_refused(capfd, tmp_path):
    (tmp_path / "bag").mkdir()
    assert f"the bag {tmp_path / 'bag'} exists" in refused(capfd, tmp_path, "--record", str(tmp_path / "bag"))


def test_an_output_that_is_a_file_is_refused(capfd, tmp_path):
    (tmp_path / "file").write_text("")
    assert "cannot be made" in refused(capfd, tmp_path, "--output", str(tmp_path / "file"))


def test_options_of_drawn_cases_have_no_effect_with_files(capfd, tmp_path):
    (tmp_path / "a.map").write_text("type octile\nheight 1\nwidth 2\nmap\n..\n")
    (tmp_path / "a.scen").write_text("version 1\n0\ta.map\t2\t1\t0\t0\t1\t0\t1\n")
    files = ["--map", str(tmp_path / "a.map"), "--scen", str(tmp_path / "a.scen"), "--robots", "1"]
    said = refused(capfd, tmp_path, *files, "--width", "9", "--episodes", "2")
    assert "--width, --episodes have no effect with --map and --scen" in said


def test_a_team_file_names_the_robots(capfd, tmp_path):
    (tmp_path / "team.yaml").write_text("robots: [alice, bob]\n")
    said = refused(capfd, tmp_path, "--team", str(tmp_path / "team.yaml"), "--robots", "3")
    assert "--robots has no effect with --team" in said


@pytest.mark.parametrize("bound", ["0.5", "nan", "inf"])
def test_a_bound_that_the_expert_cannot_have_is_refused(capfd, bound):
    with pytest.raises(SystemExit):
        main(["run", "--expert-w", bound])
    assert f"{bound} is not a bound: give 1 (optimal) or more" in " ".join(capfd.readouterr().err.split())


def test_the_episodes_are_asked_for_with_the_bound_of_the_plan(tmp_path):
    plan = RunPlan(episodes=1, width=9, height=9, density=0.1, seed=1, first=0, output=tmp_path, expert_w=5.0)
    assert plan.goal(0).expert_w == 5.0


@pytest.mark.parametrize("secret", ["abcd", "xy" * 32, "0" * 66])
def test_a_secret_of_another_form_is_refused(capfd, secret):
    with pytest.raises(SystemExit):
        main(["run", "--secret", secret])
    assert f"{secret} is not a secret: give the 64 hexadecimal digits" in " ".join(capfd.readouterr().err.split())


def test_the_episodes_are_asked_for_with_the_secret_of_the_plan():
    plan = RunPlan(episodes=2, width=9, height=9, density=0.1, seed=1, first=0)
    assert [bytes(plan.goal(index).secret) for index in range(2)] == [b"", b""]
    assert bytes(replace(plan, secret=SECRET).goal(1).secret) == SECRET
