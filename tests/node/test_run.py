# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Programs: what they print when they cannot start, are told to end early, or wait for a clock."""

import importlib.util
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from magat_bringup.environment import loopback, own_domain
from magat_bringup.team import TeamFile, TeamPlan

WAITING = """
from magat_node.imports import quiet_imports

with quiet_imports():
    import time
    print("importing", flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_program_that_is_told_to_end_while_it_imports_prints_nothing(number):
    with subprocess.Popen(
        [sys.executable, "-c", WAITING], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as program:
        assert program.stdout.readline() == "importing\n"
        program.send_signal(number)
        assert program.communicate(timeout=20) == ("", None)
    assert program.returncode == 0


def test_imports_leave_the_handlers_of_signals_as_they_were():
    from magat_node.imports import quiet_imports

    before = signal.getsignal(signal.SIGINT)
    with quiet_imports():
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before


def test_every_program_imports_quietly(tmp_path):
    """What it imports before is the standard library, which takes no time."""
    plan = TeamPlan(TeamFile.numbered(1), tmp_path, rviz=True, view=8300, server=True, record=tmp_path / "bag")
    for module in ("magat_robot.node", *(command.module for command in plan.commands())):
        lines = Path(importlib.util.find_spec(module).origin).read_text().splitlines()
        third = [line for line in lines if line.startswith(("from ", "import ")) and _is_not_of_python(line)]
        assert third == ["from magat_node.imports import quiet_imports"], module


def _is_not_of_python(line: str) -> bool:
    return line.split()[1].partition(".")[0] not in sys.stdlib_module_names


NODE = """
import sys
import rclpy
from magat_node import run
from magat_node.parameters import declare_share
from rclpy.node import Node

run.CLOCK_TIMEOUT = 0.2

class Something(Node):
    def __init__(self):
        super().__init__("something")
        declare_share(self, "loss", 0.0, "")

sys.exit(run.run_node("something", Something))
"""


def run(*arguments: str, seconds: float = 0.0, **variables: str) -> tuple[int, list[str]]:
    """The status and the output of a node that is told to end after ``seconds``; if 0, it ends by itself."""
    with own_domain() as domain:
        environment = os.environ | loopback(domain) | variables
        with subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(NODE), *arguments],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        ) as node:
            if seconds:
                for line in node.stdout:
                    node.send_signal(signal.SIGINT)
                    return node.wait(20), [line, *node.stdout]
            output, _ = node.communicate(timeout=20)
    return node.returncode, output.splitlines()


def test_a_node_that_cannot_start_says_why_in_one_line(tmp_path):
    broken = tmp_path / "broken.yaml"
    broken.write_text("a: [\n")
    for arguments, variables, said in (
        (["--ros-args", "-p", "loss:=1.5"], {}, "the parameter loss is 1.5: give a share, 0 to 1"),
        ([], {"ROS_DOMAIN_ID": "abc"}, "ROS_DOMAIN_ID is 'abc'"),
        (["--ros-args", "--params-file", str(broken)], {}, "Couldn't parse params file"),
    ):
        status, lines = run(*arguments, **variables)
        assert status == 1
        (fatal,) = [line for line in lines if not line.endswith("[rcl]: Failed to parse global arguments")]
        assert "[FATAL]" in fatal
        assert said in fatal


def test_a_node_that_waits_for_a_simulated_clock_says_so():
    begun = time.monotonic()
    status, lines = run("--ros-args", "-p", "use_sim_time:=true", seconds=20.0)
    assert status == 0
    assert "use_sim_time is true, and there is no message on /clock" in lines[0]
    assert time.monotonic() - begun < 20.0
