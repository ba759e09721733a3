# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags: what is written is read again, by other libraries too; what was cut off or damaged says so, and is saved."""

import random
import re
import struct
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from visualization_msgs.msg import Marker, MarkerArray

from magat_interfaces.msg import Feature, Preference
from magat_node import qos
from magat_node.topics import TeamTopic, team_topics
from magat_recording.bag import BagError, BagWriter, bag_span, bag_topics, read_bag
from magat_recording.definitions import described
from magat_recording.recovery import continuation, recover

SECOND = 10**9
TOPICS = [TeamTopic("feature", Feature, qos.newest(4)), TeamTopic("markers", MarkerArray, qos.latched(1))]


def payload(tick: int) -> bytes:
    """What no compression makes shorter."""
    return random.Random(tick).randbytes(200)


def write(folder: Path, chunks: int = 5, per_chunk: int = 20) -> BagWriter:
    """A bag of features, in chunks, and markers, a message of which holds messages."""
    writer = BagWriter(folder)
    for topic in TOPICS:
        writer.add_topic(described(topic, f"/{topic.name}"))
    for chunk in range(chunks):
        for number in range(per_chunk):
            tick = chunk * per_chunk + number
            feature = Feature(episode=7, tick=tick, tag=2**63 + tick, payload=payload(tick))
            writer.write("/feature", serialize_message(feature), SECOND + 2 * tick, SECOND + tick)
        marker = Marker(ns=f"chunk {chunk}", id=chunk)
        marker.header.frame_id = "map"
        drawing = serialize_message(MarkerArray(markers=[marker]))
        writer.write("/markers", drawing, SECOND + 2 * (chunk * per_chunk) + 1, SECOND)
        writer.flush()
    return writer


@pytest.fixture
def bag(tmp_path) -> Path:
    write(tmp_path / "bag").close()
    return tmp_path / "bag"


def file_of(bag: Path) -> Path:
    return bag / f"{bag.name}_0.mcap"


def ticks_of(bag: Path) -> list[int]:
    return [m.message.tick for m in read_bag(bag) if m.topic == "/feature"]


def test_what_is_written_is_read_in_the_order_in_which_it_was_received(bag):
    messages = list(read_bag(bag))
    assert ticks_of(bag) == list(range(100))
    assert [m.received for m in messages] == sorted(m.received for m in messages)
    feature, drawing, other = messages[0], messages[1], messages[2]
    assert (feature.type, feature.received, feature.sent) == ("magat_interfaces/msg/Feature", SECOND, SECOND)
    assert (feature.message.tag, feature.message.payload) == (2**63, payload(0))
    assert drawing.message.markers[0].header.frame_id == "map"
    assert (other.received, other.sent) == (SECOND + 2, SECOND + 1)
    assert bag_span(bag) == (105, SECOND, SECOND + 198)
    assert bag_topics(bag) == {
        "/feature": "magat_interfaces/msg/Feature",
        "/markers": "visualization_msgs/msg/MarkerArray",
    }


def test_other_libraries_read_the_same(bag):
    with AnyReader([bag]) as reader:
        assert reader.message_count == 105
        assert {c.topic: c.msgcount for c in reader.connections} == {"/feature": 100, "/markers": 5}
        read = [(c.topic, time, reader.deserialize(data, c.msgtype)) for c, time, data in reader.messages()]
        profiles = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    assert [message.tick for topic, _, message in read if topic == "/feature"] == list(range(100))
    assert [message.markers[0].ns for topic, _, message in read if topic == "/markers"] == [
        f"chunk {chunk}" for chunk in range(5)
    ]
    assert [profiles["/feature"].depth, profiles["/markers"].depth] == [4, 1]
    assert profiles["/feature"].reliability.name == "BEST_EFFORT"
    assert profiles["/markers"].durability.name == "TRANSIENT_LOCAL"
    with file_of(bag).open("rb") as file:
        decoded = list(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    assert len(decoded) == 105


def test_the_metadata_are_those_of_rosbag2(bag):
    said = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert "&" not in (bag / "metadata.yaml").read_text(), "no references, which few readers of YAML know"
    assert said["storage_identifier"] == "mcap"
    assert said["relative_file_paths"] == ["bag_0.mcap"] == [entry["path"] for entry in said["files"]]
    assert (said["message_count"], said["duration"]) == (105, {"nanoseconds": 198})
    assert said["starting_time"] == {"nanoseconds_since_epoch": SECOND}
    by_name = {t["topic_metadata"]["name"]: t for t in said["topics_with_message_count"]}
    assert by_name["/markers"]["message_count"] == 5
    for topic in by_name.values():
        assert re.fullmatch("RIHS01_[0-9a-f]{64}", topic["topic_metadata"]["type_description_hash"])


def test_every_topic_of_a_team_has_a_definition_from_which_its_messages_are_decoded(tmp_path):
    topics = team_topics(["alice"], relayed=True)
    with BagWriter(tmp_path / "bag") as writer:
        for topic in topics:
            name = topic.name if topic.name.startswith("/") else f"/{topic.name}"
            writer.add_topic(described(topic, name))
            writer.write(name, serialize_message(topic.kind()), SECOND, SECOND)
    for message in read_bag(tmp_path / "bag"):
        kind = next(topic.kind for topic in topics if topic.name.lstrip("/") == message.topic.lstrip("/"))
        assert set(kind.get_fields_and_field_types()) == set(type(message.message).__slots__)


def test_a_bag_is_never_written_over(bag, tmp_path):
    with pytest.raises(BagError, match=r"bag exists already: remove it"):
        BagWriter(bag)
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match="cannot be created"):
        BagWriter(tmp_path / "file" / "bag")


def test_a_bag_whose_writer_was_killed_says_so_and_is_finished(tmp_path):
    writer = write(tmp_path / "bag")
    lost = serialize_message(Feature(tick=100))
    writer.write("/feature", lost, SECOND + 500, SECOND)  # and never flushed
    with pytest.raises(BagError, match=r"was not closed.*run `magat recover .*bag` first"):
        list(read_bag(tmp_path / "bag"))
    assert recover(tmp_path / "bag", tmp_path / "saved") == (105, 0)
    assert ticks_of(tmp_path / "saved") == list(range(100))
    with AnyReader([tmp_path / "saved"]) as reader:
        assert reader.message_count == 105
    original = next(m for m in read_bag(tmp_path / "saved") if m.message and m.topic == "/markers")
    assert original.received == SECOND + 1
    assert "transient_local" in (tmp_path / "saved" / "metadata.yaml").read_text()


@pytest.mark.parametrize("share", [0.3, 0.45, 0.6])
def test_of_a_file_that_was_cut_all_up_to_there_is_saved(bag, tmp_path, share):
    whole = file_of(bag).read_bytes()
    file_of(bag).write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(BagError, match="was not closed"):
        list(read_bag(bag))
    saved = recover(bag, tmp_path / "saved")
    ticks = ticks_of(tmp_path / "saved")
    assert ticks == list(range(len(ticks)))
    assert 0 < len(ticks) < 100
    assert len(ticks) % 20 == 0
    assert saved.damaged == 0


def test_damage_is_found_and_all_chunks_but_the_damaged_one_are_saved(bag, tmp_path):
    whole = bytearray(file_of(bag).read_bytes())
    frame = struct.pack("<I", 0xFD2FB528)  # where zstd's compressed data begin
    places = [match.start() for match in re.finditer(re.escape(frame), whole)]
    assert len(places) == 5
    for place in (places[0], places[2]):
        whole[place + 60] ^= 0xFF
    file_of(bag).write_bytes(whole)
    with pytest.raises(BagError, match=r"is damaged .*run `magat recover"):
        list(read_bag(bag))
    # The first chunk is the one that says what the topics are; a finished file says it again at its end.
    assert recover(bag, tmp_path / "saved") == (63, 2)
    assert ticks_of(tmp_path / "saved") == [*range(20, 40), *range(60, 100)]


@pytest.mark.parametrize(
    ("contents", "said"),
    [
        (b"", "is not an MCAP file"),
        (b"no MCAP file at all", "is not an MCAP file"),
        (None, "it has no MCAP file"),
    ],
    ids=["empty", "of another kind", "an empty folder"],
)
def test_what_is_no_bag_is_named(tmp_path, contents, said):
    folder = tmp_path / "bag"
    folder.mkdir()
    if contents is not None:
        (folder / "bag_0.mcap").write_bytes(contents)
    for read in (lambda: list(read_bag(folder)), lambda: recover(folder, tmp_path / "saved"), lambda: bag_span(folder)):
        with pytest.raises(BagError, match=said) as error:
            read()
        assert str(folder) in str(error.value)
    with pytest.raises(BagError, match=r"there is no bag .*nowhere"):
        list(read_bag(tmp_path / "nowhere"))
    assert not (tmp_path / "saved").exists()


def test_a_recorder_that_was_killed_goes_on_in_another_folder(bag, tmp_path):
    assert continuation(tmp_path / "new") == tmp_path / "new"
    assert continuation(bag) == bag, "it is finished: to write over it is refused"
    write(tmp_path / "cut")
    assert continuation(tmp_path / "cut") == tmp_path / "cut_2"
    write(tmp_path / "cut_2")
    assert continuation(tmp_path / "cut") == tmp_path / "cut_3"


def test_a_beginning_of_which_nothing_can_be_read_is_named(tmp_path):
    writer = BagWriter(tmp_path / "bag")
    writer.add_topic(described(TeamTopic("preference", Preference, qos.newest(4)), "/preference"))
    writer.flush()
    with pytest.raises(BagError, match="before the first one"):
        recover(tmp_path / "bag", tmp_path / "saved")
