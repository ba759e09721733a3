# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A team of processes on MovingAI's files."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from team_secret import SECRET

from magat_evaluation.cases import solve_cases
from magat_evaluation.planners import evaluate
from magat_robot.policy.models import find_policy
from magat_robot.policy.store import load
from magat_sim.case import draw_case
from magat_sim.movingai import write_case

pytestmark = pytest.mark.system


@pytest.mark.faults
def test_a_team_walks_the_cases_of_the_files_as_the_batched_simulator_does(tmp_path: Path) -> None:
    cases = [draw_case(3, 0, 12, 9, robots, 0.15) for robots in (6, 7)]
    for case in cases:
        write_case(case, tmp_path / "field.map", tmp_path / f"{case.robots}.scen")
    files = ["--map", tmp_path / "field.map", "--scen", tmp_path / "6.scen", tmp_path / "7.scen"]
    options = ["--robots", "6", "--crew", "3", "--radio", "relayed", "--seed", "5", "--secret", SECRET.hex()]
    environment = {name: value for name, value in os.environ.items() if name != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
    command = [sys.executable, "-m", "magat_cli", "run", *map(str, [*files, *options, "--output", tmp_path / "out"])]
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=100)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "Cases on field.map" in ran.stdout
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert [one["secret"] for one in results] == [SECRET.hex()] * 2
    first = [type(case)(case.obstacles, case.starts[:6], case.goals[:6]) for case in cases]
    walked = evaluate(load(find_policy("MAGAT-F-128")), list(solve_cases(first, range(2))), seed=5, secret=SECRET)
    assert [(one["ticks"], one["flowtime"], one["expert_flowtime"], one["moves_blocked"]) for one in results] == [
        (one.ticks, one.flowtime.first_visit, one.expert_flowtime.first_visit, one.moves_blocked) for one in walked
    ]
