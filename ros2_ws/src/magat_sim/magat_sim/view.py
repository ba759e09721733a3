"""The view node: the map, the robots, tf and diagnostics of a team in ROS's common messages, for RViz and the like."""

# mypy: disable-error-code="import-untyped,import-not-found"

import array
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, TransformStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.node import Node
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from magat_interfaces.msg import RobotStatus, World
from magat_node import qos
from magat_node.parameters import declare_count, declare_seconds, declare_value
from magat_node.run import run_node
from magat_sim.grid import IntArray, inside
from magat_sim.radio import neighbours

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # it is no part of the common interfaces, and there is no wheel of it
    TFMessage = None

FloatArray = npt.NDArray[np.float64]

#: Values of an occupancy grid.
FREE, OCCUPIED, UNKNOWN = 0, 100, -1
#: Colours (red, green, blue) that differ to people without red-green vision, too (Okabe and Ito); robot i and its goal
#: have the one of number i, counted around.
COLOURS = [
    (0.902, 0.624, 0.000),
    (0.337, 0.706, 0.914),
    (0.000, 0.620, 0.451),
    (0.941, 0.894, 0.259),
    (0.000, 0.447, 0.698),
    (0.835, 0.369, 0.000),
    (0.800, 0.475, 0.655),
]
#: A process whose status has stopped for so long is stale, seconds. While robots run it comes every 2 s.
STALE_AFTER = 5.0
#: Without a tick for so long, no episode runs, seconds.
IDLE_AFTER = 3.0
#: At most so many robots are named in one line.
NAMED = 10


class ViewNode(Node):
    """Listens, and never speaks to the team: no robot and no simulator notices whether it runs."""

    def __init__(self, **options: object) -> None:
        """Listen to the team of this namespace.

        Raises:
            ValueError: the parameter ``cell_size`` is no length.
        """
        super().__init__("view", **options)
        self._cell = declare_value(self, "cell_size", 1.0, "side of a cell, metres")
        if not 0.0 < self._cell < float("inf"):
            raise ValueError(f"the parameter cell_size is {self._cell}: give the side of a cell in metres, above 0")
        self._frame = declare_value(self, "frame", "map", "tf frame of the map, whose origin is its lower left corner")
        period = declare_seconds(self, "period", 0.1, "draw so often at most, however fast the ticks are")
        team_size = declare_count(self, "team_size", 32, "robots in the team, for the queues of shared topics", 10_000)
        self._world: World | None = None
        self._drawn = True
        self._new_episode = False
        self._health = Health(self.get_fully_qualified_name().lstrip("/"), time.monotonic())

        self._send_map = self.create_publisher(OccupancyGrid, "map", qos.latched(1))
        self._send_markers = self.create_publisher(MarkerArray, "markers", qos.latched(1))
        self._send_diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", qos.reliable(10))
        self._send_tf = None
        if TFMessage is not None:
            self._send_tf = self.create_publisher(TFMessage, "/tf", qos.reliable(100))
        else:
            self.get_logger().info("no tf: the package tf2_msgs is not installed")
        self.create_subscription(World, "world", self._on_world, qos.reliable(100))
        self.create_subscription(
            RobotStatus, "robot_status", self._on_status, qos.reliable(qos.shared_depth(team_size))
        )
        self.create_timer(period, self._on_draw)
        self.create_timer(1.0, self._on_diagnose)

    def _on_world(self, world: World) -> None:
        wrong = fault(world)
        if wrong is not None:
            self.get_logger().warning(f"ignored a world in which {wrong}", throttle_duration_sec=5.0)
            return
        begins = self._world is None or self._world.episode != world.episode
        self._world, self._drawn = world, False
        self._health.ticked(world, time.monotonic())
        if begins:
            self._new_episode = True
            self._send_map.publish(occupancy(world, self._cell, self._header()))

    def _on_status(self, status: RobotStatus) -> None:
        self._health.reported(status, time.monotonic())

    def _on_draw(self) -> None:
        if self._drawn or self._world is None:
            return
        header = self._header()
        drawing = markers(self._world, self._cell, header)
        if self._new_episode:
            drawing.insert(0, Marker(header=header, action=Marker.DELETEALL))
        self._send_markers.publish(MarkerArray(markers=drawing))
        if self._send_tf is not None:
            self._send_tf.publish(TFMessage(transforms=transforms(self._world, self._cell, header)))
        self._drawn, self._new_episode = True, False

    def _on_diagnose(self) -> None:
        report = DiagnosticArray(header=Header(stamp=self._now()))
        report.status = self._health.report(time.monotonic())
        self._send_diagnostics.publish(report)

    def _header(self) -> Header:
        return Header(frame_id=self._frame, stamp=self._now())

    def _now(self) -> Time:
        return self.get_clock().now().to_msg()


# --- Pictures ---


def fault(world: World) -> str | None:
    """What keeps a world from being drawn, as the end of a sentence; or None."""
    robots, cells = len(world.robots), world.width * world.height
    columns = ("x", "y", "goal_x", "goal_y", "wanted", "moved", "silent", "missing", "visited")
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


def occupancy(world: World, cell: float, header: Header) -> OccupancyGrid:
    """The map of a world, in cells of ``cell`` metres; all of it is unknown where the world does not say (tick > 0)."""
    grid = OccupancyGrid(header=header)
    grid.info.map_load_time = header.stamp
    grid.info.resolution = float(cell)
    grid.info.width, grid.info.height = world.width, world.height
    # The pose of the corner of cell (0, 0) stays the frame's own: x to the right, y up, row by row from y = 0, as here.
    values = np.full(world.width * world.height, UNKNOWN)
    if len(world.obstacles) > 0:
        values = np.where(np.asarray(world.obstacles) != 0, OCCUPIED, FREE)
    grid.data = array.array("b", values.astype(np.int8).tobytes())
    return grid


def markers(world: World, cell: float, header: Header) -> list[Marker]:
    """The robots, goals, ways and radio links of a world, in cells of ``cell`` metres: always the same four markers.

    Lists of shapes, not a marker a robot: so a thousand robots are drawn as fast as ten.
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
    """``[L, 2]`` the pairs of robots that hear each other where they stand, the lower number first."""
    position = np.stack([world.x, world.y], axis=1).astype(np.int64)
    heard = neighbours(np.zeros(len(position), dtype=np.int64), position)
    robot, column = np.nonzero(heard > np.arange(len(position))[:, None])
    return np.stack([robot, heard[robot, column]], axis=1)


def transforms(world: World, cell: float, header: Header) -> list[TransformStamped]:
    """From the map's frame to each robot's ``ROBOT/base_link``; robots of a grid have no heading and never turn."""
    result = []
    for name, (x, y) in zip(world.robots, _centres(world.x, world.y, cell).tolist(), strict=True):
        transform = TransformStamped(header=header, child_frame_id=f"{name.strip('/')}/base_link")
        transform.transform.translation.x, transform.transform.translation.y = x, y
        result.append(transform)
    return result


def _centres(x: Sequence[int], y: Sequence[int], cell: float) -> FloatArray:
    """``[N, 2]`` middles of cells, metres."""
    return (np.stack([x, y], axis=1) + 0.5) * cell


def _colours(robots: int, alpha: float) -> list[ColorRGBA]:
    """``[robots]`` the robots' colours, from invisible (``alpha`` 0) to solid (1)."""
    inks = [ColorRGBA(r=red, g=green, b=blue, a=alpha) for red, green, blue in COLOURS]
    return [inks[robot % len(inks)] for robot in range(robots)]


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
    """A marker of many shapes, ``scale`` in cells, standing on the map; one that is removed where there are none."""
    marker = Marker(header=header, ns=namespace, id=number, type=kind, action=Marker.ADD)
    if len(points) == 0:  # RViz takes a list without points for a mistake
        marker.action = Marker.DELETE
        return marker
    marker.scale.x, marker.scale.y, marker.scale.z = (side * cell for side in scale)
    marker.pose.position.z = marker.scale.z / 2
    marker.color = ColorRGBA(r=0.5, g=0.5, b=0.5, a=0.6)
    marker.points = [Point(x=x, y=y) for x, y in points.tolist()]
    marker.colors = list(colours)
    return marker


# --- Diagnostics ---


@dataclass
class _Process:
    """What is known of one process of robots."""

    status: RobotStatus
    #: When its last status came, seconds.
    heard: float
    #: Messages dropped and features missing, as of the last report.
    known: tuple[int, int]
    #: What came to these between the last two reports that had a new status.
    more: tuple[int, int] = (0, 0)
    fresh: bool = False


class Health:
    """Keeps what the team says of itself, and makes diagnostics of it. Times are passed in, seconds."""

    def __init__(self, prefix: str, now: float) -> None:
        """Begin at ``now``; names of diagnostics begin with ``prefix``."""
        self._prefix = prefix
        self._processes: dict[tuple[str, ...], _Process] = {}
        self._world: World | None = None
        self._ticked = self._counted_since = now
        self._ticks = 0

    def reported(self, status: RobotStatus, now: float) -> None:
        """A status came."""
        if not status.robots:
            return  # a mistake, and nobody's
        process = self._processes.get(tuple(status.robots))
        if process is None:
            # What it counted before anybody looked is no news.
            known = (status.messages_dropped, status.features_missing)
            self._processes[tuple(status.robots)] = _Process(status, now, known)
        else:
            process.status, process.heard, process.fresh = status, now, True

    def ticked(self, world: World, now: float) -> None:
        """A world came."""
        self._world, self._ticked = world, now
        self._ticks += world.tick > 0

    def report(self, now: float) -> list[DiagnosticStatus]:
        """The team as a whole, and each process of robots, since the last report."""
        self._forget(now)
        return [
            self._team(now),
            *(self._robots(names, self._processes[names], now) for names in sorted(self._processes)),
        ]

    def _forget(self, now: float) -> None:
        """Drop processes whose robots all run in others now: started anew, in other crews."""
        alive = {name for names, p in self._processes.items() if now - p.heard < STALE_AFTER for name in names}
        self._processes = {
            names: process
            for names, process in self._processes.items()
            if now - process.heard < STALE_AFTER or not alive.issuperset(names)
        }

    def _team(self, now: float) -> DiagnosticStatus:
        status = DiagnosticStatus(name=f"{self._prefix}: team", level=DiagnosticStatus.OK)
        speed = self._ticks / (now - self._counted_since) if now > self._counted_since else 0.0
        self._ticks, self._counted_since = 0, now
        world = self._world
        if world is None:
            status.message = "no episode yet"
            return status
        silent = [name for name, is_silent in zip(world.robots, world.silent, strict=True) if is_silent]
        if now - self._ticked >= IDLE_AFTER:
            status.message = f"no episode: the last tick was {now - self._ticked:.0f} s ago"
        elif silent:
            status.level = DiagnosticStatus.WARN
            status.message = f"{len(silent)} of {len(world.robots)} robots are silent: {_listed(silent)}"
        else:
            status.message = f"{speed:.1f} ticks/s"
        status.values = _values(
            episode=world.episode,
            tick=world.tick,
            ticks_per_second=f"{speed:.1f}",
            robots=len(world.robots),
            visited=sum(world.visited),
            silent=len(silent),
            silent_robots=_listed(silent),
            links=world.links,
        )
        return status

    def _robots(self, names: tuple[str, ...], process: _Process, now: float) -> DiagnosticStatus:
        said = process.status
        if process.fresh:
            counts = (said.messages_dropped, said.features_missing)
            # Counts that fell are those of a process that was started anew.
            process.more = tuple(n - k if n >= k else n for n, k in zip(counts, process.known, strict=True))
            process.known, process.fresh = counts, False
        others = f" and {len(names) - 1} more" if len(names) > 1 else ""
        status = DiagnosticStatus(name=f"{self._prefix}: {names[0]}{others}", hardware_id=names[0])
        silence = now - process.heard
        dropped, missing = process.more
        if silence >= STALE_AFTER:
            status.level, status.message = DiagnosticStatus.STALE, f"no status for {silence:.0f} s"
        elif dropped or missing:
            status.level = DiagnosticStatus.WARN
            status.message = f"{dropped} messages dropped, {missing} features missing since the last report"
        else:
            status.level = DiagnosticStatus.OK
            status.message = "running" if said.state == RobotStatus.RUNNING else "waiting"
        status.values = _values(
            robots=_listed(names),
            state="running" if said.state == RobotStatus.RUNNING else "waiting",
            policy=said.policy,
            digest=said.digest,
            encoding=said.encoding,
            radio=said.radio,
            peers_heard=said.peers_heard,
            ticks=said.ticks,
            features_missing=said.features_missing,
            messages_dropped=said.messages_dropped,
            last_drop=said.last_drop,
        )
        return status


def _listed(names: Sequence[str]) -> str:
    rest = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + rest


def _values(**values: object) -> list[KeyValue]:
    return [KeyValue(key=key, value=str(value)) for key, value in values.items()]


def main(args: list[str] | None = None) -> int:
    """Run the view until it is told to end. Returns the exit status."""
    return run_node("view", ViewNode, args)


if __name__ == "__main__":
    sys.exit(main())
