# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings whose recorder was killed or could not write, and what strangers sent to recorders."""

import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

import pytest
from hostile import HOSTILE, ONE_ROBOT
from rclpy.serialization import serialize_message

from magat_bringup.environment import loopback, own_domain
from magat_cli.main import main
from magat_interfaces.msg import World
from magat_node.topics import WORLD
from magat_node.visitor import Visitor
from magat_recording.bag import BagError, BagWriter, bag_files, read_bag
from magat_recording.recovery import (
    cut_off,
    describe_recording,
    is_finished,
    pieces,
    read_recording,
    recover,
    topics_of,
)
from magat_recording.tables import TeamRecording


def split(bag: Path, into: int) -> None:
    """Write a bag again as recorders would that were killed ``into`` - 1 times; the last one finished its piece."""
    messages = list(read_bag(bag))
    whole = bag.with_name("whole")
    bag.rename(whole)
    each = -(-len(messages) // into)
    for number in range(into):
        piece = bag if number == 0 else bag.with_name(f"{bag.name}_{number + 1}")
        with BagWriter(whole.with_name("part")) as writer:
            for topic in topics_of(bag_files(whole)[0]).values():
                writer.add_topic(topic)
            for m in messages[number * each : (number + 1) * each]:
                writer.write(m.topic, m.data, m.received, m.sent)
            writer.flush()
            if number < into - 1:
                shutil.copytree(writer.folder, piece)
        if number == into - 1:
            shutil.copytree(writer.folder, piece)
        shutil.rmtree(writer.folder)


@contextmanager
def no_space(size: int) -> Iterator[None]:
    """Files cannot grow beyond ``size`` bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def made(simulate, small_policy):
    return simulate(small_policy(), episodes=2)


def test_the_pieces_of_a_killed_recorder_are_read_as_one(made, capsys):
    expected = TeamRecording(made.bag)
    split(made.bag, 3)
    stub = made.bag.with_name("bag_3")
    assert pieces(made.bag) == [made.bag, made.bag.with_name("bag_2"), stub]
    read = TeamRecording(made.bag)
    assert read.robots.equals(expected.robots)
    assert read.episodes.equals(expected.episodes)
    assert main(["analyze", str(made.bag)]) == 0
    assert main(["recover", str(made.bag)]) == 0
    saved = TeamRecording(made.bag.with_name("bag_recovered"))
    assert saved.robots.equals(expected.robots)
    capsys.readouterr()


def test_the_end_of_a_run_names_the_pieces_that_have_messages(made):
    split(made.bag, 3)
    last = made.bag.with_name("bag_3")
    stub = BagWriter(made.bag.with_name("stub"))
    (bag_files(last)[0]).write_bytes(bag_files(stub.folder)[0].read_bytes())
    (last / "metadata.yaml").unlink()
    assert bag_files(last)[0].stat().st_size < 100
    said = describe_recording(made.bag)
    assert said == [
        "The recorder was killed or failed. The recording is in",
        f"  {made.bag}, not closed",
        f"  {made.bag.with_name('bag_2')}, not closed",
        f"Make one bag of it by `magat recover {made.bag}`, or analyse it by `magat analyze {made.bag}`.",
    ]
    assert not is_finished(made.bag)
    assert recover(made.bag, made.bag.with_name("saved")).messages > 0
    assert describe_recording(stub.folder) == [f"The recording in {stub.folder} is empty."]


def test_a_whole_recording_is_named_as_before(made):
    assert describe_recording(made.bag) == [
        f"The recording is in {made.bag}: analyse it by `magat analyze {made.bag}`."
    ]
    assert is_finished(made.bag)
    (made.bag.with_name("bag_2")).mkdir()  # of another recording
    assert pieces(made.bag) == [made.bag]


def test_what_strangers_sent_does_not_make_a_recording_unreadable(made):
    expected = TeamRecording(made.bag)
    whole = list(read_bag(made.bag))
    first = next(m.received for m in whole)
    with BagWriter(made.bag.with_name("attacked")) as writer:
        for topic in topics_of(bag_files(made.bag)[0]).values():
            writer.add_topic(topic)
        world = next(m.topic for m in whole if m.type.endswith("/World"))
        status = next(m.topic for m in whole if m.type.endswith("/RobotStatus"))
        for data in [*HOSTILE["world"], serialize_message(World(episode=2, robots=["mallory"], **ONE_ROBOT))]:
            writer.write(world, data, first, first)
        for data in HOSTILE["robot_status"]:
            writer.write(status, data, first, first)
        for m in whole:
            writer.write(m.topic, m.data, m.received, m.sent)
    read = TeamRecording(made.bag.with_name("attacked"))
    assert read.names == expected.names
    assert read.policies == expected.policies
    assert read.robots.equals(expected.robots)


def test_a_full_disk_is_an_error_in_one_line_and_what_is_there_is_saved(made, tmp_path):
    whole = list(read_bag(made.bag))
    writer = BagWriter(tmp_path / "full")
    for topic in topics_of(bag_files(made.bag)[0]).values():
        writer.add_topic(topic)

    def record() -> None:
        for number, m in enumerate(whole):
            writer.write(m.topic, m.data, m.received, m.sent)
            if number % 50 == 0:
                writer.flush()

    room = bag_files(made.bag)[0].stat().st_size // 2
    with no_space(room), pytest.raises(BagError, match=r"full cannot be written \(File too large\)"):
        record()
    writer.close()
    assert writer.failed
    assert cut_off(tmp_path / "full")
    assert not is_finished(tmp_path / "full")
    assert recover(tmp_path / "full", tmp_path / "saved").messages > 0
    with no_space(0), pytest.raises(BagError, match="cannot be created: File too large"):
        BagWriter(tmp_path / "none")
    assert not (tmp_path / "none").exists()
    assert len(list(read_recording(tmp_path / "full"))) > 0


def test_a_recorder_on_a_full_disk_ends_with_status_1_and_one_line(tmp_path):
    with own_domain() as domain:
        inherited = {k: v for k, v in os.environ.items() if k != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
        recorder = subprocess.Popen(
            [sys.executable, "-m", "magat_recording.recorder", "--ros-args", "-p", f"bag:={tmp_path / 'bag'}",
             "-p", "robots:=[alice]"],
            env=inherited | loopback(domain),
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)),
        )  # fmt: skip
        with mock.patch.dict(os.environ, loopback(domain)), Visitor("speaker", domain=domain) as visitor:
            world = WORLD.publisher(visitor.node)

            def speak() -> bool:
                world.publish(World(obstacles=os.urandom(1000)))
                return recorder.poll() is not None

            assert visitor.spin(speak, 30.0)
        said = recorder.communicate()[1]
    assert recorder.returncode == 1
    assert "Traceback" not in said
    assert said.count("FATAL") == 1
    assert "cannot be written (File too large): the recording ends after" in said
