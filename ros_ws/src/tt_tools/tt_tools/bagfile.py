"""Write a rosbag2 directory of MCAP files that can be closed even when the disk has become full."""

from __future__ import annotations

import errno
import io
import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from mcap.writer import CompressionType, Writer
from rosbags.interfaces import Qos
from rosbags.rosbag2.metadata import dump_qos_v9
from rosbags.typesys.store import Typestore
from tt_core.ros.bags import TYPESTORE, BagError

RESERVE = 64 * 2**20  # bytes of the disk that stay free
ALLOCATED_AHEAD = 16 * 2**20  # bytes that are allocated for the file in advance
# A crash loses the chunk that is not full yet; each chunk takes 3.5 kB of memory until the end. So chunks grow with the file.
CHUNK, LARGEST_CHUNK, CHUNK_SHARE = 2**20, 6 * 2**20, 1 / 32  # bytes of messages in a chunk: least, most, and as a share of the file
PER_MESSAGE, PER_CHUNK, PER_CHUNK_AND_TOPIC = 64, 256, 32  # upper bounds of the bytes in the file beside the data
PER_BAG, PER_TOPIC, PER_PUBLISHER = 2**16, 4096, 4096  # upper bounds of the bytes in channels, index and metadata
COMPRESSIONS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
VERSION = 9  # format version of metadata.yaml, as rosbag2 of ROS 2 Jazzy writes it


@dataclass(frozen=True, slots=True)
class Summary:
    """Summary of a bag that has been closed: what it holds, and which messages were lost.

    Attributes:
        directory: Path of the bag.
        counts: Number of messages in the bag, by topic.
        duration: Time from the first to the last message, s.
        size: Size of its files, bytes.
        dropped: Number of messages, by topic, that were not written because the disk was full or slow.
        missed: Number of messages, by topic, that the middleware reported as lost before they arrived.
    """

    directory: Path
    counts: Mapping[str, int]
    duration: float
    size: int
    dropped: Mapping[str, int] = field(default_factory=dict)
    missed: Mapping[str, int] = field(default_factory=dict)

    def __str__(self) -> str:
        messages = f"{sum(self.counts.values())} messages on {len(self.counts)} topics"
        text = f"{self.directory}: {messages} in {self.duration:.1f} s, {self.size / 1e6:.1f} MB"
        for cause, losses in (("dropped because the disk was full or slow", self.dropped), ("lost by the middleware", self.missed)):
            if losses:
                text += f"; {cause}: {', '.join(f'{count} of {topic}' for topic, count in sorted(losses.items()))}"
        return text


class _File(io.BufferedWriter):
    """File whose disk space is allocated before it is written, and which is cut to its content when it is closed.

    Attributes:
        free: Bytes that were free on the disk at the last allocation.
        position: Bytes written so far.
    """

    def __init__(self, path: Path, reserve: int) -> None:
        super().__init__(io.FileIO(path, "x"))
        self._reserve, self._allocated, self.free, self.position = reserve, 0, 0, 0

    def write(self, data: Any, /) -> int:
        self.position += len(data)
        return super().write(data)

    def allocate(self, size: int) -> None:
        """Allocate at least `size` bytes for the file. Raises OSError if less than the reserve would stay free on the disk."""
        if size > self._allocated:
            try:
                self._extend(size + ALLOCATED_AHEAD)
            except OSError:
                self._extend(size)

    def _extend(self, size: int) -> None:
        disk = os.fstatvfs(self.fileno())
        self.free = disk.f_bavail * disk.f_frsize
        if self.free - (size - self._allocated) < self._reserve:
            raise OSError(errno.ENOSPC, f"less than {self._reserve} bytes would stay free")
        os.posix_fallocate(self.fileno(), 0, size)
        self._allocated = size

    def close(self) -> None:
        if not self.closed:
            self.truncate()
        super().close()


class _Topic(NamedTuple):
    """What MCAP and metadata.yaml store about a topic."""

    name: str
    kind: str
    definition: bytes
    hash: str
    offered: tuple[Qos, ...]


@dataclass
class _Part:
    """One file of a bag. first, last: time of its first and last message, ns; 0 without messages."""

    path: Path
    file: _File
    writer: Writer
    channels: dict[str, int] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    first: int = 0
    last: int = 0
    pending: int = 0  # upper bound of the bytes of the chunk that is not written yet
    chunks: int = 0

    def information(self) -> dict[str, Any]:
        """Return the entry of metadata.yaml about the file."""
        return {"path": self.path.name, **_span(self.first, self.last), "message_count": self.counts.total()}


def _span(first: int, last: int) -> dict[str, Any]:
    return {"starting_time": {"nanoseconds_since_epoch": first}, "duration": {"nanoseconds": last - first}}


class SplitRule(NamedTuple):
    """Limits of one file of a bag, at which the next file begins.

    Attributes:
        size: Largest size of a file, bytes; 0 for no limit.
        duration: Longest time from the first to the last message of a file, s; 0 for no limit.
    """

    size: int = 0
    duration: float = 0.0


ONE_FILE = SplitRule()


class BagFile:
    """Writer of a new bag.

    Before each `write`, `make_room` allocates disk space for the message and for the index. So the bag can be closed with a complete index
    even when the disk has become full.

    Attributes:
        directory: Directory of the bag.
        counts: Number of messages written, by topic.
    """

    def __init__(self, directory: Path, reserve: int = RESERVE, *, compression: str = "none", split: SplitRule = ONE_FILE) -> None:
        """Make the directory and open the first file.

        Args:
            directory: Directory of the bag, which must not exist yet.
            reserve: Bytes that must stay free on the disk.
            compression: Compression of the chunks, one of COMPRESSIONS.
            split: When the next file of the bag begins.

        Raises:
            BagError: The directory exists already or cannot be made, or the disk has no room.
        """
        self.directory, self.counts = Path(directory), dict[str, int]()
        self._reserve, self._compression, self._split = reserve, compression, split
        self._topics: dict[str, _Topic] = {}
        self._overhead = PER_BAG  # bytes
        self._parts: list[_Part] = []
        try:
            if self.directory.exists():
                raise FileExistsError("it exists already")
            self.directory.mkdir(parents=True)
            self._begin()
        except OSError as error:
            raise BagError(f"cannot record to {directory}: {error}") from error

    @property
    def free(self) -> int:
        """Bytes that were free on the disk when space was last allocated."""
        return self._part.file.free

    @property
    def _part(self) -> _Part:
        return self._parts[-1]

    def _begin(self) -> None:
        """Open the next file, and close the one before it. Raises OSError if there is no room; then the one before it stays open."""
        suffix = f"_{len(self._parts)}" if self._split != ONE_FILE else ""
        path = self.directory / f"{self.directory.name}{suffix}.mcap"
        file = _File(path, self._reserve)
        try:
            file.allocate(self._overhead)
        except OSError:
            file.close()
            path.unlink()
            raise
        writer = Writer(file, chunk_size=2 * LARGEST_CHUNK, compression=COMPRESSIONS[self._compression])
        writer.start(profile="ros2")
        if self._parts:
            self._finish(self._part)
        self._parts.append(_Part(path, file, writer))
        for topic in self._topics.values():
            self._register(topic)

    def _finish(self, part: _Part, custom: Mapping[str, str] | None = None) -> None:
        """Write the index of a file and close it."""
        text = yaml.safe_dump(self._information([part], custom), sort_keys=False)
        part.writer.add_metadata("rosbag2", {"serialized_metadata": text})
        part.writer.finish()
        part.file.close()

    def add_topic(self, name: str, kind: str, offered: Sequence[Qos], types: Typestore = TYPESTORE) -> None:
        """Add a topic to the bag.

        Args:
            name: Name of the topic, which must be new.
            kind: Message type, e.g. "sensor_msgs/msg/Image".
            offered: Quality of service of each publisher.
            types: Type store that has the definition of the type.
        """
        definition = types.generate_msgdef(kind, ros_version=2)[0].encode()
        topic = self._topics[name] = _Topic(name, kind, definition, types.hash_rihs01(kind), tuple(offered))
        self.counts[name] = 0
        self._overhead += 2 * len(definition) + PER_TOPIC + PER_PUBLISHER * len(offered)
        self._register(topic)

    def _register(self, topic: _Topic) -> None:
        """Add a topic to the present file."""
        writer = self._part.writer
        qos = yaml.safe_dump(dump_qos_v9(list(topic.offered)), sort_keys=False).strip()
        schema = writer.register_schema(topic.kind, "ros2msg", topic.definition)
        self._part.channels[topic.name] = writer.register_channel(topic.name, "cdr", schema, {"offered_qos_profiles": qos})

    def attach(self, name: str, time: int, media_type: str, data: bytes) -> None:
        """Store a small file in the bag, as an attachment of MCAP.

        Args:
            name: Name of the attachment.
            time: Time at which its content was made, ns.
            media_type: Media type, e.g. "application/yaml".
            data: Its content.

        Raises:
            OSError: There is no room, or the disk fails.
        """
        self._overhead += PER_TOPIC
        self._allocate(len(data))
        self._part.writer.add_attachment(time, time, name, media_type, data)
        self._part.file.flush()  # an attachment must survive a crash

    def make_room(self, size: int, time: int) -> None:
        """Allocate disk space for one more message, in the next file of the bag if the present one has reached a limit of the split rule.

        Args:
            size: Size of the message, bytes.
            time: Time at which it was received, ns.

        Raises:
            OSError: The disk has no room.
        """
        part, (largest, longest) = self._part, self._split
        if part.first and ((largest and part.file.position + part.pending >= largest) or (longest and time - part.first >= longest * 1e9)):
            self._begin()
        self._allocate(size + PER_MESSAGE)

    def _allocate(self, size: int) -> None:
        part = self._part
        index = (part.chunks + 2) * (PER_CHUNK + PER_CHUNK_AND_TOPIC * len(self._topics))
        part.file.allocate(part.file.position + part.pending + self._overhead + index + size)

    def write(self, topic: str, time: int, data: bytes) -> None:
        """Write a message for which `make_room` has allocated space.

        Args:
            topic: Name of a topic that was added.
            time: Time at which the message was received, ns.
            data: The serialized message (CDR).

        Raises:
            OSError: The disk failed. The bag is then broken.
        """
        part = self._part
        part.writer.add_message(part.channels[topic], time, data, time)
        part.pending += len(data) + PER_MESSAGE
        if part.pending > min(max(CHUNK, CHUNK_SHARE * part.file.position), LARGEST_CHUNK):
            part.writer.flush()
            part.pending, part.chunks = 0, part.chunks + 1
        part.counts[topic] += 1
        part.first, part.last = min(part.first or time, time), max(part.last, time)
        self.counts[topic] += 1

    def close(self, dropped: Mapping[str, int] | None = None, missed: Mapping[str, int] | None = None) -> Summary:
        """Write the index and the metadata, with the numbers of lost messages, and close the bag.

        Args:
            dropped: Messages that were not written, by topic, as in Summary.
            missed: Messages that never arrived, by topic, as in Summary.

        Returns:
            Summary of the bag.

        Raises:
            OSError: The disk failed. The bag then has no complete index.
        """
        dropped, missed = dropped or {}, missed or {}
        custom = {name: json.dumps(losses) for name, losses in (("dropped", dropped), ("missed", missed)) if losses}
        self._finish(self._part, custom)
        information = self._information(self._parts, custom)
        text = yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)
        partial = self.directory / "metadata.yaml.tmp"
        partial.write_text(text)
        partial.replace(self.directory / "metadata.yaml")
        size = sum(part.path.stat().st_size for part in self._parts)
        return Summary(self.directory, self.counts, information["duration"]["nanoseconds"] * 1e-9, size, dropped, missed)

    def _information(self, parts: Sequence[_Part], custom: Mapping[str, str] | None) -> dict[str, Any]:
        """Return the content of metadata.yaml about some of the files. custom: additional texts of the recorder, by key."""
        filled = [part for part in parts if part.first] or [parts[0]]
        topics = [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.kind,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": dump_qos_v9(list(topic.offered)),
                    "type_description_hash": topic.hash,
                },
                "message_count": sum(part.counts[topic.name] for part in parts),
            }
            for topic in self._topics.values()
        ]
        return {
            "version": VERSION,
            "storage_identifier": "mcap",
            "relative_file_paths": [part.path.name for part in parts],
            **_span(min(part.first for part in filled), max(part.last for part in filled)),
            "message_count": sum(part.counts.total() for part in parts),
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "files": [part.information() for part in parts],
            "custom_data": dict(custom) if custom else None,
            "ros_distro": "jazzy",
        }

    def abort(self) -> None:
        """Close the present file as it is, without an index."""
        with suppress(OSError):
            self._part.file.close()
