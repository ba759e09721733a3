# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A team without its robots, on the host that this program runs on: what `magat run --no-robots` starts, for tests.

Reads goals from standard input and writes what happens to standard output, one JSON object a line.
"""

import json
import os
import sys
from pathlib import Path
from typing import Any

from magat_bringup.client import EpisodeClient
from magat_bringup.environment import network_for
from magat_bringup.processes import TeamProcesses
from magat_bringup.team import TeamFile, TeamPlan
from magat_interfaces.action import RunEpisode
from magat_node.errors import TeamError

#: Of the result, what tests look at.
MEASURES = ("ticks", "t_max", "makespan", "success", "flowtime", "moves_blocked", "silent", "features_missing")


def main(settings: dict[str, Any]) -> None:
    """Run episodes until there is no more input."""
    plan = TeamPlan(
        TeamFile(tuple(settings["robots"])),
        Path(settings["policy"]),
        params=Path(settings["params"]),
        robots=False,
        server=True,
    )
    network = network_for(settings["domain"], plan.nodes, settings["interface"])
    os.environ.update(network.variables)
    logs = Path(settings["logs"])
    with TeamProcesses(plan, logs, network.variables) as processes, EpisodeClient(processes, network.domain) as client:
        client.wait_for_simulator()
        say(up=True)
        for line in sys.stdin:
            goal = RunEpisode.Goal(**json.loads(line))
            try:
                outcome = client.run(goal, lambda feedback: say(tick=feedback.tick, joined=feedback.joined))
            except TeamError as error:
                say(error=str(error))
                continue
            recording = outcome.recording
            worlds = [recording.worlds[tick] for tick in sorted(recording.worlds)]
            say(
                result={name: getattr(outcome.result, name) for name in MEASURES},
                obstacles=recording.obstacles.tolist(),
                positions=recording.positions.tolist(),
                silent=[list(world.silent) for world in worlds],
            )


def say(**what: object) -> None:
    print(json.dumps(what), flush=True)


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
