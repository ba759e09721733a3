# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command line: what it prints, and how it fails."""

import json

import pytest

from magat_cli.main import main
from magat_evaluation.cases import solved_cases
from magat_evaluation.planners import evaluate
from magat_evaluation.splits import SPLITS
from magat_robot.policy.store import load
from magat_sim.measures import summarise


@pytest.fixture(scope="module")
def policy_folder():
    from magat_robot.policy.models import find_policy

    return find_policy("MAGAT-F-128")


def test_evaluate_prints_one_json_object_with_what_was_measured(capfd, policy_folder):
    assert main(["evaluate", "--cases", "4", "--json", "--policy", str(policy_folder)]) == 0
    report = json.loads(capfd.readouterr().out)
    measured = summarise(evaluate(load(policy_folder), list(solved_cases(SPLITS["test"][:4]))))
    for name in ("cases", "alpha", "alpha_strict", "delta_ft", "delta_ft_strict", "p_rg", "makespan"):
        assert report[name] == pytest.approx(getattr(measured, name)), name
    assert report["alpha_interval"] == pytest.approx(list(measured.alpha_interval))
    assert report["temperature"] == load(policy_folder).config.temperature
    assert report["first_case"] == SPLITS["test"].start


def test_a_temperature_can_be_tried(capfd, policy_folder):
    alphas = []
    for temperature in ("0.5", "50"):
        assert main(["evaluate", "--cases", "4", "--json", "--temperature", temperature]) == 0
        alphas.append(json.loads(capfd.readouterr().out)["p_rg"])
    assert alphas[1] < alphas[0], "at T = 50 robots walk at random"


def test_a_visit_memory_can_be_tried(capfd):
    assert main(["evaluate", "--cases", "4", "--visit-memory", "1.5"]) == 0
    assert "visit memory 1.5" in " ".join(capfd.readouterr().out.split())
    assert main(["evaluate", "--cases", "4", "--visit-memory", "-1"]) == 1
    assert "visit_memory -1.0 is not within 0 and 100" in " ".join(capfd.readouterr().err.split())


def test_a_team_is_scored_in_another_encoding_and_with_links_lost(capfd, policy_folder):
    def report(*options: str) -> dict:
        crowded = ["--robots", "30", "--width", "16", "--height", "16"]
        assert main(["evaluate", "--cases", "6", "--json", *crowded, *options]) == 0
        found = json.loads(capfd.readouterr().out)
        return found | {"seconds": 0}

    plain = report()
    assert (plain["encoding"], plain["link_loss"]) == ("float32", 0.0)
    # float16 holds every number of a message.
    assert report("--encoding", "float16") == plain | {
        "encoding": "float16",
        "bytes_per_step": plain["bytes_per_step"] - 2 * 128,
    }
    names = ("delta_ft", "delta_ft_strict", "moves_blocked")
    for options in (["--encoding", "int8"], ["--link-loss", "0.5"]):
        other = report(*options)
        assert [other[name] for name in names] != [plain[name] for name in names]
    assert (other["encoding"], other["link_loss"]) == ("float32", 0.5)
    pushed = report("--shield", "pibt")
    assert (plain["shield"], pushed["shield"]) == ("idle", "pibt")
    assert pushed["delta_ft"] != plain["delta_ft"]


def test_neither_the_processes_nor_their_number_change_a_measure(capfd, policy_folder):
    reports = []
    for workers in ("1", "2"):
        size = ["--robots", "400", "--width", "80", "--height", "80"]
        assert main(["evaluate", "--cases", "3", "--json", "--workers", workers, "--policy", "PIBT", *size]) == 0
        reports.append(json.loads(capfd.readouterr().out) | {"seconds": 0})
    assert reports[0] == reports[1]
    assert reports[0]["policy"] == "PIBT"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["evaluate", "--policy", "no-such-policy"], "no policy 'no-such-policy'"),
        (["evaluate", "--cases", "1000000"], "has 4500 cases"),
        (["evaluate", "--cases", "2", "--robots", "500"], "do not fit"),
        (["results", "--study", "magic"], "no study 'magic'"),
        (["run", "--policy", "no-such-policy"], "no policy 'no-such-policy'"),
        (["run", "--interface", "[/none]"], "no interface '[/none]' with an IPv4 address"),
        (["env", "--server", "nowhere.invalid"], "discovery server 'nowhere.invalid'"),
        (["analyze", "no-such-bag"], "there is no bag no-such-bag"),
        (["recover", "no-such-bag"], "there is no bag no-such-bag"),
        (["replay", "no-such-bag"], "there is no bag no-such-bag"),
        (["train", "MAGIC"], "unknown policy name 'MAGIC'"),
        (["train", "no-such.yaml"], "the recipe no-such.yaml cannot be read"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_sentence(capfd, arguments, said):
    assert main(arguments) == 1
    output = capfd.readouterr()
    assert said in " ".join((output.out + output.err).split())


def test_numbers_that_are_none_are_refused():
    for bad in ("-0.1", "1.5", "nan", "x"):
        with pytest.raises(SystemExit):
            main(["evaluate", "--link-loss", bad])
    for bad in ("0", "-1", "x"):
        with pytest.raises(SystemExit):
            main(["evaluate", "--cases", bad])
