"""Write a rosbag2 directory of one MCAP file that can be closed even when the disk has become full."""

from __future__ import annotations

import errno
import io
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.typesys.store import Typestore
from tt_core.ros.bags import TYPES, BagError

RESERVE = 64 * 2**20  # bytes of the disk that stay free
AHEAD = 16 * 2**20  # bytes by which the file is allocated ahead
CHUNK = 2**20  # bytes of messages that the MCAP writer of rosbags puts into one chunk
PER_MESSAGE, PER_CHUNK, PER_CHUNK_AND_TOPIC = 64, 256, 32  # bytes in the file beside the data, at most
PER_BAG, PER_TOPIC, PER_PUBLISHER = 2**16, 4096, 4096  # bytes in channels, index and metadata, at most


@dataclass(frozen=True, slots=True)
class Summary:
    """What was recorded.

    Attributes:
        directory: The bag.
        counts: Messages in it, by topic.
        duration: s, from the first to the last message.
        size: Bytes of its file.
        dropped: Messages that were not written, by topic, because the disk was full or slow.
        missed: Messages that never arrived, by topic, as the middleware tells.
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
    """A file that is allocated before it is written and cut to its content when it is closed."""

    def __init__(self, raw: io.RawIOBase, reserve: int) -> None:
        super().__init__(raw)
        self._reserve, self._allocated, self.free = reserve, 0, 0

    def allocate(self, size: int) -> None:
        """Have at least `size` bytes for the file. Raises OSError if the disk would be left with less than the reserve."""
        if size > self._allocated:
            try:
                self._extend(size + AHEAD)
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


class BagFile:
    """A new bag. A message is taken only if the file has room for it and for the index.

    Attributes:
        directory: The bag.
        counts: Messages written, by topic.
    """

    def __init__(self, directory: Path, reserve: int = RESERVE) -> None:
        """Make the directory and open the file.

        Args:
            directory: The bag, which must not exist.
            reserve: Bytes of the disk that are to stay free.

        Raises:
            BagError: If `directory` exists, cannot be made or has no room.
        """
        self.directory, self.counts = Path(directory), dict[str, int]()
        self._connections: dict[str, Connection] = {}
        self._first, self._last = 0, 0
        self._overhead, self._content = PER_BAG, 0  # bytes
        try:
            self._writer = Writer(self.directory, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
            assert isinstance(self._writer.storage, McapWriter)
            self._path = self._writer.storage.path
            self._file = self._writer.storage.bio = _File(self._writer.storage.bio.detach(), reserve)
            self._file.allocate(self._overhead)
        except (WriterError, OSError) as error:
            raise BagError(f"cannot record to {directory}: {error}") from error

    @property
    def free(self) -> int:
        """Bytes free on the disk when the file was last allocated."""
        return self._file.free

    def add_topic(self, name: str, kind: str, offered: Sequence[Qos], types: Typestore = TYPES) -> None:
        """Begin a topic.

        Args:
            name: Name of the topic, which must be new.
            kind: Type, e.g. "sensor_msgs/msg/Image".
            offered: Quality of service of each publisher.
            types: What defines the type.
        """
        made = self._writer.add_connection(name, kind, typestore=types, offered_qos_profiles=offered)
        self._connections[name], self.counts[name] = made, 0
        self._overhead += 2 * len(made.msgdef.data) + PER_TOPIC + PER_PUBLISHER * len(offered)

    def make_room(self, size: int) -> None:
        """Allocate the file for one more message. Raises OSError if there is no room.

        Args:
            size: Bytes of the message.
        """
        content = self._content + size + PER_MESSAGE
        chunks = content // CHUNK + 2
        self._file.allocate(self._overhead + content + chunks * (PER_CHUNK + PER_CHUNK_AND_TOPIC * len(self._connections)))

    def write(self, topic: str, time: int, data: bytes) -> None:
        """Write a message for which there is room.

        Args:
            topic: A topic that was begun.
            time: ns, when the message was received.
            data: CDR.

        Raises:
            OSError: If the disk fails. Then the bag is broken.
        """
        self._writer.write(self._connections[topic], time, data)
        self._content += len(data) + PER_MESSAGE
        self.counts[topic] += 1
        self._first, self._last = min(self._first or time, time), max(self._last, time)

    def close(self, dropped: Mapping[str, int] | None = None, missed: Mapping[str, int] | None = None) -> Summary:
        """Write the index and the metadata, in which the losses are noted.

        Args:
            dropped: As in Summary.
            missed: As in Summary.

        Returns:
            What was recorded.

        Raises:
            OSError: If the disk fails. Then the bag has no index.
        """
        dropped, missed = dropped or {}, missed or {}
        for name, losses in (("dropped", dropped), ("missed", missed)):
            if losses:
                self._writer.set_custom_data(name, json.dumps(losses))
        self._writer.close()
        return Summary(self.directory, self.counts, (self._last - self._first) * 1e-9, self._path.stat().st_size, dropped, missed)

    def abort(self) -> None:
        """Close the file as it is, without an index."""
        with suppress(OSError):
            self._writer.abort()
