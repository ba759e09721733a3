# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The launch file needs only what launch itself needs: `ros2 launch` runs in the system's Python, not in ours."""

import subprocess
import sys
from pathlib import Path

from ament_index_python.packages import get_package_share_directory

LAUNCH_FILE = Path(get_package_share_directory("magat_bringup")) / "launch" / "team.launch.py"

#: Loads the launch file and starts what it describes, with launch replaced and all but the standard library, our own
#: packages and yaml (which launch needs, too) blocked.
PROGRAM = """
import importlib.util, sys
from types import ModuleType, SimpleNamespace
from unittest.mock import MagicMock

def free(name):
    top = name.partition(".")[0]
    return top in sys.stdlib_module_names or top in ("yaml", "_yaml", "ament_index_python") or top.startswith("magat_")

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if not free(name) or name.startswith("magat_interfaces"):
            raise ModuleNotFoundError(f"blocked: {name}", name=name)

defaults = {}

def argument(name, *, default_value, **_):
    defaults[name] = default_value
    return SimpleNamespace(name=name)

modules = {
    "launch": {"LaunchContext": object, "LaunchDescription": list},
    "launch.actions": {"DeclareLaunchArgument": argument, "OpaqueFunction": lambda function: function},
    "launch.substitutions": {
        "LaunchConfiguration": lambda name: SimpleNamespace(perform=lambda context: defaults[name])
    },
    "launch_ros": {},
    "launch_ros.actions": {"Node": SimpleNamespace},
}
for name, members in modules.items():
    sys.modules[name] = module = ModuleType(name)
    module.__getattr__ = lambda attribute: MagicMock()
    vars(module).update(members)
sys.meta_path.insert(0, Blocker())
spec = importlib.util.spec_from_file_location("team_launch", sys.argv[1])
file = importlib.util.module_from_spec(spec)
spec.loader.exec_module(file)
*_, start = file.generate_launch_description()
for node in start(SimpleNamespace(launch_configurations={})):
    if isinstance(node, SimpleNamespace):
        print(node.package, node.executable)
"""


def test_the_launch_file_loads_and_starts_without_our_libraries() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(LAUNCH_FILE)], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert {"magat_robot robots", "magat_sim simulator", "magat_expert expert"} <= set(done.stdout.splitlines())
