# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reading and writing rosbag2 bags: folders with an MCAP file and metadata.yaml.

Messages are written serialised and read decoded. Free of ROS, because the file itself has the message definitions.
"""

import os
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Self

import yaml
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import CRCValidationError
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from zstandard import ZstdError

from magat_node.errors import MagatError

METADATA = "metadata.yaml"
SERIALIZATION, DEFINITIONS = "cdr", "ros2msg"
#: Keys of a channel's metadata in rosbag2.
OFFERED_QOS, TYPE_HASH = "offered_qos_profiles", "topic_type_hash"

#: Errors of the MCAP library for files that are cut off or damaged.
DAMAGE = (McapError, CRCValidationError, ZstdError, struct.error, ValueError, KeyError, EOFError, MemoryError)


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
    #: Whether a write failed. Nothing more is written then.
    failed: bool = False

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
        path = self.folder / f"{self.folder.resolve().name}_0.mcap"
        try:
            self._file = path.open("wb")
            self._writer = Writer(self._file)
            self._writer.start(profile="ros2")
            self._writer.flush()  # so that even an empty bag is a valid MCAP file
        except OSError as error:  # nothing may stay that is no bag
            with suppress(OSError):
                self._file.close()
            path.unlink(missing_ok=True)
            self.folder.rmdir()
            raise BagError(f"{self.folder} cannot be created: {error.strerror}") from error

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
        """Add a serialised message of a known topic; times are nanoseconds since 1970.

        Raises:
            BagError: the file cannot be written, e.g. because the disk is full.
        """
        self._counts[topic] += 1
        self._first = min(self._first or received, received)
        self._last = max(self._last, received)
        try:
            self._writer.add_message(self._channels[topic], received, data, sent, self._counts[topic])
        except OSError as error:
            raise self._failure(error) from error

    def flush(self) -> None:
        """Pass all messages written so far to the operating system; errors as of `write`."""
        try:
            self._writer.flush()
        except OSError as error:
            raise self._failure(error) from error

    def close(self) -> None:
        """Write the index and metadata.yaml, unless a write failed; safe to call twice. Errors as of `write`."""
        if self._file.closed:
            return
        if self.failed:
            with suppress(OSError):  # of what is still to be written
                self._file.close()
            return
        try:
            self._writer.finish()
            self._file.close()
            (self.folder / METADATA).write_text(yaml.safe_dump(self._metadata(), sort_keys=False))
        except OSError as error:
            raise self._failure(error) from error

    def _failure(self, error: OSError) -> "BagError":
        self.failed = True
        return BagError(
            f"{self.folder} cannot be written ({error.strerror}): the recording ends after {self.messages} messages. "
            f"`magat recover {self.folder}` saves what is there"
        )

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
    """The messages of a bag, in the order of their arrival; without those that cannot be decoded, see `MessageDecoder`.

    Raises:
        BagError: the bag does not exist, was not closed, or is damaged.
    """
    for path in bag_files(bag):
        decoder = MessageDecoder()
        with path.open("rb") as file, _as_bag_error(path, bag):
            for schema, channel, message in SeekingReader(file, validate_crcs=True).iter_messages():
                assert schema is not None  # a message without a schema cannot be decoded
                decoded = decoder.decode(schema, channel, message)
                if decoded is not None:
                    yield decoded


class MessageDecoder:
    """Decodes the messages of one file. A recorder also stores what strangers sent, of which some is malformed."""

    def __init__(self) -> None:
        """Start without any type."""
        self._factory = DecoderFactory()
        self._decoders: dict[int, Callable[[bytes], Any] | None] = {}

    def decode(self, schema: Schema, channel: Channel, message: Message) -> BagMessage | None:
        """The message; None if it is malformed."""
        if schema.id not in self._decoders:
            self._decoders[schema.id] = self._factory.decoder_for(channel.message_encoding, schema)
        decoder = self._decoders[schema.id]
        if decoder is None:
            raise BagError(f"messages of {schema.name} have the unknown encoding {channel.message_encoding}")
        try:
            decoded = decoder(message.data)
        except Exception:  # the decoder fails in many ways
            return None
        return BagMessage(channel.topic, schema.name, message.log_time, message.publish_time, message.data, decoded)


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
        if not finished(path):
            raise BagError(f"{path} was not closed because its recorder was killed: run `magat recover {bag}` first")
        yield
    except BagError:
        raise
    except DAMAGE as error:
        raise BagError(f"{path} is damaged ({error}): run `magat recover {bag}` to save the rest") from error


def finished(path: Path) -> bool:
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
