# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings whose recorder was killed: bags without an index, and the folders in which a recorder went on.

A recorder that is started again with the same folder writes to FOLDER_2, and so on. These are the pieces of one
recording. Free of ROS.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from magat_recording.bag import (
    DAMAGE,
    OFFERED_QOS,
    TYPE_HASH,
    BagError,
    BagMessage,
    BagWriter,
    MessageDecoder,
    Topic,
    bag_files,
    finished,
    read_bag,
)

#: Bytes of the shortest MCAP file: what it begins with.
_SHORTEST = 8


def pieces(bag: Path) -> list[Path]:
    """The folders of the recording that began in ``bag``: a piece follows one that was not closed."""
    found = [bag]
    while bag.is_dir() and cut_off(found[-1]) and (following := _numbered(bag, len(found) + 1)).is_dir():
        found.append(following)
    return found


def continuation(folder: Path) -> Path:
    """The folder for a recorder that is given ``folder``: FOLDER_2 and so on if a recorder was killed before."""
    last = pieces(folder)[-1]
    return _numbered(folder, len(pieces(folder)) + 1) if last.is_dir() and cut_off(last) else last


def cut_off(bag: Path) -> bool:
    """Whether a file of the bag was not closed.

    Raises:
        BagError: a file is not an MCAP file.
    """
    files = [bag] if bag.is_file() else bag.glob("*.mcap")
    return any(path.stat().st_size < _SHORTEST or not finished(path) for path in files)


def has_messages(bag: Path) -> bool:
    """Whether a message can be read in the bag."""
    files = [bag] if bag.is_file() else bag.glob("*.mcap")
    return any(isinstance(record, Message) for path in files for record in _readable(path, []))


def is_finished(bag: Path) -> bool:
    """Whether the recording that began in ``bag`` was recorded to its end: its last piece was closed."""
    last = pieces(bag)[-1]
    return last.is_dir() and not cut_off(last)


def describe_recording(bag: Path) -> list[str]:
    """Lines that say where the recording that began in ``bag`` is, and what can be done with it."""
    kept = [part for part in pieces(bag) if has_messages(part)]
    if not kept:
        return [f"The recording in {bag} is empty."]
    analyse = f"analyse it by `magat analyze {bag}`"
    if len(kept) == 1 and not cut_off(kept[0]) and kept[0] == bag:
        return [f"The recording is in {bag}: {analyse}."]
    rows = [f"  {part}{', not closed' if cut_off(part) else ''}" for part in kept]
    return [
        "The recorder was killed or failed. The recording is in",
        *rows,
        f"Make one bag of it by `magat recover {bag}`, or {analyse}.",
    ]


def _numbered(folder: Path, number: int) -> Path:
    return folder.with_name(f"{folder.name}_{number}")


def read_recording(bag: Path) -> Iterator[BagMessage]:
    """As `read_bag`, of all pieces of a recording: those that were not closed are read as far as they go.

    Raises:
        BagError: the bag does not exist, is not an MCAP file, or was closed and is damaged.
    """
    parts = pieces(bag)
    if len(parts) == 1 and not cut_off(bag):
        yield from read_bag(bag)
        return
    for part in parts:
        if cut_off(part):
            # Without an index, in the order in which they were written, which is not quite that of their arrival.
            yield from sorted(_decoded(part), key=lambda message: message.received)
        else:
            yield from read_bag(part)


def _decoded(bag: Path) -> Iterator[BagMessage]:
    for path in bag_files(bag):
        decoder = MessageDecoder()
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        for record in _readable(path, []):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message) and record.channel_id in channels:
                channel = channels[record.channel_id]
                message = decoder.decode(schemas[channel.schema_id], channel, record)
                if message is not None:
                    yield message


class Recovered(NamedTuple):
    """The result of `recover`."""

    messages: int
    #: Chunks that could not be read, each of at most a quarter of a second (see `magat_recording.recorder`).
    damaged: int


def recover(bag: Path, into: Path) -> Recovered:
    """Copy all readable messages of a recording, of all its `pieces`, to a new bag with index and metadata.yaml.

    Raises:
        BagError: nothing is readable, or ``into`` exists already.
    """
    parts = pieces(bag)
    files = [path for part in parts for path in bag_files(part)]
    if len(parts) > 1:
        files = [path for path in files if path.stat().st_size >= _SHORTEST]
    topics = {path: topics_of(path) for path in files}
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


def topics_of(path: Path) -> dict[int, Topic]:
    """The topics of a file by channel. A file that was closed repeats them at its end.

    Raises:
        BagError: it is not an MCAP file.
    """
    finished(path)
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
                except DAMAGE:
                    damaged.append(record.message_start_time)
                else:
                    yield from contents
        except DAMAGE:
            return
