# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command line in unusual shells: one line of what is wrong, or it works; never a traceback."""

import ast
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rich.console import Console

from magat_cli.main import main
from magat_evaluation.listing import UnusablePolicy, listing

SOURCES = Path(__file__).parents[2] / "ros2_ws" / "src"


def magat(*arguments: str, **variables: str) -> tuple[int, str, str]:
    """Status, standard output and standard error of a command."""
    environment = {name: value for name, value in os.environ.items() if name != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
    done = subprocess.run(
        [sys.executable, "-m", "magat_cli", *arguments],
        env=environment | variables,
        capture_output=True,
        timeout=60,
        check=False,
    )
    return done.returncode, done.stdout.decode(), done.stderr.decode()


@pytest.mark.parametrize("verb", [("view",), ("deploy", "MAGAT-F-128"), ("record", "bag"), ("replay", "bag")])
@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ({"ROS_DOMAIN_ID": "abc"}, "ROS_DOMAIN_ID is 'abc': give a whole number from 0 to 232, or unset it"),
        ({"ROS_DOMAIN_ID": "500"}, "ROS_DOMAIN_ID is '500'"),
    ],
)
def test_verbs_that_join_a_team_name_what_the_shell_has_wrong(monkeypatch, capfd, verb, variables, said):
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert main(list(verb)) == 1
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("magat: ")
    assert said in line


def test_where_the_user_chooses_the_middleware_it_has_to_be_there():
    status, out, err = magat("view", RMW_IMPLEMENTATION="rmw_cyclonedds_cpp")
    assert (status, out) == (1, "")
    assert "'rmw_cyclonedds_cpp', which is not installed: choose rmw_fastrtps_cpp" in err
    assert len(err.splitlines()) == 1


def test_where_we_choose_the_network_the_shell_does_not_count(tmp_path):
    shell = {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp", "ROS_DOMAIN_ID": "abc"}
    # It gets as far as the check of the case, with rclpy imported.
    status, _, err = magat("run", "--density", "-0", "--robots", "500", "--output", str(tmp_path / "run"), **shell)
    assert status == 1
    assert "500 robots do not fit on a 20x20 map" in " ".join(err.split())
    assert len(err.splitlines()) == 1


def test_a_log_folder_that_cannot_be_written_is_named_before_a_team_starts(tmp_path):
    (tmp_path / "file").write_text("")
    status, _, err = magat("run", "--output", str(tmp_path / "run"), ROS_LOG_DIR=str(tmp_path / "file" / "logs"))
    assert status == 1
    assert "ROS cannot write its logs to" in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "command",
    [
        ["run", "--output", "{file}/x"],
        ["data", "make", "--splits", "valid", "--output", "{file}/x"],
        ["results", "--output", "{file}/x", "--study", "none"],
        ["run", "--params", "{file}", "--output", "{file}/x"],
        ["run", "--team", "{file}"],
        ["run", "--map", "{file}", "--scen", "{file}"],
        ["analyze", "{file}/x"],
        ["plot", "{file}/x"],
        ["recover", "{file}/x"],
        ["view", "{file}/x"],
        ["replay", "{file}/x"],
    ],
    ids=" ".join,
)
def test_a_file_in_the_place_of_a_folder_is_one_line(tmp_path, capfd, command):
    (tmp_path / "file").write_text("nonsense")
    try:
        status = main([part.replace("{file}", str(tmp_path / "file")) for part in command])
    except SystemExit as ended:  # as argparse does
        status = ended.code
    assert status in (1, 2)
    last = capfd.readouterr().err.splitlines()[-1]
    assert last.startswith("magat")


def test_an_error_about_a_file_is_one_line_whatever_raises_it(monkeypatch, capfd, tmp_path):
    def disk_full(*_: object) -> None:
        raise OSError(28, "No space left on device", str(tmp_path / "x"))

    monkeypatch.setattr("magat_robot.policy.models.all_policies", disk_full)
    assert main(["models"]) == 1
    (line,) = capfd.readouterr().err.splitlines()
    assert line == f"magat: {tmp_path}/x: No space left on device: give another file or folder, or mend this one"


def test_a_terminal_without_all_characters_gets_question_marks():
    status, out, _ = magat("models", PYTHONIOENCODING="ascii")
    assert status == 0
    assert "?" in out


def test_a_narrow_terminal_cuts_nothing():
    name, width = "MAGAT-F-32-P4-of-a-long-name", 40
    console = Console(width=width, record=True, file=open(os.devnull, "w"))  # noqa: SIM115
    console.print(listing([UnusablePolicy(name, Path(), "damaged")]))
    text = console.export_text()
    assert "…" not in text
    folded = "".join(line.split(" ")[0] for line in text.splitlines())
    assert name in folded
    for path in SOURCES.glob("magat_*/magat_*/**/*.py"):
        for call in ast.walk(ast.parse(path.read_text())):
            if isinstance(call, ast.Call) and getattr(call.func, "attr", "") == "add_column":
                assert "overflow='fold'" in ast.unparse(call), f"{path}: a narrow terminal cuts {ast.unparse(call)}"


@pytest.mark.parametrize("delay", [0.05, 0.2, 0.5])
def test_a_command_that_is_interrupted_while_it_starts_prints_no_traceback(delay):
    with subprocess.Popen(
        [sys.executable, "-m", "magat_cli", "evaluate", "--cases", "100000"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    ) as command:
        _until_it_imports_ours(command.pid)
        time.sleep(delay)  # anywhere in its imports
        command.send_signal(signal.SIGINT)
        output, _ = command.communicate(timeout=30)
    assert b"Traceback" not in output
    assert len(output.splitlines()) <= 1


def _until_it_imports_ours(pid: int) -> None:
    """Wait until a process has loaded a library that Python itself does not load."""
    deadline = time.monotonic() + 20.0
    while "numpy" not in Path(f"/proc/{pid}/maps").read_text():
        assert time.monotonic() < deadline
        time.sleep(0.005)
