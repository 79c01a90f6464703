"""Recordings: rosbag2 directories of one MCAP file, written by a thread of their own."""

from __future__ import annotations

import itertools
import queue
import shutil
import struct
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC as MAGIC
from rich.table import Table
from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.rosbag2.errors import ReaderError, WriterError
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, get_typestore
from tt_core.errors import TtError

TYPES = get_typestore(Stores.ROS2_JAZZY)


class BagError(TtError):
    """A directory that cannot be written or is no bag."""


@dataclass(frozen=True, slots=True)
class Summary:
    """What was recorded. counts: messages by topic. duration: s."""

    directory: Path
    counts: dict[str, int]
    duration: float

    def __str__(self) -> str:
        size = sum(path.stat().st_size for path in self.directory.glob("*.mcap"))
        messages = f"{sum(self.counts.values())} messages on {len(self.counts)} topics"
        return f"{self.directory}: {messages} in {self.duration:.1f} s, {size / 1e6:.1f} MB"


class _Topic(NamedTuple):
    name: str
    kind: str
    offered: Sequence[Qos]


class _Sample(NamedTuple):
    topic: str
    time: int
    data: bytes


class Recording:
    """A new bag; its methods may be called from any thread and never wait for the disk.

    Chunks of 1 MB go to the file as they fill, so that a crash costs no more than the last of them.
    Raises BagError if `directory` exists or cannot be made.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = Path(directory)
        self._counts: dict[str, int] = {}
        self._first, self._last = 0, 0
        self._queue: queue.SimpleQueue[_Topic | _Sample | None] = queue.SimpleQueue()
        self._failure: Exception | None = None
        try:
            self._writer = Writer(self.directory, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
        except (WriterError, OSError) as error:
            raise BagError(f"cannot record to {directory}: {error}") from error
        self._thread = threading.Thread(target=self._write, name="bag writer", daemon=True)
        self._thread.start()

    def add_topic(self, name: str, kind: str, offered: Sequence[Qos]) -> None:
        """kind: e.g. "sensor_msgs/msg/Image". offered: of each publisher. Raises BagError for a type that is not ROS 2 Jazzy's."""
        if kind not in TYPES.types:
            raise BagError(f"{name} has the unknown type {kind}")
        self._queue.put(_Topic(name, kind, offered))

    def add(self, topic: str, time: int, data: bytes) -> None:
        """time: ns, when it was received. data: CDR."""
        self._queue.put(_Sample(topic, time, data))

    def close(self) -> Summary:
        """Writes what is queued, the index and the metadata. Raises BagError if anything could not be written."""
        self._queue.put(None)
        self._thread.join()
        if self._failure is not None:
            raise BagError(f"{self.directory} is cut short: {self._failure}") from self._failure
        return Summary(self.directory, self._counts, (self._last - self._first) * 1e-9)

    def _write(self) -> None:
        connections: dict[str, Connection] = {}
        try:
            while (item := self._queue.get()) is not None:
                if isinstance(item, _Topic):
                    made = self._writer.add_connection(item.name, item.kind, typestore=TYPES, offered_qos_profiles=item.offered)
                    connections[item.name], self._counts[item.name] = made, 0
                    continue
                self._writer.write(connections[item.topic], item.time, item.data)
                self._counts[item.topic] += 1
                self._first, self._last = min(self._first or item.time, item.time), max(self._last, item.time)
            self._writer.close()
        except (OSError, WriterError) as error:
            self._failure = error
            with suppress(OSError):
                self._writer.abort()


def open_bag(directory: Path) -> Reader:
    """An opened reader, to be closed by the caller (`with contextlib.closing(...)`). Raises BagError."""
    try:
        reader = Reader(directory)
        reader.open()
    except (ReaderError, OSError) as error:
        raise BagError(f"{directory} is no whole bag ({error}); if its recorder was killed: ros2 bag reindex {directory}") from error
    return reader


def describe(directory: Path) -> Table:
    """What a bag holds, for people."""
    reader = open_bag(directory)
    table = Table("topic", "type", "messages", "Hz", box=None)
    seconds = reader.duration * 1e-9
    for connection in sorted(reader.connections, key=lambda c: c.topic):
        hertz = f"{connection.msgcount / seconds:.1f}" if seconds > 0.0 else ""
        table.add_row(connection.topic, connection.msgtype, str(connection.msgcount), hertz)
    counts = {connection.topic: connection.msgcount for connection in reader.connections}
    table.title, table.title_justify = str(Summary(Path(directory), counts, seconds)), "left"
    reader.close()
    return table


def reindex(directory: Path) -> Summary:
    """Rewrites a bag whose recorder was killed, up to the last whole chunk. Raises BagError if there is nothing to save."""
    directory = Path(directory)
    files = sorted(directory.glob("*.mcap"))
    if not files:
        raise BagError(f"{directory} holds no MCAP file")
    work = directory / ".reindex"
    shutil.rmtree(work, ignore_errors=True)
    recording = Recording(work / directory.absolute().name)
    try:
        for file in files:
            _copy(file, recording)
    finally:
        summary = recording.close()
    if not any(summary.counts.values()):
        shutil.rmtree(work)
        raise BagError(f"{directory} holds no whole chunk")
    for file in files:
        file.unlink()
    for file in recording.directory.iterdir():
        file.replace(directory / file.name)
    shutil.rmtree(work)
    return Summary(directory, summary.counts, summary.duration)


def _whole_chunks(file: Path) -> Iterator[Chunk]:
    """The chunks that are whole, in the order of the file (https://mcap.dev/spec: opcode, length, content)."""
    size, position = file.stat().st_size, len(MAGIC)
    with file.open("rb") as stream:
        while position + 9 <= size:
            stream.seek(position)
            opcode, length = struct.unpack("<BQ", stream.read(9))
            position += 9 + length
            if opcode == Opcode.CHUNK and position <= size:
                yield Chunk.read(ReadDataStream(stream))


def _copy(file: Path, recording: Recording) -> None:
    schemas: dict[int, Schema] = {}
    topics: dict[int, str] = {}
    for record in itertools.chain.from_iterable(map(breakup_chunk, _whole_chunks(file))):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in topics:
            topics[record.id], offered = record.topic, parse_qos(record.metadata.get("offered_qos_profiles", ""))
            recording.add_topic(record.topic, schemas[record.schema_id].name, offered)
        elif isinstance(record, Message):
            recording.add(topics[record.channel_id], record.log_time, record.data)
