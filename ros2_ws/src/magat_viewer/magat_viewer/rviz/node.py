# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The RViz bridge: a node that shows a team in ROS's standard messages: map, markers, tf and diagnostics."""

import sys
import time

from magat_node.imports import quiet_imports

with quiet_imports():
    from builtin_interfaces.msg import Time
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.node import Node
    from std_msgs.msg import Header
    from visualization_msgs.msg import Marker, MarkerArray

    from magat_interfaces.msg import RobotStatus, World
    from magat_node import topics
    from magat_node.errors import UnusableMessageError
    from magat_node.parameters import declare_count, declare_seconds, declare_value
    from magat_node.run import run_node
    from magat_node.status_check import status_fault
    from magat_recording.world_check import fault
    from magat_viewer.rviz.diagnostics import TeamDiagnostics
    from magat_viewer.rviz.markers import markers, occupancy, transforms


class RvizBridge(Node):
    """Subscribes to the world and the robots' statuses, and publishes for RViz and Foxglove only."""

    def __init__(self, **options: object) -> None:
        """Subscribe to the team of this namespace.

        Raises:
            ValueError: the parameter ``cell_size`` is not above 0.
        """
        super().__init__("rviz_bridge", **options)
        self._cell = declare_value(self, "cell_size", 1.0, "side of a cell, metres")
        if not 0.0 < self._cell < float("inf"):
            raise ValueError(f"the parameter cell_size is {self._cell}: give the side of a cell in metres, above 0")
        frame = declare_value(self, "frame", "map", "tf frame of the map, whose origin is its lower left corner")
        team = self.get_namespace().strip("/")
        self._prefix = declare_value(
            self,
            "frame_prefix",
            f"{team}/" if team else "",
            "of all tf frames, so that those of several teams differ; the namespace if it is not given",
        )
        self._frame = f"{self._prefix}{frame}"
        period = declare_seconds(self, "period", 0.1, "shortest time between two drawings")
        team_size = declare_count(self, "team_size", 32, "robots in the team, for the queues of shared topics", 10_000)
        self._world: World | None = None
        self._drawn = True
        self._still = True
        self._new_episode = False
        self._health = TeamDiagnostics(self.get_fully_qualified_name().lstrip("/"), time.monotonic())

        self._send_map = topics.MAP.publisher(self)
        self._send_markers = topics.MARKERS.publisher(self)
        self._send_diagnostics = topics.DIAGNOSTICS.publisher(self)
        self._send_tf = topics.TF.publisher(self) if topics.TF.available else None
        if self._send_tf is None:
            self.get_logger().info("no tf: the package tf2_msgs is not installed")
        topics.WORLD.subscription(self, self._on_world)
        topics.ROBOT_STATUS.subscription(self, self._on_status, robots=team_size)
        self.create_timer(period, self._on_draw)
        self.create_timer(1.0, self._on_diagnose)
        self.create_timer(1.0, self._on_second)

    def _on_world(self, world: World) -> None:
        wrong = fault(world)
        if wrong is not None:
            raise UnusableMessageError(f"a world in which {wrong}")
        begins = self._world is None or self._world.episode != world.episode
        self._world, self._drawn = world, False
        self._health.ticked(world, time.monotonic())
        if begins:
            self._new_episode = True
            self._send_map.publish(occupancy(world, self._cell, self._header()))

    def _on_status(self, status: RobotStatus) -> None:
        wrong = status_fault(status)
        if wrong is not None:
            raise UnusableMessageError(f"a status in which {wrong}")
        self._health.reported(status, time.monotonic())

    def _on_draw(self) -> None:
        if self._drawn or self._world is None:
            return
        header = self._header()
        drawing = markers(self._world, self._cell, header)
        if self._new_episode:
            drawing.insert(0, Marker(header=header, action=Marker.DELETEALL))
        self._send_markers.publish(MarkerArray(markers=drawing))
        self._send_transforms(self._world, header)
        self._drawn, self._new_episode = True, False

    def _on_second(self) -> None:
        """Repeat the transforms while nothing moves: tf forgets them, and late listeners have none."""
        if self._still and self._world is not None:
            self._send_transforms(self._world, self._header())
        self._still = True

    def _send_transforms(self, world: World, header: Header) -> None:
        self._still = False
        if self._send_tf is not None:
            message = topics.TF.message(transforms=transforms(world, self._cell, header, self._prefix))
            self._send_tf.publish(message)

    def _on_diagnose(self) -> None:
        report = DiagnosticArray(header=Header(stamp=self._now()))
        report.status = self._health.report(time.monotonic())
        self._send_diagnostics.publish(report)

    def _header(self) -> Header:
        return Header(frame_id=self._frame, stamp=self._now())

    def _now(self) -> Time:
        return self.get_clock().now().to_msg()


def main(args: list[str] | None = None) -> int:
    """Run the bridge until it is told to end. Returns the exit status."""
    return run_node("rviz_bridge", RvizBridge, args)


if __name__ == "__main__":
    sys.exit(main())
