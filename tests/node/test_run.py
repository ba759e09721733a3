# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""How nodes end."""

import subprocess
import sys

# Sends a further signal at each return of a Python function within the handler of the first one.
SIGNALS_IN_HANDLERS = """
import os, signal, sys
from magat_node import run

left = 50

def again(frame, event, _):
    global left
    if event == "return" and left and frame.f_globals.get("__name__") in ("threading", "magat_node.run"):
        left -= 1
        os.kill(os.getpid(), signal.SIGTERM)

signal.signal(signal.SIGTERM, run._end)
sys.setprofile(again)
os.kill(os.getpid(), signal.SIGTERM)
sys.setprofile(None)
print("left", left)
"""


def test_signals_that_arrive_while_one_is_handled_do_not_block_the_process() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", SIGNALS_IN_HANDLERS], capture_output=True, text=True, timeout=20, check=True
    )
    assert ended.stdout in {f"left {left}\n" for left in range(50)}, "no signal came within the handler"
