# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Restarts are limited in a window of time, and what is given up says how often it was killed."""

import signal
import subprocess
import sys
import textwrap

from magat_node.restarts import RESTARTS, WINDOW, RestartLimit


def test_kills_in_quick_succession_are_too_many():
    limit = RestartLimit()
    assert all(limit.allows(float(number)) for number in range(RESTARTS))
    assert not limit.allows(RESTARTS)
    assert limit.spent == f"{RESTARTS + 1} times in 10 minutes"


def test_over_a_run_of_days_any_number_of_kills_is_fine():
    limit = RestartLimit()
    assert all(limit.allows(number * WINDOW / RESTARTS) for number in range(50 * RESTARTS))


def test_a_robot_that_is_given_up_is_named():
    """The robots' processes are replaced by ones that kill themselves."""
    program = """
        import os, signal
        from magat_robot import forked
        forked.node.main = lambda arguments: os.kill(os.getpid(), signal.SIGKILL)
        forked.RESTARTS = 2
        raise SystemExit(forked.run_robots(["alice", "bob"], [], crew=2, respawn=True))
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, check=False)
    said = [line.partition("[robots]: ")[2] for line in done.stdout.splitlines()]
    assert said == [
        *["alice, bob: killed by signal 9, restarted"] * 2,
        "alice, bob: killed by signal 9, 3 times in 10 minutes, not started again",
    ]
    assert done.stdout.splitlines()[-1].startswith("[ERROR] [")
    assert done.returncode == 128 + signal.SIGKILL
