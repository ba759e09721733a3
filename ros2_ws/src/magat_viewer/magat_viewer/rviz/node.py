"""The node ``view``: a team in ROS's common messages, for RViz and Foxglove: map, robots, tf and diagnostics."""

import sys
import time

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid
from rclpy.node import Node
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from magat_interfaces.msg import RobotStatus, World
from magat_node import qos
from magat_node.parameters import declare_count, declare_seconds, declare_value
from magat_node.run import run_node
from magat_node.topics import TFMessage
from magat_viewer.rviz.diagnostics import TeamDiagnostics
from magat_viewer.rviz.markers import markers, occupancy, transforms
from magat_viewer.world_check import fault


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
        self._health = TeamDiagnostics(self.get_fully_qualified_name().lstrip("/"), time.monotonic())

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


def main(args: list[str] | None = None) -> int:
    """Run the view until it is told to end. Returns the exit status."""
    return run_node("view", ViewNode, args)


if __name__ == "__main__":
    sys.exit(main())
