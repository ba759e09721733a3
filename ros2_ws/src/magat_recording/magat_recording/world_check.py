# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Validation of World messages before they are shown or kept. Free of ROS."""

from typing import Any

import numpy as np

from magat_node.status_check import names_fault
from magat_sim.grid import inside

#: Most cells of a map that is shown: a map is drawn cell by cell, also one of which the message has only the size.
MOST_CELLS = 2**24
_COLUMNS = ("x", "y", "goal_x", "goal_y", "action", "moved", "silent", "missing", "visited")


def fault(world: Any) -> str | None:
    """Why a World message cannot be used, as the end of a sentence; None if it can."""
    robots, cells = len(world.robots), world.width * world.height
    lengths = {name: len(getattr(world, name)) for name in _COLUMNS}
    if robots == 0 or cells == 0:
        return f"{robots} robots are on {world.width} x {world.height} cells"
    if cells > MOST_CELLS:
        return f"the map has {world.width} x {world.height} cells: {MOST_CELLS} are shown at most"
    if any(length != robots for length in lengths.values()):
        return f"{robots} robots have arrays of {lengths}"
    if len(world.obstacles) not in (0, cells):
        return f"{len(world.obstacles)} obstacles are given for {world.width} x {world.height} cells"
    places = np.stack([[world.x, world.goal_x], [world.y, world.goal_y]], axis=-1)
    if not inside((world.height, world.width), places).all():
        return f"robots or goals are not on {world.width} x {world.height} cells"
    return names_fault(tuple(world.robots))
