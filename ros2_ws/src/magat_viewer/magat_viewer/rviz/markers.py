# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A World message as an occupancy grid, markers and transforms."""

# mypy: disable-error-code="import-untyped,import-not-found"

import array
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Point, TransformStamped
from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from magat_interfaces.msg import World
from magat_pictures.colours import NEUTRAL, OKABE_ITO, rgb
from magat_sim.grid import IntArray
from magat_sim.radio import neighbours

FloatArray = npt.NDArray[np.float64]

#: Values of an occupancy grid.
FREE, OCCUPIED, UNKNOWN = 0, 100, -1


def occupancy(world: World, cell: float, header: Header) -> OccupancyGrid:
    """The map of a world, in cells of ``cell`` metres; unknown if the message has no obstacles (tick > 0)."""
    grid = OccupancyGrid(header=header)
    grid.info.map_load_time = header.stamp
    grid.info.resolution = float(cell)
    grid.info.width, grid.info.height = world.width, world.height
    # The origin of the map is the corner of cell (0, 0). Both go row by row from y = 0, x to the right, y up.
    values = np.full(world.width * world.height, UNKNOWN, dtype=np.int8)
    if len(world.obstacles) > 0:
        values = np.where(np.asarray(world.obstacles) != 0, OCCUPIED, FREE)
    grid.data = array.array("b", values.astype(np.int8).tobytes())
    return grid


def markers(world: World, cell: float, header: Header) -> list[Marker]:
    """Robots, goals, lines to the goals and radio links of a world, in cells of ``cell`` metres: always four markers.

    Each marker is a list of shapes, so that a thousand robots are drawn as fast as ten.
    """
    position, goal = _centres(world.x, world.y, cell), _centres(world.goal_x, world.goal_y, cell)
    colours, faint = _colours(len(position), 1.0), _colours(len(position), 0.5)
    away = np.flatnonzero((position != goal).any(axis=1)).tolist()
    pairs = links(world)
    return [
        _shapes(header, "robots", 0, Marker.SPHERE_LIST, (0.7, 0.7, 0.7), cell, position, colours),
        _shapes(header, "goals", 0, Marker.CUBE_LIST, (0.8, 0.8, 0.05), cell, goal, colours),
        _shapes(
            header, "goals", 1, Marker.LINE_LIST, (0.06, 0.0, 0.0), cell,
            np.stack([position[away], goal[away]], axis=1).reshape(-1, 2),
            [faint[robot] for robot in away for _ in range(2)],
        ),
        _shapes(header, "links", 0, Marker.LINE_LIST, (0.03, 0.0, 0.0), cell, position[pairs].reshape(-1, 2)),
    ]  # fmt: skip


def links(world: World) -> IntArray:
    """``[L, 2]`` the pairs of robots in range of each other, the lower number first."""
    position = np.stack([world.x, world.y], axis=1).astype(np.int64)
    heard = neighbours(np.zeros(len(position), dtype=np.int64), position)
    robot, column = np.nonzero(heard > np.arange(len(position))[:, None])
    return np.stack([robot, heard[robot, column]], axis=1)


def transforms(world: World, cell: float, header: Header, prefix: str = "") -> list[TransformStamped]:
    """From the frame of the map to ``ROBOT/base_link`` of each robot, behind ``prefix``; a grid has no headings."""
    result = []
    for name, (x, y) in zip(world.robots, _centres(world.x, world.y, cell).tolist(), strict=True):
        transform = TransformStamped(header=header, child_frame_id=f"{prefix}{name.strip('/')}/base_link")
        transform.transform.translation.x, transform.transform.translation.y = x, y
        result.append(transform)
    return result


def _centres(x: Sequence[int], y: Sequence[int], cell: float) -> FloatArray:
    """``[N, 2]`` centres of cells, metres."""
    return (np.stack([x, y], axis=1) + 0.5) * cell


def _colours(robots: int, alpha: float) -> list[ColorRGBA]:
    """``[robots]`` the colours of the robots, with the opacity ``alpha``."""
    inks = [_colour(ink, alpha) for ink in OKABE_ITO]
    return [inks[robot % len(inks)] for robot in range(robots)]


def _colour(ink: str, alpha: float) -> ColorRGBA:
    red, green, blue = (value / 255 for value in rgb(ink))
    return ColorRGBA(r=red, g=green, b=blue, a=alpha)


def _shapes(
    header: Header,
    namespace: str,
    number: int,
    kind: int,
    scale: tuple[float, float, float],
    cell: float,
    points: FloatArray,
    colours: Sequence[ColorRGBA] = (),
) -> Marker:
    """A marker of many shapes, ``scale`` in cells, on top of the map; without points one that removes itself."""
    marker = Marker(header=header, ns=namespace, id=number, type=kind, action=Marker.ADD)
    if len(points) == 0:  # RViz reports a list without points as an error
        marker.action = Marker.DELETE
        return marker
    marker.scale.x, marker.scale.y, marker.scale.z = (side * cell for side in scale)
    marker.pose.position.z = marker.scale.z / 2
    marker.color = _colour(NEUTRAL, 0.6)
    marker.points = [Point(x=x, y=y) for x, y in points.tolist()]
    marker.colors = list(colours)
    return marker
