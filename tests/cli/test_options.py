# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Options that would have no effect are refused, and results for programs are JSON."""

import argparse
import json

import pytest

from magat_cli.main import main
from magat_cli.options import Options, read_options
from magat_cli.output import print_json
from magat_node.errors import MagatError


def refused(capfd, *arguments: str) -> str:
    """What the command prints before it ends with status 1."""
    assert main(list(arguments)) == 1
    return " ".join(capfd.readouterr().err.split())


@pytest.mark.parametrize("option", ["seed", "robots", "width", "height", "density"])
def test_a_set_has_its_own_cases(capfd, option):
    said = refused(capfd, "evaluate", "--set", "large", f"--{option}", "1")
    assert f"--{option} has no effect with --set" in said


def test_a_set_has_no_files(capfd):
    assert "--scen has no effect with --set" in refused(capfd, "evaluate", "--set", "large", "--scen", "a.scen")


@pytest.mark.parametrize(
    ("option", "value"),
    [("shield", "pibt"), ("link-loss", "0.1"), ("temperature", "1"), ("visit-memory", "1"), ("encoding", "int8")],
)
def test_a_baseline_has_neither_messages_nor_a_temperature(capfd, option, value):
    for baseline in ("PIBT", "HCA", "Replan"):
        said = refused(capfd, "evaluate", "--policy", baseline, f"--{option}", value)
        assert f"--{option} has no effect with the baseline {baseline}" in said


def test_a_value_that_is_the_default_is_given_all_the_same(capfd):
    assert "--shield has no effect" in refused(capfd, "evaluate", "--policy", "PIBT", "--shield", "idle")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["evaluate", "--scen", "a.scen", "--cases", "3"], "--cases has no effect with --map and --scen"),
        (["view", "--policy", "GNN-F-128"], "--policy has no effect with a running team"),
        (["view", "bag", "--domain", "3"], "--domain has no effect with a recorded team"),
        (["view", "bag", "--screenshot", "a.png", "--port", "80"], "--port has no effect with --screenshot"),
        (["plot", "bag", "--output", "a.gif", "--tick", "3"], "--tick has no effect with an animation"),
        (["record", "bag", "--server", "here"], "--server has no effect with the environment's ROS domain"),
        (["bench-expert", "--large-cases", "3"], "--large-cases has no effect with the small sets alone (add --large)"),
    ],
)
def test_each_option_works_or_is_refused(capfd, arguments, said):
    assert said in refused(capfd, *arguments)


def parser() -> argparse.ArgumentParser:
    """One of each kind of option."""
    made = argparse.ArgumentParser()
    made.add_argument("bag", nargs="?")
    made.add_argument("--number", type=int, default=3)
    made.add_argument("--flag", action="store_true")
    made.add_argument("--many-words", nargs="+")
    made.add_argument("--switch", action=argparse.BooleanOptionalAction, default=True)
    return made


@pytest.mark.parametrize(
    ("line", "given"),
    [
        ("", set()),
        ("bag", set()),
        ("--number 3", {"number"}),
        ("--flag --no-switch bag", {"flag", "switch"}),
        ("--many-words a b", {"many_words"}),
    ],
)
def test_which_options_were_given_is_known(line, given):
    options = read_options(parser(), line.split())
    assert options.given == given
    assert options.number == 3 and isinstance(options, Options)
    assert options.bag == ("bag" if "bag" in line.split() else None)


def test_several_useless_options_are_named_together():
    options = read_options(parser(), ["--number", "3", "--many-words", "a"])
    options.without_effect("nothing", "flag")
    with pytest.raises(MagatError, match=r"^--number, --many-words have no effect with that: remove them$"):
        options.without_effect("that", "number", "flag", "many_words")


def test_json_has_null_where_a_number_is_missing(capfd):
    print_json({"a": float("nan"), "b": [1, (float("inf"), "x")], "c": None})
    assert json.loads(capfd.readouterr().out) == {"a": None, "b": [1, [None, "x"]], "c": None}


def test_one_case_has_no_interval(capfd):
    size = ["--robots", "3", "--width", "8", "--height", "8"]
    assert main(["evaluate", "--cases", "1", "--json", *size]) == 0
    report = json.loads(capfd.readouterr().out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert report["delta_ft_half_width"] is None
