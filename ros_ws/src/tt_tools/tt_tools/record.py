"""Record messages to a bag. A separate thread writes them, so that no caller waits for the disk."""

from __future__ import annotations

import queue
import threading
import time
from collections import Counter
from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import NamedTuple

from rosbags.interfaces import Qos
from tt_core.failures import Failure
from tt_core.ros.bags import TYPESTORE, BagError

from .bagfile import ONE_FILE, RESERVE, BagFile, SplitRule, Summary

QUEUE = 256 * 2**20  # bytes of messages that may wait for the disk: 2.6 s of two cameras at 900 Hz
OVERHEAD = 300  # bytes of memory for a queued message beside its data
SLOW_WRITE = 0.5  # s for one message, above which the disk counts as slow
RETRY = 0.25  # s between two checks whether a full disk has room again
QUEUE_TIMEOUT, CLOSE_TIMEOUT = 4.0, 2.0  # s that `close` waits: first for the queue to be written, then for the file to be closed


class DiskFailure(Enum):
    """What is wrong with the disk: codes of `tt_core.failures.Failure`."""

    FULL = "the disk is full: {error}"
    SLOW = "the disk is slow"
    FAILED = "the disk failed: {error}"
    SILENT = "the disk has not answered for {seconds:g} s"


class State(NamedTuple):
    """State of a recording.

    Attributes:
        trouble: What is wrong with the disk; None if nothing is.
        queued: Bytes of messages that wait in the queue.
        free: Bytes that were free on the disk at the last allocation.
        dropped: Number of messages that were not written, by topic.
        missed: Number of messages that the middleware lost before they arrived, by topic.
    """

    trouble: Failure | None
    queued: int
    free: int
    dropped: dict[str, int]
    missed: dict[str, int]


class _Topic(NamedTuple):
    name: str
    kind: str
    offered: Sequence[Qos]


class _Sample(NamedTuple):
    topic: str
    time: int
    data: bytes


class _Attachment(NamedTuple):
    name: str
    time: int
    media_type: str
    data: bytes


class Recording:
    """A new bag to which messages are recorded.

    `add` never waits for the disk: it puts messages into a queue, which a writer thread empties. A message that does not fit into the queue
    or on the disk is dropped and counted. Recording goes on when there is room again. Messages are written to the file in chunks: of 1 MB
    at first, later of a thirty-second of the file, at most of 6 MB. A crash loses no more than the last chunk.
    """

    def __init__(
        self,
        directory: Path,
        *,
        queue_bytes: int = QUEUE,
        reserve_bytes: int = RESERVE,
        compression: str = "none",
        split: SplitRule = ONE_FILE,
    ) -> None:
        """Make the directory, open the file and start the writer thread.

        Args:
            directory: Directory of the bag, which must not exist yet.
            queue_bytes: Largest size of the queue, bytes.
            reserve_bytes: Bytes that must stay free on the disk.
            compression: Compression of the chunks, one of bagfile.COMPRESSIONS.
            split: When the next file of the bag begins.

        Raises:
            BagError: The directory exists already or cannot be made, or the disk has no room.
        """
        self._bag = BagFile(directory, reserve_bytes, compression=compression, split=split)
        self._queue: queue.SimpleQueue[_Topic | _Sample | _Attachment | None] = queue.SimpleQueue()
        self._lock = threading.Lock()  # protects `_queued` and `_dropped`
        self._largest, self._queued, self._dropped = queue_bytes, 0, Counter[str]()
        self._missed: dict[str, int] = {}
        self._full: Failure | None = None  # why the disk takes nothing now
        self._broken: Failure | None = None  # why it takes nothing any more
        self._retry = 0.0  # s, when to look for room again
        self._since: float | None = None  # s, when the writer began what it is doing
        self._slow_until = 0.0  # s
        self._over = False  # whether what is still queued is dropped
        self._summary: Summary | None = None
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    def add_topic(self, name: str, kind: str, offered: Sequence[Qos]) -> None:
        """Add a topic to the bag.

        Args:
            name: Name of the topic, which must be new.
            kind: Message type, e.g. "sensor_msgs/msg/Image".
            offered: Quality of service of each publisher.

        Raises:
            BagError: The type is not one of ROS 2 Jazzy.
        """
        if kind not in TYPESTORE.types:
            raise BagError(f"{name} has the unknown type {kind}")
        self._queue.put(_Topic(name, kind, offered))

    def attach(self, name: str, media_type: str, text: str) -> None:
        """Store a text file in the bag, as an attachment of MCAP.

        Args:
            name: Name of the attachment.
            media_type: Media type, e.g. "application/yaml".
            text: Its content.
        """
        self._queue.put(_Attachment(name, time.time_ns(), media_type, text.encode()))

    def add(self, topic: str, time: int, data: bytes) -> None:
        """Put a message into the queue, or drop and count it if the queue is full.

        Args:
            topic: Name of a topic that was added.
            time: Time at which the message was received, ns.
            data: The serialized message (CDR).
        """
        size = len(data) + OVERHEAD
        with self._lock:
            fits = self._queued + size <= self._largest
            if fits:
                self._queued += size
            else:
                self._dropped[topic] += 1
        if fits:
            self._queue.put(_Sample(topic, time, data))

    def count_missed(self, topic: str, number: int) -> None:
        """Note that `number` more messages of `topic` were lost before they arrived."""
        self._missed[topic] = self._missed.get(topic, 0) + number

    def state(self) -> State:
        """Return the present state without waiting for the disk."""
        with self._lock:
            queued, dropped = self._queued, dict(+self._dropped)
        now, since = time.monotonic(), self._since
        slow = (since is not None and now - since > SLOW_WRITE) or now < self._slow_until or queued > self._largest / 2
        trouble = self._broken or self._full or (Failure(DiskFailure.SLOW) if slow else None)
        return State(trouble, queued, self._bag.free, dropped, dict(self._missed))

    def close(self) -> Summary:
        """Write the messages in the queue, the index and the metadata, and close the bag.

        Messages that the disk does not take within QUEUE_TIMEOUT s are dropped and counted.

        Returns:
            Summary of what was recorded and what was lost.

        Raises:
            BagError: The bag could not be closed and has no index.
        """
        self._queue.put(None)
        self._thread.join(QUEUE_TIMEOUT)
        self._over = True
        self._thread.join(CLOSE_TIMEOUT)
        if self._summary is None:
            reason = self._broken or Failure(DiskFailure.SILENT, seconds=QUEUE_TIMEOUT + CLOSE_TIMEOUT)
            bag = self._bag.directory
            raise BagError(f"{bag} has no index ({reason}); ros2 bag reindex {bag} saves what was written")
        return self._summary

    def _run(self) -> None:
        """Write the items of the queue until None comes. Runs in the writer thread."""
        while (item := self._queue.get()) is not None:
            self._since = time.monotonic()
            if isinstance(item, _Topic):
                self._bag.add_topic(*item)
            elif isinstance(item, _Attachment):
                self._attach(item)
            else:
                written = self._write(item)
                with self._lock:
                    self._queued -= len(item.data) + OVERHEAD
                    self._dropped[item.topic] += not written
            now = time.monotonic()
            if now - self._since > SLOW_WRITE:
                self._slow_until = now + 2 * SLOW_WRITE
            self._since = None
        try:
            if not self._broken:
                self._summary = self._bag.close(+self._dropped, self._missed)
        except OSError as error:
            self._broken = Failure(DiskFailure.FAILED, error=error, errno=error.errno)
        if self._broken:
            self._bag.abort()

    def _write(self, sample: _Sample) -> bool:
        """Write one message to the bag. Return False if it was dropped."""
        if self._broken or self._over or (self._full and time.monotonic() < self._retry):
            return False
        try:
            self._bag.make_room(len(sample.data), sample.time)
        except OSError as error:
            self._wait_for_room(error)
            return False
        self._full = None
        try:
            self._bag.write(*sample)
        except OSError as error:
            self._broken = Failure(DiskFailure.FAILED, error=error, errno=error.errno)
        return not self._broken

    def _wait_for_room(self, error: OSError) -> None:
        """Keep that the disk is full, and when to try again."""
        self._full = Failure(DiskFailure.FULL, error=error.strerror, errno=error.errno)
        self._retry = time.monotonic() + RETRY

    def _attach(self, attachment: _Attachment) -> None:
        """Write an attachment to the bag. It is left out if the disk is full."""
        if self._broken or self._over:
            return
        try:
            self._bag.attach(*attachment)
        except OSError as error:
            self._wait_for_room(error)
