"""Describe the content of a bag, in the format of `ros2 bag info`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from mcap.reader import make_reader
from tt_core.ros.bags import Bag, Topic, bag_files

LABEL = 19  # characters, width of the column of labels
STORAGES = {".mcap": "mcap", ".db3": "sqlite3", ".bag": "rosbag_v1"}
SORTS = ("name", "type", "count")


class BagDescription(NamedTuple):
    """Content of a bag.

    Attributes:
        files: Names of its files.
        storage: Format of its files: "mcap", "sqlite3" or "rosbag_v1".
        size: Size of its files, bytes.
        start: Time of the first message, ns.
        end: Time of the last message, ns.
        topics: All topics.
        sizes: Bytes of all messages of a topic, by topic; empty unless they were counted.
        attachments: Names of the attachments, which are files that the recorder added.
        losses: Number of messages that were lost, by topic, for each cause of CAUSES.
    """

    files: list[str]
    storage: str
    size: int
    start: int
    end: int
    topics: list[Topic]
    sizes: dict[str, int]
    attachments: list[str]
    losses: Mapping[str, Mapping[str, int]]


CAUSES = {"dropped": "because the disk was full or slow", "missed": "by the middleware"}


def describe_bag(path: Path, *, sizes: bool = False) -> BagDescription:
    """Return a description of a bag.

    Args:
        path: A bag of any kind.
        sizes: Whether all messages are read to count the bytes of each topic.

    Raises:
        BagError: The bag cannot be read.
    """
    files = bag_files(Path(path))
    with Bag(path) as bag:
        losses = {name: json.loads(bag.custom[name]) for name in CAUSES if name in bag.custom}
        bytes_of = dict.fromkeys((topic.name for topic in bag.topics), 0)
        if sizes:
            for message in bag.messages():
                bytes_of[message.topic] += len(message.data)
        storage = STORAGES[Path(files[0].name.removesuffix(".zstd")).suffix]
        counted = bytes_of if sizes else {}
        return BagDescription(
            [f.name for f in files], storage, bag.size, bag.start, bag.end, bag.topics, counted, list(attachments(Path(path))), losses
        )


def attachments(path: Path) -> dict[str, bytes]:
    """Return the content of each attachment of a bag by name; empty for a bag that is not MCAP, or that has no index.

    Raises:
        BagError: The path is no bag.
    """
    found: dict[str, bytes] = {}
    for file in bag_files(path):
        if file.suffix == ".mcap":
            with file.open("rb") as stream, suppress(Exception):  # a damaged file has none
                found |= {attachment.name: attachment.data for attachment in make_reader(stream).iter_attachments()}
    return found


def lines(found: BagDescription, sort: str = "name") -> Iterator[str]:
    """Yield the lines that `ros2 bag info` prints about a bag.

    Args:
        found: Content of the bag.
        sort: Order of the topics, one of SORTS.
    """

    def labelled(label: str, values: list[str]) -> Iterator[str]:
        for i, value in enumerate(values or [""]):
            yield f"{label if not i else '':<{LABEL}}{value}".rstrip()

    key = {"name": lambda t: t.name, "type": lambda t: t.kind, "count": lambda t: t.count}[sort]
    topics = sorted(found.topics, key=key)
    yield ""
    yield from labelled("Files:", found.files)
    yield from labelled("Bag size:", [_bytes(found.size)])
    yield from labelled("Storage id:", [found.storage])
    yield from labelled("Duration:", [f"{(found.end - found.start) * 1e-9:.9f}s"])
    yield from labelled("Start:", [_date(found.start)])
    yield from labelled("End:", [_date(found.end)])
    yield from labelled("Messages:", [str(sum(topic.count for topic in topics))])
    yield from labelled("Topic information:", [_topic(found, topic) for topic in topics])
    for name, losses in found.losses.items():
        rows = [f"Topic: {topic} | Count: {count} {CAUSES[name]}" for topic, count in sorted(losses.items())]
        yield from labelled(f"Messages {name}:", rows)
    if found.attachments:
        yield from labelled("Attachments:", found.attachments)


def _topic(found: BagDescription, topic: Topic) -> str:
    text = f"Topic: {topic.name} | Type: {topic.kind} | Count: {topic.count}"
    if found.sizes:
        text += f" | Size Contribution: {_bytes(found.sizes[topic.name])}"
    return f"{text} | Serialization Format: cdr" + (f" | {topic.refusal}" if topic.refusal else "")


def _bytes(size: float) -> str:
    for unit in ("B", "KiB", "MiB", "GiB"):
        if size < 1024.0:
            return f"{size:.0f} B" if unit == "B" else f"{size:.1f} {unit}"
        size /= 1024.0
    return f"{size:.1f} TiB"


def _date(time: int) -> str:
    date = datetime.fromtimestamp(time // 10**9)
    return f"{date:%b} {date.day:2} {date:%Y %H:%M:%S}.{time % 10**9:09d} ({time // 10**9}.{time % 10**9:09d})"
