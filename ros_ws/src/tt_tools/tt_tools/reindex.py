"""Describe a bag, and rewrite one whose recorder was killed, so that it can be read."""

from __future__ import annotations

import itertools
import shutil
import struct
from collections.abc import Iterator
from pathlib import Path

import yaml
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC as MAGIC
from rich.table import Table
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore
from tt_core.ros.bags import TYPES, Bag, BagError, bag_files, unpacked

from .bagfile import BagFile, Summary


def describe(path: Path) -> Table:
    """Return a description of a bag of any kind for the terminal. Raises BagError."""
    with Bag(path) as bag:
        seconds = (bag.end - bag.start) * 1e-9
        table = Table("topic", "type", "messages", "Hz", "", box=None)
        for topic in bag.topics:
            hertz = f"{topic.count / seconds:.1f}" if seconds > 0.0 else ""
            table.add_row(topic.name, topic.kind, str(topic.count), hertz, topic.refusal)
        counts = {topic.name: topic.count for topic in bag.topics}
        losses = {name: yaml.safe_load(bag.custom.get(name, "{}")) for name in ("dropped", "missed")}
        table.title, table.title_justify = str(Summary(Path(path), counts, seconds, bag.size, **losses)), "left"
    return table


def reindex(path: Path) -> Summary:
    """Rewrite a bag of MCAP files up to the last whole chunk of each.

    Args:
        path: A directory, whose MCAP files become one, or an MCAP file.

    Returns:
        What was saved.

    Raises:
        BagError: If there is nothing to save or no room for the copy. Then the bag stays as it is.
    """
    path = Path(path).absolute()
    files = bag_files(path)
    if others := [file.name for file in files if file.suffix != ".mcap"]:
        raise BagError(f"only MCAP files can be reindexed, not {', '.join(others)}")
    folder = path if path.is_dir() else path.parent
    work = folder / ".reindex"
    shutil.rmtree(work, ignore_errors=True)
    bag = BagFile(work / (path.name if path.is_dir() else path.stem), reserve=0)
    try:
        for file in files:
            _copy(file, bag)
        summary = bag.close()
        if not any(summary.counts.values()):
            raise BagError(f"{path} holds no whole chunk")
        made = [file for file in bag.directory.iterdir() if path.is_dir() or file.suffix == ".mcap"]
        for file in made:
            file.replace(folder / file.name)
        for file in {*files} - {folder / file.name for file in made}:
            file.unlink()
    except OSError as error:
        raise BagError(f"{path} cannot be copied: {error}") from error
    finally:
        bag.abort()
        shutil.rmtree(work)
    return Summary(path, summary.counts, summary.duration, summary.size)


def _whole_chunks(file: Path) -> Iterator[Chunk]:
    """Yield the complete chunks in the order of the file (MCAP specification: opcode, length, content)."""
    size, position = file.stat().st_size, len(MAGIC)
    with file.open("rb") as stream:
        while position + 9 <= size:
            stream.seek(position)
            opcode, length = struct.unpack("<BQ", stream.read(9))
            if not opcode:  # allocated and not written
                return
            position += 9 + length
            if opcode == Opcode.CHUNK and position <= size:
                yield Chunk.read(ReadDataStream(stream))


def _records(chunk: Chunk) -> list[McapRecord]:
    try:
        return breakup_chunk(chunk)
    except Exception:  # a damaged chunk fails in whatever part of its decoding meets it first
        return []


def _copy(file: Path, bag: BagFile) -> None:
    schemas: dict[int, Schema] = {}
    topics: dict[int, str] = {}
    for record in itertools.chain.from_iterable(map(_records, _whole_chunks(file))):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in topics:
            topics[record.id] = record.topic
            if record.topic not in bag.counts:
                schema = schemas[record.schema_id]
                bag.add_topic(record.topic, schema.name, parse_qos(record.metadata.get("offered_qos_profiles", "")), _types(schema))
        elif isinstance(record, Message):
            data = unpacked(record.data)
            bag.make_room(len(data))
            bag.write(topics[record.channel_id], record.log_time, data)


def _types(schema: Schema) -> Typestore:
    if schema.name in TYPES.fielddefs:
        return TYPES
    types = get_typestore(Stores.EMPTY)
    types.register({**TYPES.fielddefs, **get_types_from_msg(schema.data.decode(), schema.name)})
    return types
