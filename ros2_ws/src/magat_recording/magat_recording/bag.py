"""Reading, writing and recovering rosbag2 bags: folders with an MCAP file and metadata.yaml.

Messages are written serialised and read decoded. Free of ROS, because the file itself has the message definitions.
"""

import os
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Self

import yaml
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from zstandard import ZstdError

from magat_node.errors import MagatError

METADATA = "metadata.yaml"
SERIALIZATION, DEFINITIONS = "cdr", "ros2msg"
#: Keys of a channel's metadata in rosbag2.
OFFERED_QOS, TYPE_HASH = "offered_qos_profiles", "topic_type_hash"

#: Errors of the MCAP library for files that are cut off or damaged.
_DAMAGE = (McapError, CRCValidationError, ZstdError, struct.error, ValueError, KeyError, EOFError, MemoryError)


class BagError(MagatError, ValueError):
    """A bag that cannot be written or read."""


@dataclass(frozen=True)
class Topic:
    """A topic of a bag."""

    #: Full name.
    name: str
    #: Such as magat_interfaces/msg/World.
    type: str
    #: The message definition, followed by those of the messages in it.
    definition: str
    #: Hash of the definition (REP-2011).
    type_hash: str = ""
    #: Quality of service of its publishers, as YAML.
    qos: str = ""


class BagMessage(NamedTuple):
    """A message of a bag."""

    topic: str
    #: Such as magat_interfaces/msg/World.
    type: str
    #: Times at which it was received and sent, nanoseconds since 1970.
    received: int
    sent: int
    #: Serialised (CDR).
    data: bytes
    #: Decoded: an object with the message's fields.
    message: Any


@dataclass
class BagWriter:
    """Writes a bag, in a ``with`` statement. Flushed messages survive if the process is killed."""

    folder: Path
    _counts: Counter[str] = field(default_factory=Counter)
    _topics: dict[str, Topic] = field(default_factory=dict)
    _schemas: dict[str, int] = field(default_factory=dict)
    _channels: dict[str, int] = field(default_factory=dict)
    _first: int = 0
    _last: int = 0

    def __post_init__(self) -> None:
        """Create the folder.

        Raises:
            BagError: it exists already, or cannot be created.
        """
        try:
            self.folder.mkdir(parents=True)
        except FileExistsError as error:
            raise BagError(f"{self.folder} exists already: remove it, or record to another folder") from error
        except OSError as error:
            raise BagError(f"{self.folder} cannot be created: {error.strerror}") from error
        self._file = (self.folder / f"{self.folder.resolve().name}_0.mcap").open("wb")
        self._writer = Writer(self._file)
        self._writer.start(profile="ros2")
        self._writer.flush()  # so that even an empty bag is a valid MCAP file

    @property
    def messages(self) -> int:
        """Number of messages written."""
        return self._counts.total()

    @property
    def size(self) -> int:
        """Bytes of the file that have been flushed."""
        return os.fstat(self._file.fileno()).st_size

    def add_topic(self, topic: Topic) -> None:
        """Add a topic; needed before its first message."""
        if topic.type not in self._schemas:
            definition = topic.definition.encode()
            self._schemas[topic.type] = self._writer.register_schema(topic.type, DEFINITIONS, definition)
        schema = self._schemas[topic.type]
        metadata = {OFFERED_QOS: topic.qos, TYPE_HASH: topic.type_hash}
        self._channels[topic.name] = self._writer.register_channel(topic.name, SERIALIZATION, schema, metadata)
        self._topics[topic.name] = topic

    def write(self, topic: str, data: bytes, received: int, sent: int) -> None:
        """Add a serialised message of a known topic; times are nanoseconds since 1970."""
        self._counts[topic] += 1
        self._first = min(self._first or received, received)
        self._last = max(self._last, received)
        self._writer.add_message(self._channels[topic], received, data, sent, self._counts[topic])

    def flush(self) -> None:
        """Pass all messages written so far to the operating system."""
        self._writer.flush()

    def close(self) -> None:
        """Write the index and metadata.yaml; safe to call twice."""
        if not self._file.closed:
            self._writer.finish()
            self._file.close()
            (self.folder / METADATA).write_text(yaml.safe_dump(self._metadata(), sort_keys=False))

    def _metadata(self) -> dict[str, Any]:
        """The contents of metadata.yaml, in rosbag2's version of ROS 2 Jazzy."""
        name = Path(self._file.name).name

        def span() -> dict[str, Any]:  # a new object each time, or YAML would write a reference
            return {
                "duration": {"nanoseconds": self._last - self._first},
                "starting_time": {"nanoseconds_since_epoch": self._first},
                "message_count": self.messages,
            }

        topics = [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": SERIALIZATION,
                    "offered_qos_profiles": yaml.safe_load(topic.qos) or [],
                    "type_description_hash": topic.type_hash,
                },
                "message_count": self._counts[topic.name],
            }
            for topic in self._topics.values()
        ]
        return {
            "rosbag2_bagfile_information": {
                "version": 9,
                "storage_identifier": "mcap",
                **span(),
                "topics_with_message_count": topics,
                "compression_format": "",
                "compression_mode": "",
                "relative_file_paths": [name],
                "files": [{"path": name, **span()}],
                "custom_data": None,
                "ros_distro": "jazzy",
            }
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def bag_files(bag: Path) -> list[Path]:
    """The MCAP files of a bag: those of a folder, in their order, or ``bag`` itself if it is a file.

    Raises:
        BagError: there are none.
    """
    files = [bag] if bag.is_file() else sorted(bag.glob("*.mcap"))
    if not files:
        raise BagError(f"{bag} is not a bag: it has no MCAP file" if bag.is_dir() else f"there is no bag {bag}")
    return files


def read_bag(bag: Path) -> Iterator[BagMessage]:
    """The messages of a bag, in the order of their arrival.

    Raises:
        BagError: the bag does not exist, was not closed, or is damaged.
    """
    for path in bag_files(bag):
        with path.open("rb") as file, _as_bag_error(path, bag):
            reader = SeekingReader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            for schema, channel, message, decoded in reader.iter_decoded_messages():
                assert schema is not None  # a message without a schema cannot be decoded
                times = message.log_time, message.publish_time
                yield BagMessage(channel.topic, schema.name, *times, message.data, decoded)


def bag_topics(bag: Path) -> dict[str, str]:
    """The topics of a bag with their types, such as magat_interfaces/msg/World.

    Raises:
        BagError: as `read_bag`.
    """
    found: dict[str, str] = {}
    for path in bag_files(bag):
        with path.open("rb") as file, _as_bag_error(path, bag):
            summary = SeekingReader(file).get_summary()
            assert summary is not None
            found |= {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
    return found


def bag_span(bag: Path) -> tuple[int, int, int]:
    """The number of messages, and the arrival times of the first and the last one (nanoseconds since 1970).

    Raises:
        BagError: as `read_bag`.
    """
    spans = []
    for path in bag_files(bag):
        with path.open("rb") as file, _as_bag_error(path, bag):
            summary = SeekingReader(file).get_summary()
            assert summary is not None and summary.statistics is not None
            found = summary.statistics
            spans.append((found.message_count, found.message_start_time, found.message_end_time))
    counts, starts, ends = zip(*spans, strict=True)
    return sum(counts), min(starts), max(ends)


@contextmanager
def _as_bag_error(path: Path, bag: Path) -> Iterator[None]:
    """Turns errors of the MCAP library into a `BagError`."""
    try:
        if not _finished(path):
            raise BagError(f"{path} was not closed because its recorder was killed: run `magat recover {bag}` first")
        yield
    except BagError:
        raise
    except _DAMAGE as error:
        raise BagError(f"{path} is damaged ({error}): run `magat recover {bag}` to save the rest") from error


def _finished(path: Path) -> bool:
    """Whether the file was closed.

    Raises:
        BagError: it is not an MCAP file.
    """
    magic = b"\x89MCAP0\r\n"
    with path.open("rb") as file:
        if file.read(len(magic)) != magic:
            raise BagError(f"{path} is not an MCAP file")
        file.seek(-len(magic), os.SEEK_END)
        return file.tell() > 0 and file.read() == magic


# --- Recovery ---


def continuation(folder: Path) -> Path:
    """The folder for a recorder that is given ``folder``: FOLDER_2 and so on if a recorder was killed before."""
    chosen, number = folder, 1
    while chosen.is_dir() and any(not _finished(path) for path in chosen.glob("*.mcap")):
        number += 1
        chosen = folder.with_name(f"{folder.name}_{number}")
    return chosen


class Recovered(NamedTuple):
    """The result of `recover`."""

    messages: int
    #: Chunks that could not be read, each of at most a quarter of a second (see `magat_recording.recorder`).
    damaged: int


def recover(bag: Path, into: Path) -> Recovered:
    """Copy all readable messages of a bag to a new one, with index and metadata.yaml.

    Raises:
        BagError: nothing is readable, or ``into`` exists already.
    """
    topics = {path: _topics_of(path) for path in bag_files(bag)}
    if not any(topics.values()):
        raise BagError(f"{bag} has no readable message: it is cut off or damaged before the first one")
    damaged: list[int] = []
    with BagWriter(into) as writer:
        for topic in {topic.name: topic for known in topics.values() for topic in known.values()}.values():
            writer.add_topic(topic)
        for path, known in topics.items():
            for record in _readable(path, damaged):
                if isinstance(record, Message) and record.channel_id in known:
                    writer.write(known[record.channel_id].name, record.data, record.log_time, record.publish_time)
        return Recovered(writer.messages, len(damaged))


def _topics_of(path: Path) -> dict[int, Topic]:
    """The topics of a file by channel. A file that was closed repeats them at its end.

    Raises:
        BagError: it is not an MCAP file.
    """
    _finished(path)
    records = [record for record in _readable(path, []) if isinstance(record, Schema | Channel)]
    schemas = {record.id: record for record in records if isinstance(record, Schema)}
    topics = {}
    for record in records:
        if isinstance(record, Channel) and record.schema_id in schemas:
            schema = schemas[record.schema_id]
            metadata = (record.metadata.get(key, "") for key in (TYPE_HASH, OFFERED_QOS))
            topics[record.id] = Topic(record.topic, schema.name, schema.data.decode(), *metadata)
    return topics


def _readable(path: Path, damaged: list[int]) -> Iterator[McapRecord]:
    """The records of a file, as far as it is readable; appends the times of damaged chunks to ``damaged``."""
    with path.open("rb") as file:
        records = StreamReader(file, emit_chunks=True, record_size_limit=path.stat().st_size).records
        try:
            for record in records:
                if not isinstance(record, Chunk):
                    yield record
                    continue
                try:
                    contents = breakup_chunk(record, validate_crc=True)
                except _DAMAGE:
                    damaged.append(record.message_start_time)
                else:
                    yield from contents
        except _DAMAGE:
            return
