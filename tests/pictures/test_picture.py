# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pictures and animations of episodes: they open, have the right size, and show things where they are."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from magat_pictures.animation import save_animation
from magat_pictures.drawn_episode import DrawnEpisode
from magat_pictures.picture import save_picture
from magat_sim.case import draw_case
from magat_sim.simulator import Simulator
from magat_sim.streams import episode_streams

Box = tuple[int, int, int, int]


def walk(width: int, height: int, robots: int, steps: int, seed: int = 5) -> DrawnEpisode:
    """An episode in which all robots go wherever chance takes them."""
    case = draw_case(seed, 0, width, height, robots)
    simulator = Simulator([case], [steps], [episode_streams(seed, 0, robots)])
    rng = np.random.default_rng(seed)
    positions, blocked = [case.starts], []
    while not simulator.done:
        blocked.append(simulator.step(rng.integers(5, size=robots)).blocked)
        positions.append(simulator.position.copy())
    return DrawnEpisode(case.obstacles, case.goals, np.stack(positions), np.stack(blocked), "A walk")


def alone(*path: tuple[int, int], goal: tuple[int, int], side: int = 6) -> DrawnEpisode:
    """One robot on an empty square map."""
    positions = np.array(path, dtype=np.int64)[:, None]
    blocked = np.zeros((len(path) - 1, 1), dtype=bool)
    return DrawnEpisode(np.zeros((side, side), dtype=bool), np.array([goal]), positions, blocked, "Alone")


def with_obstacles(record: DrawnEpisode, *cells: tuple[int, int]) -> DrawnEpisode:
    """The same with obstacles at ``cells``."""
    grid = np.zeros_like(record.obstacles)
    for x, y in cells:
        grid[y, x] = True
    return replace(record, obstacles=grid)


def picture(record: DrawnEpisode, folder: Path) -> np.ndarray:
    """``[height, width, 3]`` the picture."""
    save_picture(record, folder / "episode.png")
    with Image.open(folder / "episode.png") as image:
        assert image.format == "PNG"
        return np.array(image.convert("RGB"))


def frames(
    record: DrawnEpisode, folder: Path, on_frame: Callable[[int, int], None] | None = None
) -> tuple[list[np.ndarray], list[int]]:
    """The frames, ``[height, width, 3]`` each, and their durations in milliseconds."""
    save_animation(record, folder / "episode.gif", on_frame)
    images, durations = [], []
    with Image.open(folder / "episode.gif") as image:
        assert image.format == "GIF"
        for number in range(image.n_frames):
            image.seek(number)
            images.append(np.array(image.convert("RGB")))
            durations.append(image.info["duration"])
    return images, durations


def first_frame(record: DrawnEpisode, folder: Path) -> np.ndarray:
    """The first frame of the animation."""
    return frames(record, folder)[0][0]


def changed(before: np.ndarray, after: np.ndarray) -> Box:
    """Left, top, right and bottom of what differs, in pixels."""
    y, x = np.nonzero((before != after).any(axis=2))
    return int(x.min()), int(y.min()), int(x.max()) + 1, int(y.max()) + 1


def cell_finder(draw: Callable, record: DrawnEpisode, folder: Path) -> Callable[[int, int], tuple[slice, slice]]:
    """Finds the middle third of a cell, knowing no more than that the map is drawn to scale, with y up."""
    height, width = record.obstacles.shape
    corners = ((0, 0), (width - 1, height - 1))
    record = replace(record, positions=record.positions[:1], blocked=record.blocked[:0])
    left, top, right, bottom = changed(
        draw(with_obstacles(record), folder), draw(with_obstacles(record, *corners), folder)
    )

    def middle(x: int, y: int) -> tuple[slice, slice]:
        across, down = (right - left) / width, (bottom - top) / height
        column, row = left + (x + 0.5) * across, bottom - (y + 0.5) * down
        return (
            slice(round(row - down / 6), round(row + down / 6)),
            slice(round(column - across / 6), round(column + across / 6)),
        )

    return middle


def is_coloured(pixels: np.ndarray) -> bool:
    """Most of it is neither white nor grey."""
    return bool(np.median(np.ptp(pixels, axis=-1)) > 80)


@pytest.fixture(scope="module")
def team() -> DrawnEpisode:
    """Ten robots, 8 steps, with moves that were blocked."""
    record = walk(20, 20, 10, 8)
    assert record.blocked.any()
    return record


@pytest.mark.parametrize("draw", [picture, first_frame])
def test_obstacles_are_dark_and_free_cells_light(draw: Callable, tmp_path: Path) -> None:
    record = with_obstacles(alone((1, 4), goal=(4, 1)), (0, 0), (2, 4), (5, 3))
    image, middle = draw(record, tmp_path), cell_finder(draw, record, tmp_path)
    for x, y in ((0, 0), (2, 4), (5, 3)):
        assert image[middle(x, y)].max() < 100
    for x, y in ((5, 5), (4, 2), (2, 1), (0, 5), (3, 5)):
        assert image[middle(x, y)].min() == 255


def test_the_animation_shows_the_robot_where_it_is(tmp_path: Path) -> None:
    record = alone((1, 4), (1, 3), (2, 3), goal=(2, 3))
    images, _ = frames(record, tmp_path)
    middle = cell_finder(first_frame, record, tmp_path)
    for step, (x, y) in enumerate(record.positions[:, 0].tolist()):
        assert is_coloured(images[4 * step][middle(x, y)])
        assert not is_coloured(images[4 * step][middle(4, 1)])
    assert not is_coloured(images[0][middle(2, 3)]), "the goal is hollow until the robot is there"
    assert (images[-1][middle(1, 4)] > 150).all(), "nothing but a trail is left at the start"


def test_the_picture_shows_the_path_from_start_to_goal(tmp_path: Path) -> None:
    record = alone((1, 4), (1, 3), (2, 3), (3, 3), (3, 2), goal=(3, 2))
    image, middle = picture(record, tmp_path), cell_finder(picture, record, tmp_path)
    for x, y in ((1, 3), (2, 3), (3, 3)):
        assert (np.ptp(image[middle(x, y)], axis=-1) > 80).any()
    assert is_coloured(image[middle(3, 2)]), "the goal is solid"
    assert image[middle(1, 4)].max() == 255, "the start is hollow"
    assert not is_coloured(image[middle(1, 4)])
    assert image[middle(4, 1)].min() == 255


def test_a_goal_that_was_missed_is_hollow(tmp_path: Path) -> None:
    record = alone((1, 4), (1, 3), goal=(4, 1))
    image, middle = picture(record, tmp_path), cell_finder(picture, record, tmp_path)
    assert not is_coloured(image[middle(4, 1)])
    assert is_coloured(image[middle(1, 3)])


def test_the_animation_plays_every_step_and_holds_its_end(team: DrawnEpisode, tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    images, durations = frames(team, tmp_path, lambda done, total: calls.append((done, total)))
    assert len(images) == 4 * team.steps + 1
    assert calls == [(done, len(images)) for done in range(1, len(images) + 1)]
    assert durations[-1] >= 1000 > durations[0] > durations[1] == 40
    assert all((before != after).any() for before, after in pairwise(images))


def test_a_blocked_move_shows_as_a_red_ring(tmp_path: Path) -> None:
    calm = alone((1, 4), (1, 4), (1, 4), goal=(4, 1))
    stopped = replace(calm, blocked=np.array([[True], [False]]))
    red = []
    for record in (calm, stopped):
        first = first_frame(record, tmp_path)
        red.append(int(((first[..., 0] > 200) & (first[..., 1:].max(axis=-1) < 80)).sum()))
    assert red[0] == 0 < red[1]


def test_robots_in_range_are_linked(tmp_path: Path) -> None:
    """Seven cells are in range, eight are not; the link crosses the cells between."""
    images = []
    for x in (8, 9):
        cells = np.array([[1, 2], [x, 2]])
        record = DrawnEpisode(np.zeros((5, 10), bool), cells, cells[None], np.zeros((0, 2), bool), "Two")
        for draw in (picture, first_frame):
            middle = cell_finder(draw, record, tmp_path)
            images.append(draw(record, tmp_path)[middle(5, 2)].min() < 255)
    assert images == [True, True, False, False]


def test_the_links_of_any_instant_can_be_drawn(tmp_path: Path) -> None:
    """By default it is the one with most links: here 1, when the robots come as near as seven cells."""
    positions = np.array([[[0, 0], [x, 0]] for x in (8, 7, 8)])
    record = DrawnEpisode(np.zeros((2, 9), bool), positions[0], positions, np.zeros((2, 2), bool), "Near")
    files = []
    for name, instant in (("default", None), ("near", 1), ("apart", 2)):
        save_picture(record, tmp_path / name, links_at=instant)
        files.append((tmp_path / name).read_bytes())
    assert files[0] == files[1]
    assert files[0] != files[2]
    for instant in (-1, 3):
        with pytest.raises(ValueError, match="instants 0 to 2"):
            save_picture(record, tmp_path / "never", links_at=instant)
    assert not (tmp_path / "never").exists()


def test_the_animation_of_a_usual_episode_is_small(tmp_path: Path) -> None:
    record = walk(20, 20, 10, 60)
    save_animation(record, tmp_path / "episode.gif")
    assert (tmp_path / "episode.gif").stat().st_size < 3e6
    with Image.open(tmp_path / "episode.gif") as image:
        assert image.n_frames == 241
        assert max(image.size) <= 720


def test_a_long_episode_gets_no_more_frames(tmp_path: Path) -> None:
    path = [(x, 0) for _ in range(90) for x in (0, 1, 2, 1)]
    record = alone(*path, goal=(2, 2), side=3)
    assert record.steps > 300
    save_animation(record, tmp_path / "episode.gif")
    with Image.open(tmp_path / "episode.gif") as image:
        assert 250 < image.n_frames <= 300


def test_a_robot_that_starts_on_its_goal(tmp_path: Path) -> None:
    record = alone((1, 4), goal=(1, 4))
    assert record.steps == 0
    picture(record, tmp_path)
    images, durations = frames(record, tmp_path)
    assert len(images) == len(durations) == 1
    assert is_coloured(images[0][cell_finder(first_frame, record, tmp_path)(1, 4)])


@pytest.mark.parametrize(("width", "height", "robots", "steps"), [(65, 65, 100, 3), (3, 2, 1, 2), (40, 5, 6, 2)])
def test_any_size(width: int, height: int, robots: int, steps: int, tmp_path: Path) -> None:
    record = walk(width, height, robots, steps)
    high, wide, _ = picture(record, tmp_path).shape
    assert 800 < wide < 2600
    assert 600 < high < 3000
    images, _ = frames(record, tmp_path)
    assert len(images) == 4 * record.steps + 1
    assert {image.shape for image in images} == {images[0].shape}
    assert max(images[0].shape) < 800


@pytest.mark.parametrize(
    ("field", "shape", "message"),
    [
        ("obstacles", (20,), "obstacles have shape"),
        ("obstacles", (0, 20), "obstacles have shape"),
        ("goals", (10, 3), "goals have shape"),
        ("goals", (0, 2), "goals have shape"),
        ("goals", (9, 2), "positions have shape"),
        ("positions", (0, 10, 2), "positions have shape"),
        ("positions", (10, 2), "positions have shape"),
        ("positions", (8, 10, 2), "blocked has shape"),
        ("blocked", (8, 9), "blocked has shape"),
        ("blocked", (9, 10), "blocked has shape"),
        ("obstacles", (5, 5), "goals are outside the map"),
    ],
)
def test_arrays_of_different_episodes_are_refused(
    team: DrawnEpisode, field: str, shape: tuple[int, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        replace(team, **{field: np.zeros(shape, dtype=getattr(team, field).dtype)})


def test_positions_off_the_map_are_refused(team: DrawnEpisode) -> None:
    positions = team.positions.copy()
    positions[3, 2] = (20, 0)
    with pytest.raises(ValueError, match="positions are outside the map"):
        replace(team, positions=positions)
