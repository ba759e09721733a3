# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cases out of MovingAI's files: scored as drawn ones are, and asked of a team in full."""

import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from magat_bringup.run_plan import RunPlan
from magat_cli.main import main
from magat_evaluation.cases import solve_cases
from magat_evaluation.planners import evaluate
from magat_robot.policy.models import find_policy
from magat_robot.policy.store import load
from magat_sim.case import Case, draw_case
from magat_sim.measures import summarise
from magat_sim.movingai import write_case
from magat_sim.scenarios import Scenarios

QUIET = Console(quiet=True)


@pytest.fixture
def cases() -> list[Case]:
    """Two on one map of 12x9 cells, with 7 robots."""
    first = draw_case(3, 0, 12, 9, 7, 0.15)
    backwards = Case(first.obstacles, first.goals[::-1].copy(), first.starts[::-1].copy())
    return [first, backwards]


@pytest.fixture
def files(cases: list[Case], tmp_path: Path) -> list[str]:
    """A map, and a scenario of each case."""
    for name, case in zip("ab", cases, strict=True):
        write_case(case, tmp_path / "field.map", tmp_path / f"{name}.scen")
    return [str(tmp_path / name) for name in ("field.map", "a.scen", "b.scen")]


def test_a_policy_is_scored_on_files_as_on_drawn_cases(
    cases: list[Case], files: list[str], capfd: pytest.CaptureFixture
) -> None:
    command = ["evaluate", "--map", files[0], "--scen", *files[1:], "--robots", "7", "--seed", "5"]
    assert main([*command, "--json"]) == 0
    report = json.loads(capfd.readouterr().out)
    episodes = evaluate(load(find_policy("MAGAT-F-128")), list(solve_cases(cases, range(2))), seed=5)
    measured = summarise(episodes)
    for name in ("cases", "alpha", "alpha_strict", "delta_ft", "delta_ft_strict", "p_rg", "makespan", "moves_blocked"):
        assert report[name] == pytest.approx(getattr(measured, name)), name
    named = {name: report[name] for name in ("map", "width", "height", "robots", "density", "seed", "first_case")}
    density = cases[0].obstacles.mean()
    assert named == {"map": "field.map", "width": 12, "height": 9, "robots": 7, "density": density, "seed": 5,
                     "first_case": 0}  # fmt: skip
    assert main([*command, "--policy", "PIBT", "--workers", "2"]) == 0
    assert "2 cases of 12x9 (7) on field.map" in " ".join(capfd.readouterr().out.split())


def test_the_first_robots_of_a_scenario_are_taken(cases: list[Case], files: list[str]) -> None:
    found = Scenarios.read(Path(files[0]), [Path(file) for file in files[1:]], 3)
    assert [case.starts.tolist() for case in found.cases] == [case.starts[:3].tolist() for case in cases]
    assert found.size["robots"] == 3


def test_a_team_is_asked_for_each_case_in_full(cases: list[Case], files: list[str], tmp_path: Path) -> None:
    scenarios = Scenarios.read(Path(files[0]), [Path(file) for file in files[1:]], 7)
    plan = RunPlan(2, 12, 9, 0.15, 5, 0, tmp_path, scenarios=scenarios)
    for index, case in enumerate(cases):
        goal = plan.goal(index)
        assert (goal.seed, goal.number, goal.width, goal.height) == (5, index, 12, 9)
        assert np.array_equal(np.reshape(goal.obstacles, (9, 12)), case.obstacles)
        assert np.array_equal(np.stack([goal.start_x, goal.start_y], axis=1), case.starts)
        assert np.array_equal(np.stack([goal.goal_x, goal.goal_y], axis=1), case.goals)
    assert (plan.names, plan.title) == (["a", "b"], "Cases on field.map")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"--scen": []}, "--map and --scen belong together"),
        ({"--map": []}, "--map and --scen belong together"),
        ({"--robots": ["8"]}, "a.scen: it has 7 robots, but 8 are needed"),
        ({"--map": ["none.map"]}, "none.map cannot be read: No such file"),
        ({"--scen": ["twice.scen"]}, "is also that of line 2: starts must differ"),
        (
            {"--scen": ["apart.scen"], "--map": ["apart.map"], "--robots": ["1"]},
            "apart.scen:2: the goal (2, 0) cannot",
        ),
    ],
)
@pytest.mark.parametrize("command", ["evaluate", "run"])
def test_what_cannot_be_used_is_said_in_a_sentence(
    files: list[str], capfd: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch, command: str,
    change: dict[str, list[str]], said: str,
) -> None:  # fmt: skip
    folder = Path(files[0]).parent
    monkeypatch.chdir(folder)
    version, first, second, *_ = Path("a.scen").read_text().splitlines()
    Path("twice.scen").write_text("\n".join([version, first, first, second]))
    Path("apart.map").write_text("type octile\nheight 1\nwidth 3\nmap\n.@.\n")
    Path("apart.scen").write_text("version 1\n0\tapart.map\t3\t1\t0\t0\t2\t0\t2\n")
    given = {"--map": [files[0]], "--scen": files[1:], "--robots": ["7"]} | change
    assert main([command, *(word for name, values in given.items() if values for word in (name, *values))]) == 1
    captured = capfd.readouterr()
    assert said in " ".join((captured.out + captured.err).replace(f"{folder}/", "").split())


def test_drawn_cases_and_files_exclude_each_other(files: list[str]) -> None:
    for other in (["--split", "valid"], ["--set", "large"]):
        with pytest.raises(SystemExit):
            main(["evaluate", "--map", files[0], "--scen", files[1], *other])


def test_a_case_that_the_expert_does_not_solve_is_said(tmp_path: Path) -> None:
    corridor = Case(np.zeros((1, 3), dtype=bool), np.array([(0, 0), (1, 0)]), np.array([(1, 0), (0, 0)]))
    write_case(corridor, tmp_path / "a.map", tmp_path / "a.scen")
    assert (
        main(["evaluate", "--map", str(tmp_path / "a.map"), "--scen", str(tmp_path / "a.scen"), "--robots", "2"]) == 1
    )


def test_cases_without_a_reference_are_named_by_file_and_line(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    row = np.zeros((1, 4), dtype=bool)
    swap = Case(row, np.array([(0, 0), (3, 0)]), np.array([(3, 0), (0, 0)]))
    good = Case(row, np.array([(0, 0), (1, 0)]), np.array([(2, 0), (3, 0)]))
    for name, case in (("swap", swap), ("good", good)):
        write_case(case, tmp_path / "a.map", tmp_path / f"{name}.scen")
    files = [str(tmp_path / f"{name}.scen") for name in ("swap", "good")]
    limits = ["--expert-w", "1.5", "--expert-time", "5"]
    assert (
        main(["evaluate", "--map", str(tmp_path / "a.map"), "--scen", *files, "--robots", "2", "--json", *limits]) == 0
    )
    captured = capfd.readouterr()
    report = json.loads(captured.out)
    assert (report["cases"], report["unsolved_by_expert"], report["expert_w"]) == (1, 1, 1.5)
    assert "swap.scen:2-3: the expert does not solve this case" in captured.err
    assert "good.scen" not in captured.err
