# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat view`` of a recording: a screenshot, and a replay that is watched."""

import os
import re
import subprocess
import sys
import time

import pytest
from PIL import Image

from magat_bringup.environment import loopback, own_domain
from magat_cli.main import main
from magat_viewer.follower import Follower


def test_a_screenshot_shows_what_was_asked_for(needs_chromium, simulate, small_policy, tmp_path):
    bag = str(simulate(small_policy()).bag)
    pictures = []
    for at in ("tick=3&robot=bob", "tick=4&robot=bob&theme=dark"):
        file = tmp_path / "page.png"
        assert main(["view", bag, "--at", at, "--screenshot", str(file)]) == 0
        with Image.open(file) as picture:
            assert (picture.format, picture.size) == ("PNG", (1440, 900))
            pictures.append(picture.convert("L").resize((1, 1)).getpixel((0, 0)))
    light, dark = pictures
    assert light > 200 > 80 > dark


def test_of_a_team_that_runs_there_is_none(capfd, tmp_path):
    assert main(["view", "--screenshot", str(tmp_path / "page.png")]) == 1
    assert "--screenshot has no effect with a running team (name the bag of a recorded one)" in " ".join(
        capfd.readouterr().err.split()
    )


@pytest.mark.system
@pytest.mark.faults
def test_a_replay_is_watched_as_if_it_were_live(simulate, small_policy):
    made = simulate(small_policy(), episodes=1)
    with own_domain() as domain:
        inherited = {k: v for k, v in os.environ.items() if k != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
        options = ["--view", "--rate", "0.05", "--delay", "1"]
        replay = subprocess.Popen(
            [sys.executable, "-m", "magat_cli", "replay", str(made.bag), *options],
            env=inherited | loopback(domain) | {"PYTHONUNBUFFERED": "1"},
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            [url] = re.findall(r"http://[0-9.:]+/", replay.stderr.readline())
            ticks = set()
            with Follower(url) as follower:
                deadline = time.monotonic() + 30
                while replay.poll() is None and time.monotonic() < deadline:
                    if frames := follower.last.get("frames"):
                        ticks.add(int.from_bytes(frames[-64:][4:8], "little"))
                    time.sleep(0.005)
            assert replay.wait(10) == 0
        finally:
            replay.kill()
    assert follower.last["team"]["live"] is True
    assert follower.last["scene"]["robots"] == list(made.names)
    assert len(ticks) > 5
