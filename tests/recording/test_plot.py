# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pictures of recordings: what is drawn is the episode, the tick and the robot that were asked for."""

import numpy as np
import pytest
from PIL import Image

from magat_cli.main import main
from magat_pictures.animation import save_animation
from magat_pictures.drawn_episode import DrawnEpisode
from magat_recording.attention import episode_links, links
from magat_recording.tables import TeamRecording
from magat_robot.policy.store import save


@pytest.fixture
def bag(simulate, small_policy):
    return simulate(small_policy()).bag


@pytest.fixture
def carried(random_network, tmp_path) -> str:
    """The folder of the policy that the robots of the bag carry."""
    save(random_network(), tmp_path / "policy", "of a test")
    return str(tmp_path / "policy")


def drawn(bag, file, *options: str) -> bytes:
    assert main(["plot", str(bag), "--output", str(file), *options]) == 0
    return file.read_bytes()


def test_attention_at_a_tick_is_that_of_all_ticks(bag, small_policy):
    recording = TeamRecording(bag)
    table = links(recording, small_policy())
    for tick in (0, 4):
        alone = episode_links(recording.all_episodes[1], small_policy(), tick)
        expected = table[(table.episode == 1) & (table.tick == tick)]
        assert len(expected) > 0
        assert alone.to_numpy().tolist() == expected.to_numpy().tolist()


def test_each_tick_robot_and_episode_is_another_picture_and_the_same_again_the_same(bag, carried, tmp_path):
    asked = [
        ["--tick", "3"],
        ["--tick", "4"],
        ["--tick", "4", "--episode", "1"],
        ["--tick", "4", "--robot", "bob"],
        ["--tick", "4", "--robot", "carol"],
    ]
    pictures = [drawn(bag, tmp_path / "one.svg", "--policy", carried, *options) for options in asked]
    assert len(set(pictures)) == len(asked)
    assert drawn(bag, tmp_path / "again.svg", "--policy", carried, *asked[-1]) == pictures[-1]
    assert all(picture.startswith(b"<?xml") for picture in pictures)


def test_without_the_policy_there_is_a_picture_without_attention(bag, carried, tmp_path, capfd):
    with_it = drawn(bag, tmp_path / "one.svg", "--policy", carried, "--tick", "4")
    without = drawn(bag, tmp_path / "two.svg", "--tick", "4")
    assert "Without attention: there is no policy MAGAT-F-16" in " ".join(capfd.readouterr().err.split())
    assert without != with_it


def test_pictures_and_animations_are_what_their_names_say(bag, carried, tmp_path):
    drawn(bag, tmp_path / "one.png", "--policy", carried)
    drawn(bag, tmp_path / "one.gif")
    with Image.open(tmp_path / "one.png") as picture, Image.open(tmp_path / "one.gif") as animation:
        assert (picture.format, animation.format) == ("PNG", "GIF")
        assert animation.n_frames > 12
        assert np.asarray(picture.convert("L")).std() > 5


def test_an_animation_shows_the_attention_of_all_robots_or_of_one(bag, carried, tmp_path):
    asked = [[], ["--policy", carried], ["--policy", carried, "--robot", "bob"]]
    animations = [drawn(bag, tmp_path / "one.gif", *options) for options in asked]
    assert len(set(animations)) == 3


def test_links_of_an_animation_are_as_wide_as_the_attention_at_each_instant(monkeypatch, tmp_path):
    cells = np.array([[[0, 0], [3, 0]]] * 3)
    record = DrawnEpisode(np.zeros((2, 4), bool), cells[0], cells, np.zeros((2, 2), bool), "two that stand")
    stages = {
        "none": [{}, {}, {}],
        "little": [{(0, 1): 0.2}, {(0, 1): 0.2}, {}],
        "much": [{(0, 1): 1.0}, {(0, 1): 1.0}, {}],
        "from the other side": [{(1, 0): 1.0}, {(1, 0): 1.0}, {}],
    }
    ink = {}
    for name, attention in stages.items():
        save_animation(record, tmp_path / "one.gif", attention=attention)
        with Image.open(tmp_path / "one.gif") as animation:
            first = 255 - np.asarray(animation.convert("L")).astype(int)
            middle = first.shape[1] // 2
            ink[name] = first[:, :middle].sum(), first[:, middle:].sum()
    left, right = (np.array([ink[name][side] for name in stages]) - ink["none"][side] for side in (0, 1))
    assert 0 < left[1] < left[2]
    assert right[3] > 0
    # But for the edge in the middle, there is nothing on the other half.
    assert max(right[1], right[2], left[3]) < 0.1 * left[1]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--tick", "99"], "has no tick 99: it has 0 to 12"),
        (["--episode", "2"], "has no episode 2: it has 0 to 1"),
        (["--robot", "zoe"], "has no robot 'zoe': it has alice, bob"),
        (["--output", "plot.txt"], "has an unknown file type: end its name in .svg, .png, .pdf, .gif"),
    ],
)
def test_what_cannot_be_drawn_is_said_in_a_sentence(bag, tmp_path, monkeypatch, capfd, options, said):
    monkeypatch.chdir(tmp_path)
    assert main(["plot", str(bag), *options]) == 1
    assert said in " ".join(capfd.readouterr().err.split())
