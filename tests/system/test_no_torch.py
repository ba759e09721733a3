# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A running team needs no torch, nor does what shows and records it."""

from pathlib import Path

import pytest

from magat_evaluation.splits import SPLITS
from magat_viewer.address import free_port

pytestmark = pytest.mark.system


def test_no_process_of_a_team_has_loaded_torch(start_team, tmp_path):
    with start_team(4, crew=2, rviz=True, view=free_port(), record=tmp_path / "bag") as team:
        team.run(team.goal(SPLITS["test"][0]))
        names = ["robots", "simulator", "expert", "recorder", "rviz_bridge", "viewer"]
        maps = {
            f"{name} {pid}": Path(f"/proc/{pid}/maps").read_text()
            for name in names
            for pid in team.processes.pids(name)
        }
    assert sum("onnxruntime" in text for name, text in maps.items() if name.startswith("robots")) == 2
    assert not [name for name, text in maps.items() if "libtorch" in text]
