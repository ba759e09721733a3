"""What computes needs no ROS: a machine that only trains has none."""

import subprocess
import sys

MODULES = [
    "magat_expert",
    "magat_robot.exchange",
    "magat_robot.policy.store",
    "magat_sim.rollout",
    "magat_training.train",
]


def test_training_and_its_parts_import_nothing_of_ros() -> None:
    program = f"""
import importlib, sys
for name in {MODULES}:
    importlib.import_module(name)
ros = {{name.partition(".")[0] for name in sys.modules}} & {{"rclpy", "launch", "magat_interfaces", "std_msgs"}}
sys.exit(" ".join(sorted(ros)))
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
