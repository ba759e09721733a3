# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A team's discovery server: Fast DDS's own program, at the address in ``ROS_DISCOVERY_SERVER`` and nowhere else."""

import os
import sys

from magat_node.imports import quiet_imports

with quiet_imports():
    from magat_bringup.environment import PROFILES

PROGRAM = "fast-discovery-server"


def main() -> int:
    """Become the server; returns, with an exit status, only if that is not possible."""
    host, _, port = os.environ.get("ROS_DISCOVERY_SERVER", "").rpartition(":")
    if not host or not os.environ.get("MAGAT_ADDRESS"):
        print('no address to listen on: eval "$(magat env --server ADDRESS)" first', file=sys.stderr)
        return 1
    # What makes nodes clients of the server would make it its own.
    for name in ("ROS_DISCOVERY_SERVER", "FASTRTPS_DEFAULT_PROFILES_FILE"):
        os.environ.pop(name, None)
    command = [PROGRAM, "-i", "0", "-l", os.environ["MAGAT_ADDRESS"], "-p", port, "-x", f"server@{PROFILES}"]
    try:
        os.execvp(PROGRAM, command)
    except FileNotFoundError:
        print(f"{PROGRAM} is not on the PATH: it is part of Fast DDS, source the setup.bash of ROS", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
