"""Validation of World messages before they are shown."""

import numpy as np

from magat_interfaces.msg import World
from magat_sim.grid import inside


def fault(world: World) -> str | None:
    """Why a World message cannot be drawn, as the end of a sentence; None if it can."""
    robots, cells = len(world.robots), world.width * world.height
    columns = ("x", "y", "goal_x", "goal_y", "action", "moved", "silent", "missing", "visited")
    lengths = {name: len(getattr(world, name)) for name in columns}
    if robots == 0 or cells == 0:
        return f"{robots} robots are on {world.width} x {world.height} cells"
    if any(length != robots for length in lengths.values()):
        return f"{robots} robots have arrays of {lengths}"
    if len(world.obstacles) not in (0, cells):
        return f"{len(world.obstacles)} obstacles are given for {world.width} x {world.height} cells"
    places = np.stack([[world.x, world.goal_x], [world.y, world.goal_y]], axis=-1)
    if not inside((world.height, world.width), places).all():
        return f"robots or goals are not on {world.width} x {world.height} cells"
    return None
