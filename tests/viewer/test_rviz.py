# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The RViz bridge: what RViz, Foxglove and diagnostics tools are shown is what the team said."""

import array
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
import yaml
from ament_index_python.packages import get_package_share_directory
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from hostile import HOSTILE
from nav_msgs.msg import OccupancyGrid
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from magat_bringup.environment import loopback, own_domain
from magat_interfaces.msg import RobotStatus, World
from magat_node import qos
from magat_node.topics import TF
from magat_pictures.colours import OKABE_ITO, rgb
from magat_recording.world_check import fault
from magat_sim.radio import COMMUNICATION_RADIUS
from magat_viewer.rviz.diagnostics import TeamDiagnostics
from magat_viewer.rviz.markers import links, markers, occupancy, transforms
from magat_viewer.rviz.node import RvizBridge

MAP = Header(frame_id="map")
#: Three robots on 12 x 3 cells: two in each other's range, the third alone and on its goal.
THREE = {"x": [0, 2, 11], "y": [0, 1, 2], "goal_x": [4, 0, 11], "goal_y": [2, 2, 2]}


def world(tick: int = 1, episode: int = 1, width: int = 12, height: int = 3, **fields: object) -> World:
    robots = len(fields.get("x", THREE["x"]))
    message = World(episode=episode, tick=tick, width=width, height=height)
    message.robots = [f"robot_{number}" for number in range(robots)]
    message.silent = message.visited = [False] * robots
    message.action = message.moved = message.missing = [0] * robots
    for name, value in (THREE | fields).items():
        setattr(message, name, value)
    return message


def status(*robots: str, **fields: object) -> RobotStatus:
    said = {"state": RobotStatus.RUNNING, "policy": "MAGAT-F-128", "digest": "abc", "encoding": "float16"}
    return RobotStatus(robots=list(robots), **(said | {"radio": "relayed"} | fields))


def points(marker: Marker) -> np.ndarray:
    return np.array([(point.x, point.y) for point in marker.points]).reshape(-1, 2)


def inks(marker: Marker) -> list[tuple[float, ...]]:
    return [tuple(round(value, 3) for value in (ink.r, ink.g, ink.b)) for ink in marker.colors]


# --- The map ---


def test_the_map_has_x_to_the_right_and_y_up():
    obstacles = np.zeros((3, 12), dtype=np.uint8)
    obstacles[1, 4] = 1  # the cell x = 4, y = 1
    grid = occupancy(world(tick=0, obstacles=array.array("B", obstacles.tobytes())), 0.5, MAP)
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (12, 3, 0.5)
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == (0, 0)
    assert grid.info.origin.orientation.w == 1
    assert [index for index, value in enumerate(grid.data) if value == 100] == [1 * 12 + 4]
    assert set(grid.data) == {0, 100}


def test_a_view_that_comes_late_shows_a_map_that_it_does_not_know():
    assert set(occupancy(world(tick=7), 1.0, MAP).data) == {-1}


# --- Robots, goals, links ---


def test_robots_and_goals_are_in_the_middle_of_their_cells_and_of_one_colour():
    robots, goals, ways, _ = markers(world(), 2.0, MAP)
    np.testing.assert_allclose(points(robots), [(1, 1), (5, 3), (23, 5)])
    np.testing.assert_allclose(points(goals), [(9, 5), (1, 5), (23, 5)])
    assert inks(robots) == inks(goals) == [pytest.approx(np.array(rgb(ink)) / 255, abs=1e-3) for ink in OKABE_ITO[:3]]
    # Only who is not there yet has a way to go.
    np.testing.assert_allclose(points(ways), [(1, 1), (9, 5), (5, 3), (1, 5)])
    assert inks(ways) == [inks(robots)[robot] for robot in (0, 0, 1, 1)]
    assert robots.scale.x < 2.0


def test_links_join_those_who_hear_each_other():
    assert links(world()).tolist() == [[0, 1]]
    np.testing.assert_allclose(points(markers(world(), 1.0, MAP)[3]), [(0.5, 0.5), (2.5, 1.5)])
    rng = np.random.default_rng(5)
    x, y = rng.integers(0, 30, (2, 40))
    drawn = {tuple(pair) for pair in links(world(x=x.tolist(), y=y.tolist())).tolist()}
    distance = np.hypot(x[:, None] - x, y[:, None] - y)
    assert drawn == {(i, j) for i in range(40) for j in range(i + 1, 40) if distance[i, j] <= COMMUNICATION_RADIUS}


def test_the_same_markers_come_every_time_and_empty_ones_are_deleted():
    alone = world(x=[3], y=[1], goal_x=[3], goal_y=[1])
    for drawn in (markers(world(), 1.0, MAP), markers(alone, 1.0, MAP)):
        assert [(m.ns, m.id) for m in drawn] == [("robots", 0), ("goals", 0), ("goals", 1), ("links", 0)]
        assert all(m.header.frame_id == "map" and m.pose.orientation.w == 1 for m in drawn)
        assert all(m.color.a > 0 or m.action == Marker.DELETE for m in drawn)
    assert [m.action for m in drawn] == [Marker.ADD, Marker.ADD, Marker.DELETE, Marker.DELETE]


def test_the_colours_differ_with_red_green_colour_blindness():
    # Viénot, Brettel and Mollon (1999): what protanopes and deuteranopes see, in linear RGB.
    protan = [[0.1124, 0.8876, 0.0], [0.1124, 0.8876, 0.0], [0.0040, -0.0040, 1.0]]
    deutan = [[0.2928, 0.7072, 0.0], [0.2928, 0.7072, 0.0], [-0.0223, 0.0223, 1.0]]
    for sight in (np.eye(3), np.array(protan), np.array(deutan)):
        seen = np.clip((np.array([rgb(ink) for ink in OKABE_ITO]) / 255) ** 2.2 @ sight.T, 0, 1) ** (1 / 2.2)
        apart = np.linalg.norm(seen[:, None] - seen, axis=2) + np.eye(len(seen))
        assert apart.min() > 0.1, sight


# --- tf ---


def test_tf_leads_from_the_map_to_each_robot():
    message = world(robots=["alice", "team/bob", "/carol"])
    found = transforms(message, 0.5, MAP)
    assert [(t.header.frame_id, t.child_frame_id) for t in found] == [
        ("map", "alice/base_link"),
        ("map", "team/bob/base_link"),
        ("map", "carol/base_link"),
    ]
    places = [(t.transform.translation.x, t.transform.translation.y, t.transform.rotation.w) for t in found]
    np.testing.assert_allclose(places, [(0.25, 0.25, 1), (1.25, 0.75, 1), (5.75, 1.25, 1)])


# --- What cannot be drawn; how fast the rest is ---


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"x": [], "y": [], "goal_x": [], "goal_y": []}, "0 robots"),
        ({"width": 0}, "0 x 3 cells"),
        ({"goal_y": [1]}, "'goal_y': 1"),
        ({"obstacles": array.array("B", [0] * 35)}, "35 obstacles"),
    ],
)
def test_a_world_that_makes_no_sense_is_named(fields, said):
    assert said in fault(world(**fields))
    assert fault(world()) is None


def test_a_thousand_robots_are_drawn_several_times_a_second():
    rng = np.random.default_rng(1)
    cells = {name: rng.integers(0, 200, 1000).tolist() for name in THREE}
    big = world(width=200, height=200, **cells)
    spent = []
    for _ in range(3):
        started = time.perf_counter()
        drawing = MarkerArray(markers=markers(big, 1.0, MAP))
        size = len(serialize_message(drawing))
        for transform in transforms(big, 1.0, MAP):
            serialize_message(transform)
        spent.append(time.perf_counter() - started)
    print(f"{1e3 * min(spent):.0f} ms, {size / 1024:.0f} KiB of markers")
    assert len(drawing.markers[0].points) == 1000
    assert min(spent) < 0.2


# --- Diagnostics ---


def values(said: DiagnosticStatus) -> dict[str, str]:
    return {pair.key: pair.value for pair in said.values}


def test_a_process_warns_while_it_drops_messages_or_misses_features():
    health = TeamDiagnostics("view", 0.0)
    # What it counted before the bridge started is no news.
    health.reported(status("alice", "bob", messages_dropped=9, features_missing=4), 0.0)
    counts = [(9, 4), (11, 4), (11, 5), (11, 5), (1, 0)]  # and at last it is another process
    levels = []
    for now, (dropped, missing) in enumerate(counts, start=1):
        health.reported(status("alice", "bob", messages_dropped=dropped, features_missing=missing), now)
        _, robots = health.report(now + 0.5)
        levels.append((robots.level, robots.message[:3]))
    ok, warn = DiagnosticStatus.OK, DiagnosticStatus.WARN
    assert levels == [(ok, "run"), (warn, "2 m"), (warn, "0 m"), (ok, "run"), (warn, "1 m")]
    assert robots.name == "view: alice and 1 more"
    assert robots.hardware_id == "alice"
    shown = values(robots)
    assert {key: shown[key] for key in ("policy", "digest", "encoding", "radio", "messages_dropped")} == {
        "policy": "MAGAT-F-128",
        "digest": "abc",
        "encoding": "float16",
        "radio": "relayed",
        "messages_dropped": "1",
    }


def test_a_warning_stays_until_the_next_status():
    health = TeamDiagnostics("view", 0.0)
    health.reported(status("alice"), 0.0)
    health.reported(status("alice", features_missing=3), 2.0)
    assert [health.report(now)[1].level for now in (2.5, 3.5)] == [DiagnosticStatus.WARN] * 2
    health.reported(status("alice", features_missing=3), 4.0)
    assert health.report(4.5)[1].level == DiagnosticStatus.OK


def test_a_process_whose_status_stopped_is_stale_until_others_have_its_robots():
    health = TeamDiagnostics("view", 0.0)
    health.reported(status(), 0.0)  # of nobody
    health.reported(status("alice", "bob"), 0.0)
    health.reported(status("carol"), 9.0)
    levels = {said.name: said.level for said in health.report(10.0)[1:]}
    assert levels == {"view: alice and 1 more": DiagnosticStatus.STALE, "view: carol": DiagnosticStatus.OK}
    health.reported(status("alice"), 10.5)
    assert len(health.report(11.0)) == 4, "bob is still missing"
    health.reported(status("bob"), 11.5)
    assert {said.name for said in health.report(12.0)[1:]} == {"view: alice", "view: bob", "view: carol"}


def test_the_team_reports_its_speed_and_its_silent_robots():
    health = TeamDiagnostics("view", 0.0)
    assert health.report(0.5)[0].message == "no episode yet"
    for tick in range(21):
        health.ticked(world(tick=tick), 1.0 + tick / 20)
    team = health.report(2.5)[0]
    assert (team.name, team.level, values(team)["ticks_per_second"]) == ("view: team", DiagnosticStatus.OK, "10.0")
    health.ticked(world(tick=21, silent=[False, True, False]), 2.6)
    team = health.report(3.0)[0]
    assert team.level == DiagnosticStatus.WARN
    assert team.message == "1 of 3 robots are silent: robot_1"
    team = health.report(9.0)[0]
    assert team.level == DiagnosticStatus.OK
    assert "no episode: the last tick was 6 s ago" in team.message


# --- The node ---


class Viewed:
    """A bridge, and a node that is team and audience at once."""

    def __init__(self, domain: int) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        overrides = [Parameter("cell_size", value=0.5), Parameter("period", value=0.02)]
        self.bridge = RvizBridge(context=self.context, parameter_overrides=overrides)
        self.node = rclpy.create_node("audience", context=self.context)
        self.executor = EventsExecutor(context=self.context)
        self.executor.add_node(self.bridge)
        self.executor.add_node(self.node)
        self.send_world = self.node.create_publisher(World, "world", qos.reliable(100))
        self.send_status = self.node.create_publisher(RobotStatus, "robot_status", qos.reliable(100))

    def listen(self, kind: type, topic: str, durability: QoSDurabilityPolicy = QoSDurabilityPolicy.VOLATILE) -> list:
        heard: list = []
        profile = QoSProfile(depth=100, durability=durability)
        self.node.create_subscription(kind, topic, heard.append, profile)
        self.spin(lambda: self.bridge.count_subscribers(topic) > 0)
        return heard

    def spin(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + 20.0
        while not condition():
            assert time.monotonic() < deadline, "it did not come about in 20 s"
            self.executor.spin_once(timeout_sec=0.02)

    def end(self) -> None:
        for node in (self.bridge, self.node):
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)


@pytest.fixture(scope="module")
def viewed() -> Iterator[Viewed]:
    with own_domain() as number, pytest.MonkeyPatch.context() as patch:
        for name, value in loopback(number).items():
            patch.setenv(name, value)
        running = Viewed(number)
        running.spin(lambda: running.send_world.get_subscription_count() > 0)
        running.spin(lambda: running.send_status.get_subscription_count() > 0)
        yield running
        running.end()


def test_the_node_shows_an_episode_and_clears_the_one_before(viewed):
    drawn = viewed.listen(MarkerArray, "markers")
    # There is no wheel of tf2_msgs: without it the node says so and does all the rest.
    frames = viewed.listen(TF.message, "/tf") if TF.available else None
    for episode in (1, 2):
        viewed.send_world.publish(world(tick=0, episode=episode, obstacles=array.array("B", [1] + [0] * 35)))
        viewed.spin(lambda: drawn)
        viewed.send_world.publish(world(tick=1, episode=episode, x=[1, 2, 11]))
        viewed.spin(lambda: len(drawn) > 1)
        first, second = drawn[0].markers, drawn[1].markers
        assert [first[0].action] + [m.action for m in first[1:]] == [Marker.DELETEALL] + [Marker.ADD] * 4
        assert [m.action for m in second] == [Marker.ADD] * 4
        assert points(second[0])[0].tolist() == [0.75, 0.25]
        drawn.clear()
    if frames is not None:
        viewed.spin(lambda: len(frames) == 4)
        assert frames[-1].transforms[0].child_frame_id == "robot_0/base_link"
        assert frames[-1].transforms[0].transform.translation.x == 0.75
    # Whoever comes now is given the map, too, and the last drawing.
    late_map = viewed.listen(OccupancyGrid, "map", QoSDurabilityPolicy.TRANSIENT_LOCAL)
    late = viewed.listen(MarkerArray, "markers", QoSDurabilityPolicy.TRANSIENT_LOCAL)
    viewed.spin(lambda: late_map and late)
    assert (late_map[0].header.frame_id, late_map[0].info.resolution, late_map[0].data[0]) == ("map", 0.5, 100)
    assert len(late[0].markers) == 4


def test_the_frames_of_a_team_bear_its_namespace_and_are_repeated_while_nothing_moves(monkeypatch):
    """tf2 forgets transforms after 10 s, and who comes late has none."""
    sent: list[SimpleNamespace] = []
    message = SimpleNamespace  # there is no wheel of tf2_msgs
    tf = SimpleNamespace(available=True, message=message, publisher=lambda node: SimpleNamespace(publish=sent.append))
    monkeypatch.setattr("magat_viewer.rviz.node.topics.TF", tf)
    with own_domain() as domain:
        context = Context()
        rclpy.init(args=[], context=context, domain_id=domain)
        try:
            for namespace, given, prefix in (("/hall/red", None, "hall/red/"), ("/", None, ""), ("/red", "r_", "r_")):
                overrides = [Parameter("frame_prefix", value=given)] if given else []
                bridge = RvizBridge(context=context, namespace=namespace, parameter_overrides=overrides)
                assert bridge.get_parameter("frame_prefix").value == prefix
                bridge._on_second()
                assert not sent, "there is no world yet"
                bridge._on_world(world(tick=0, obstacles=array.array("B", bytes(36))))
                bridge._on_draw()
                bridge._on_second()
                assert len(sent) == 1, "something has moved in the last second"
                bridge._on_second()
                bridge._on_second()
                assert len(sent) == 3
                frames = [(said.header.frame_id, said.child_frame_id) for said in sent[-1].transforms]
                assert frames[0] == (f"{prefix}map", f"{prefix}robot_0/base_link")
                first, last = (said.transforms[0].header.stamp for said in (sent[0], sent[-1]))
                assert (last.sec, last.nanosec) > (first.sec, first.nanosec)
                bridge.destroy_node()
                sent.clear()
        finally:
            context.try_shutdown()


def test_the_node_reports_every_second(viewed):
    reports = viewed.listen(DiagnosticArray, "/diagnostics")
    viewed.send_status.publish(status("alice"))
    viewed.spin(lambda: len(reports) == 3)
    assert {said.name for said in reports[-1].status} == {"rviz_bridge: team", "rviz_bridge: alice"}
    stamps = [report.header.stamp.sec + 1e-9 * report.header.stamp.nanosec for report in reports]
    assert 0.7 < (stamps[2] - stamps[0]) / 2 < 2.0


def test_a_world_without_sense_does_not_end_the_node(viewed):
    drawn = viewed.listen(MarkerArray, "markers")
    viewed.send_world.publish(world(tick=5, episode=3, goal_y=[1]))
    viewed.send_world.publish(world(tick=6, episode=3))
    viewed.spin(lambda: drawn)
    assert len(drawn[0].markers) == 5


def test_no_message_of_a_stranger_ends_the_node(viewed, capfd):
    drawn = viewed.listen(MarkerArray, "markers")
    for data in HOSTILE["world"]:
        viewed.send_world.publish(data)
    for data in HOSTILE["robot_status"]:
        viewed.send_status.publish(data)
    viewed.send_world.publish(world(tick=6, episode=4))
    viewed.spin(lambda: drawn)
    assert len(drawn) == 1
    said = capfd.readouterr().err
    assert said.count("[rviz_bridge]: dropped") <= 2
    assert len(said) < 1000
    assert "remaining buffer" not in said


def test_a_cell_needs_a_size(viewed):
    for bad in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="cell_size"):
            RvizBridge(
                context=viewed.context,
                cli_args=["--ros-args", "-r", "__node:=sizeless"],
                parameter_overrides=[Parameter("cell_size", value=bad)],
            )


# --- Layouts: they cannot be opened here, but what they ask for is there ---

CONFIG = Path(get_package_share_directory("magat_bringup")) / "config"
#: What the displays of RViz take.
DISPLAYS = {"Map": "nav_msgs/msg/OccupancyGrid", "MarkerArray": "visualization_msgs/msg/MarkerArray", "TF": None}


def published(viewed: Viewed) -> dict[str, str]:
    found = dict(viewed.node.get_publisher_names_and_types_by_node("rviz_bridge", "/"))
    assert ("/tf" in found) == TF.available
    return {topic: kinds[0] for topic, kinds in found.items()}


def test_rviz_shows_what_is_published(viewed):
    layout = yaml.safe_load((CONFIG / "team.rviz").read_text())["Visualization Manager"]
    assert layout["Global Options"]["Fixed Frame"] == viewed.bridge.get_parameter("frame").value
    topics = published(viewed)
    for display in layout["Displays"]:
        kind = DISPLAYS[display["Class"].removeprefix("rviz_default_plugins/")]
        if kind is None:
            continue
        assert topics[display["Topic"]["Value"]] == kind
        (publisher,) = viewed.node.get_publishers_info_by_topic(display["Topic"]["Value"])
        assert publisher.qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
        assert display["Topic"]["Durability Policy"] == "Transient Local"
    shown = next(display for display in layout["Displays"] if "Namespaces" in display)
    assert shown["Namespaces"].keys() == {marker.ns for marker in markers(world(), 1.0, MAP)}


def test_foxglove_shows_what_is_published(viewed):
    layout = json.loads((CONFIG / "foxglove.json").read_text())

    def panels(part: str | dict) -> set[str]:
        return {part} if isinstance(part, str) else panels(part["first"]) | panels(part["second"])

    panel = layout["configById"]
    assert panels(layout["layout"]) == panel.keys()
    topics = published(viewed)
    assert {topics[topic] for topic in panel["3D!team"]["topics"]} == {kind for kind in DISPLAYS.values() if kind}
    assert topics[panel["DiagnosticSummary!team"]["topicToRender"]] == "diagnostic_msgs/msg/DiagnosticArray"
    assert panel["3D!team"]["followTf"] == viewed.bridge.get_parameter("frame").value
    for path in panel["Plot!ticks"]["paths"]:
        topic, field = path["value"].split(".")
        assert topic == "/world"
        assert field in World.get_fields_and_field_types()
