"""Reading of bags of every kind: ROS 1 and ROS 2, MCAP and SQLite, one file or several, compressed or not.

The formats are those that `rosbags` reads. Messages of ROS 1 are converted to the messages of ROS 2 Jazzy with the same name. This module
needs no installed ROS.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import zstandard
from rosbags import rosbag1, rosbag2
from rosbags.convert.converter import LATCH, is_same_wireformat, migrate_bytes
from rosbags.interfaces import Connection, ConnectionExtRosbag1, MessageDefinitionFormat, Qos
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ..errors import TtError

TYPESTORE = get_typestore(Stores.ROS2_JAZZY)
SUFFIXES = (".mcap", ".db3", ".bag")
_IDL = "=" * 80 + "\nIDL: "  # before each file of an IDL definition


class BagError(TtError):
    """A bag that cannot be read or written."""


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic of a bag.

    Attributes:
        name: Name of the topic.
        kind: Message type, e.g. "sensor_msgs/msg/Image".
        count: Number of its messages in the bag.
        offered: Quality of service of each recorded publisher, as far as it is known.
        refusal: Why its messages cannot be read; "" if they can.
    """

    name: str
    kind: str
    count: int
    offered: tuple[Qos, ...] = ()
    refusal: str = ""


class Message(NamedTuple):
    """A recorded message.

    Attributes:
        topic: Name of the topic.
        kind: Message type, e.g. "sensor_msgs/msg/Image".
        time: Time when it was received, ns.
        data: The serialized message, in the format CDR of ROS 2.
    """

    topic: str
    kind: str
    time: int
    data: bytes


class Bag:
    """An open bag, to be used as a context manager.

    Attributes:
        path: Path of the bag.
        topics: All topics. Those whose `refusal` is not empty have no messages that can be read.
        count: Number of messages of all topics.
        start: Time of the first message, ns; 0 without messages.
        end: Time of the last message, ns; 0 without messages.
        size: Bytes of its files.
        custom: Entries that the recorder added to the metadata, by key.
    """

    def __init__(self, path: Path) -> None:
        """Open a bag.

        Args:
            path: A file *.mcap, *.db3 or *.bag, the directory of a rosbag2 recording, or a directory of such files.

        Raises:
            BagError: The path does not exist, is no bag, or the bag is damaged.
        """
        self.path = Path(path)
        files = bag_files(self.path)
        whole = [self.path] if (self.path / "metadata.yaml").is_file() else files
        self.size = sum(file.stat().st_size for file in files)
        self._stack = ExitStack()
        self._readers: list[rosbag1.Reader | rosbag2.Reader] = []
        try:
            for file in whole:
                reader = rosbag1.Reader(file) if file.suffix == ".bag" else rosbag2.Reader(file)
                reader.open()
                self._stack.callback(reader.close)
                self._readers.append(reader)
            self._connections = [connection for reader in self._readers for connection in reader.connections]
        except Exception as error:  # a damaged file fails in whatever part of whatever library meets it first
            self._stack.close()
            raise BagError(f"{self.path} is damaged: {_words(error)}{advice(self.path)}") from error
        filled = [reader for reader in self._readers if reader.message_count]
        self.count = sum(reader.message_count for reader in filled)
        self.start = min((reader.start_time for reader in filled), default=0)
        self.end = max((reader.end_time - 1 for reader in filled), default=0)
        self._to_ros2: dict[str, Callable[[bytes], Any]] = {}
        self.topics = self._topics()
        self.custom: dict[str, str] = {}
        for reader in self._readers:
            if isinstance(reader, rosbag2.Reader):
                self.custom |= reader.storage.metadata.custom or {}

    def find(self, name: str) -> str | None:
        """Return the full name of a topic, whatever namespace it was recorded in.

        Args:
            name: Relative name, e.g. "ball/path", which fits "/ball/path" and "/robot1/ball/path".

        Returns:
            The full name; the one without a namespace if it exists; None if no topic fits.

        Raises:
            BagError: Several namespaces have the topic.
        """
        found = sorted({topic.name for topic in self.topics if topic.name.endswith(f"/{name}")})
        if f"/{name}" in found or not found:
            return f"/{name}" if found else None
        if len(found) > 1:
            raise BagError(f"{self.path} holds several robots: {', '.join(found)}")
        return found[0]

    def messages(self, topics: Collection[str] = (), start: int | None = None, stop: int | None = None) -> Iterator[Message]:
        """Read messages in the order of time.

        Args:
            topics: Names of the topics wanted; all topics if empty.
            start: Time of the first message wanted, ns; None for the start of the bag.
            stop: Time of the last message wanted, ns; None for the end of the bag.

        Yields:
            The messages of these topics, except topics with a `refusal`.

        Raises:
            BagError: The bag is damaged at this place.
        """
        refused = {(topic.name, topic.kind) for topic in self.topics if topic.refusal}
        wanted = [c for c in self._connections if (not topics or c.topic in topics) and (c.topic, c.msgtype) not in refused]
        streams = []
        for reader in self._readers:
            if mine := [connection for connection in reader.connections if connection in wanted]:
                streams.append(reader.messages(mine, start, None if stop is None else stop + 1))
        count = 0
        try:
            for connection, time, data in heapq.merge(*streams, key=lambda row: row[1]):
                yield Message(connection.topic, connection.msgtype, time, bytes(self._to_ros2[connection.msgtype](data)))
                count += 1
        except (GeneratorExit, BagError):
            raise
        except Exception as error:  # as in __init__
            raise BagError(f"{self.path} is damaged after {count} messages: {_words(error)}{advice(self.path)}") from error

    def decode(self, message: Message) -> Any:
        """Return a message as an object with the fields of its type.

        Args:
            message: A message that `messages` has returned.

        Raises:
            BagError: Neither the bag nor ROS 2 Jazzy defines the type, or the bytes are no message of this type.
        """
        types = TYPESTORE if self._is_ros1 else self._types
        if message.kind not in types.fielddefs:
            raise BagError(f"{message.topic} in {self.path} has the unknown type {message.kind}")
        try:
            return types.deserialize_cdr(message.data, message.kind)
        except Exception as error:  # broken bytes fail anywhere in the generated code
            raise BagError(f"a message on {message.topic} in {self.path} is no {message.kind}: {_words(error)}") from error

    def close(self) -> None:
        """Close all files."""
        self._stack.close()

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    @property
    def _is_ros1(self) -> bool:
        return any(isinstance(reader, rosbag1.Reader) for reader in self._readers)

    def _topics(self) -> list[Topic]:
        found: dict[tuple[str, str], Topic] = {}
        for c in self._connections:
            offered = (LATCH if c.ext.latching else []) if isinstance(c.ext, ConnectionExtRosbag1) else c.ext.offered_qos_profiles
            before = found.get((c.topic, c.msgtype), Topic(c.topic, c.msgtype, 0, (), self._refusal(c.msgtype)))
            found[c.topic, c.msgtype] = replace(before, count=before.count + c.msgcount, offered=(*before.offered, *offered))
        return sorted(found.values(), key=lambda topic: topic.name)

    def _refusal(self, kind: str) -> str:
        if kind not in self._to_ros2:
            try:
                self._to_ros2[kind] = self._converter(kind)
            except KeyError as error:
                return f"no type {error.args[0]} in ROS 2 Jazzy or in the bag"
        return ""

    def _converter(self, kind: str) -> Callable[[bytes], Any]:
        """Return the function that converts the bag's bytes to a CDR message of ROS 2 Jazzy. Raises KeyError for an unknown type."""
        if not self._is_ros1:
            return unpacked
        if is_same_wireformat(self._types, TYPESTORE, kind, kind):
            return partial(TYPESTORE.ros1_to_cdr, typename=kind)
        return partial(migrate_bytes, self._types, TYPESTORE, kind, kind, {}, src_is2=False, dst_is2=True)

    @cached_property
    def _types(self) -> Typestore:
        """The types as the bag defines them, and those of Jazzy for what it does not define."""
        types: dict[str, Any] = {} if self._is_ros1 else dict(TYPESTORE.fielddefs)
        for connection in self._connections:
            with suppress(Exception):  # a definition that cannot be parsed: the type is unknown, which `decode` tells
                types |= _definitions(connection)
        store = get_typestore(Stores.EMPTY)
        store.register(types)
        return store


def bag_files(path: Path) -> list[Path]:
    """Find the files of a bag.

    Args:
        path: Path of the bag, as for `Bag`.

    Returns:
        The files that hold its messages, sorted by name.

    Raises:
        BagError: The path does not exist, or no file there holds messages.
    """
    if not path.exists():
        raise BagError(f"there is no file or folder {path}")
    if path.is_file():
        if path.suffix not in SUFFIXES:
            raise BagError(f"{path} is no bag; the name of one ends in {', '.join(SUFFIXES)}")
        return [path]
    for suffixes in (SUFFIXES[:2], SUFFIXES[2:]):  # beside the files of ROS 2 may lie the one of ROS 1 that they were made from
        if files := sorted(file for file in path.iterdir() if file.name.removesuffix(".zstd").endswith(suffixes) and file.is_file()):
            return files
    raise BagError(f"{path} is no bag; it holds no file *{', *'.join(SUFFIXES)}")


def unpacked(data: bytes) -> bytes:
    """Return the CDR bytes of a recorded message, decompressed if rosbag2 has compressed it by itself. CDR itself begins with a 0."""
    data = bytes(data)
    return zstandard.ZstdDecompressor().decompressobj().decompress(data) if data[:4] == zstandard.FRAME_HEADER else data


def advice(path: Path) -> str:
    """Return what a user can do about a damaged bag, to be added to an error message; "" if nothing helps."""
    with suppress(BagError, OSError):
        files = bag_files(path)
        if all(file.suffix == ".mcap" and file.stat().st_size for file in files):
            return f"; if its recorder was killed: ros2 bag reindex {path}"
    return ""


def _definitions(connection: Connection) -> dict[str, Any]:
    form, text = connection.msgdef
    if form is MessageDefinitionFormat.MSG:
        return dict(get_types_from_msg(text, connection.msgtype))
    if form is MessageDefinitionFormat.NONE:
        return {}
    found: dict[str, Any] = {}
    files: Sequence[str] = [part.partition("\n")[2] for part in text.split(_IDL)[1:]] if text.startswith(_IDL) else [text]
    for file in files:
        found |= get_types_from_idl(file)
    return found


def _words(error: Exception) -> str:
    return str(error) or type(error).__name__
