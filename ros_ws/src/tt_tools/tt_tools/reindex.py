"""Rewrite a bag, to make it readable after its recorder was killed, or to change its compression."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC as MAGIC
from mcap.writer import Writer
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore
from tt_core.ros.bags import TYPESTORE, BagError, bag_files, unpacked

from .bagfile import COMPRESSIONS, BagFile, Summary


def reindex(path: Path) -> Summary:
    """Make a bag readable whose recorder was killed, by writing the complete chunks of its MCAP files to a new file with an index.

    Args:
        path: Directory of a bag, whose MCAP files become one file, or a single MCAP file.

    Returns:
        Summary of what was saved.

    Raises:
        BagError: A file is not MCAP, there is nothing to save, or there is no room for the copy. The bag then stays as it is.
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


def _records(file: Path) -> Iterator[McapRecord]:
    """Yield the records in the complete chunks, and the attachments, in the order of the file.

    MCAP specification: opcode, length, content.
    """
    size, position = file.stat().st_size, len(MAGIC)
    with file.open("rb") as stream:
        while position + 9 <= size:
            stream.seek(position)
            opcode, length = struct.unpack("<BQ", stream.read(9))
            if not opcode:  # space that was allocated and never written
                return
            position += 9 + length
            if opcode == Opcode.CHUNK and position <= size:
                yield from _in_chunk(Chunk.read(ReadDataStream(stream)))
            if opcode == Opcode.ATTACHMENT and position <= size:
                yield Attachment.read(ReadDataStream(stream))


def _in_chunk(chunk: Chunk) -> list[McapRecord]:
    try:
        return breakup_chunk(chunk)
    except Exception:  # a damaged chunk can fail in any part of its decoding, with any error
        return []


def _copy(file: Path, bag: BagFile) -> None:
    schemas: dict[int, Schema] = {}
    topics: dict[int, str] = {}
    for record in _records(file):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in topics:
            topics[record.id] = record.topic
            if record.topic not in bag.counts:
                schema = schemas[record.schema_id]
                bag.add_topic(record.topic, schema.name, parse_qos(record.metadata.get("offered_qos_profiles", "")), _types(schema))
        elif isinstance(record, Message):
            data = unpacked(record.data)
            bag.make_room(len(data), record.log_time)
            bag.write(topics[record.channel_id], record.log_time, data)
        elif isinstance(record, Attachment):
            bag.attach(record.name, record.log_time, record.media_type, record.data)


def _types(schema: Schema) -> Typestore:
    if schema.name in TYPESTORE.fielddefs:
        return TYPESTORE
    types = get_typestore(Stores.EMPTY)
    types.register({**TYPESTORE.fielddefs, **get_types_from_msg(schema.data.decode(), schema.name)})
    return types


def compress(bag: Path, compression: str) -> None:
    """Rewrite the MCAP files of a complete bag with another compression of their chunks.

    Each file is replaced when its copy is complete.

    Args:
        bag: Directory of a bag that was closed, or one of its files.
        compression: One of bagfile.COMPRESSIONS.

    Raises:
        BagError: A file is not MCAP or cannot be read, or there is no room for its copy.
    """
    for file in bag_files(Path(bag)):
        if file.suffix != ".mcap":
            raise BagError(f"only MCAP files can be compressed, not {file}")
        copy = file.with_suffix(".mcap.part")
        try:
            with file.open("rb") as source, copy.open("wb") as target:
                _rewrite(source, Writer(target, compression=COMPRESSIONS[compression]))
            copy.replace(file)
        except (OSError, McapError) as error:
            raise BagError(f"{file} cannot be compressed: {error}") from error
        finally:
            copy.unlink(missing_ok=True)


def _rewrite(source: IO[bytes], writer: Writer) -> None:
    """Copy the whole content of an MCAP file to a new one."""
    schemas, channels = {0: 0}, dict[int, int]()
    for record in StreamReader(source).records:
        if isinstance(record, Header):
            writer.start(record.profile)
        elif isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            schema = schemas[record.schema_id]
            channels[record.id] = writer.register_channel(record.topic, record.message_encoding, schema, record.metadata)
        elif isinstance(record, Message):
            writer.add_message(channels[record.channel_id], record.log_time, record.data, record.publish_time, record.sequence)
        elif isinstance(record, Attachment):
            writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
    writer.finish()
