# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Locks on folders."""

import subprocess
import sys
from pathlib import Path

import pytest

from magat_node.errors import MagatError
from magat_node.lock import LockedError, locked

HOLD = """
import sys
from pathlib import Path
from magat_node.lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_folder_is_locked_until_its_process_is_killed(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "run"
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(LockedError, match=r"another process writes to .*run: wait for its end"), locked(folder):
            pass
        other.kill()
    with locked(folder), locked(tmp_path):
        assert list(folder.iterdir()) == []


def test_a_lock_ends_with_its_statement(tmp_path: Path) -> None:
    for _ in range(2):
        with locked(tmp_path):
            pass


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(MagatError, match=r"the folder .*file cannot be made"), locked(tmp_path / "file"):
        pass
