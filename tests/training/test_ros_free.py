# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What computes needs no ROS: a machine that only trains has none."""

import subprocess
import sys

MODULES = [
    "magat_expert",
    "magat_robot.policy_slot",
    "magat_robot.crew",
    "magat_robot.policy.store",
    "magat_sim.deployment",
    "magat_sim.movingai",
    "magat_sim.relay",
    "magat_sim.rollout",
    "magat_sim.team",
    "magat_sim.ticks",
    "magat_training.trainer",
    "magat_viewer.detail",
    "magat_viewer.server",
]


def test_training_and_its_parts_import_nothing_of_ros() -> None:
    program = f"import importlib, sys; [importlib.import_module(name) for name in {MODULES}]; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert {"magat_training", "magat_robot", "torch"} <= loaded
    assert not loaded & {"rclpy", "launch", "magat_interfaces", "std_msgs"}
