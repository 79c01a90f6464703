"""Bags of every form, written with the libraries' own writers."""

from collections.abc import Callable
from pathlib import Path

import yaml
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS2_JAZZY)
ROS1 = get_typestore(Stores.ROS1_NOETIC)
Rows = list[tuple[str, str, int, object]]  # topic, type, time in ns, message


def write_ros2(folder: Path, rows: Rows, plugin: StoragePlugin, mode: CompressionMode = CompressionMode.NONE) -> Path:
    writer = rosbag2.Writer(folder / "bag", version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        kinds = {topic: kind for topic, kind, _, _ in rows}
        topics = {topic: writer.add_connection(topic, kind, typestore=TYPES) for topic, kind in kinds.items()}
        for topic, kind, time, message in rows:
            writer.write(topics[topic], time, TYPES.serialize_cdr(message, kind))
    return folder / "bag"


def write_ros1(folder: Path, rows: Rows, compression: rosbag1.Writer.CompressionFormat | None = None) -> Path:
    writer = rosbag1.Writer(folder / "bag.bag")
    if compression:
        writer.set_compression(compression)
    with writer:
        kinds = {topic: kind for topic, kind, _, _ in rows}
        topics = {
            topic: writer.add_connection(topic, kind, typestore=ROS1, latching=int(topic == "/latched")) for topic, kind in kinds.items()
        }
        for topic, kind, time, message in rows:
            writer.write(topics[topic], time, ROS1.serialize_ros1(as_ros1(message), kind))
    return folder / "bag.bag"


def as_ros1(message: object) -> object:
    """The same message in the types of ROS 1: a header has a number, the fields of CameraInfo are named by capitals."""
    kind = getattr(message, "__msgtype__", None)
    if kind is None:
        return [as_ros1(item) for item in message] if isinstance(message, list) else message
    fields = {name: as_ros1(getattr(message, name)) for name in type(message).__dataclass_fields__ if name != "__msgtype__"}
    if kind == "std_msgs/msg/Header":
        fields["seq"] = 7
    if kind == "sensor_msgs/msg/CameraInfo":
        fields = {name.upper() if name in "dkrp" else name: value for name, value in fields.items()}
    return ROS1.types[kind](**fields)


def split(folder: Path, rows: Rows, plugin: StoragePlugin) -> Path:
    """Two files, the first half of the messages in one, the rest in the other."""
    half, bag = len(rows) // 2, folder / "bag"
    parts = []
    for i, part in enumerate((rows[:half], rows[half:])):
        (folder / str(i)).mkdir()
        parts.append(write_ros2(folder / str(i), part, plugin))
    infos = [yaml.safe_load((part / "metadata.yaml").read_text())["rosbag2_bagfile_information"] for part in parts]
    bag.mkdir()
    counts: dict[str, int] = {}
    for i, (part, one) in enumerate(zip(parts, infos, strict=True)):
        (old,) = one["relative_file_paths"]
        name = f"bag_{i}{Path(old).suffix}"
        (part / old).replace(bag / name)
        one["relative_file_paths"] = [name]
        for topic in one["topics_with_message_count"]:
            counts[topic["topic_metadata"]["name"]] = counts.get(topic["topic_metadata"]["name"], 0) + topic["message_count"]
    both = {t["topic_metadata"]["name"]: t for one in infos for t in one["topics_with_message_count"]}
    for name, topic in both.items():
        topic["message_count"] = counts[name]
    start = infos[0]["starting_time"]["nanoseconds_since_epoch"]
    end = infos[1]["starting_time"]["nanoseconds_since_epoch"] + infos[1]["duration"]["nanoseconds"]
    joined = {
        **infos[0],
        "relative_file_paths": [name for one in infos for name in one["relative_file_paths"]],
        "duration": {"nanoseconds": end - start},
        "message_count": sum(one["message_count"] for one in infos),
        "topics_with_message_count": list(both.values()),
        "files": [],
    }
    (bag / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": joined}))
    return bag


def file_of(bag: Path, suffix: str) -> Path:
    (file,) = bag.glob(f"*{suffix}")
    return file


def without_metadata(bag: Path) -> Path:
    (bag / "metadata.yaml").unlink()
    return bag


def write_lz4(folder: Path, rows: Rows) -> Path:
    """As rosbag2's preset for fast compression: chunks of MCAP compressed with LZ4."""
    file = folder / "bag.mcap"
    with file.open("wb") as stream:
        writer = McapWriter(stream, chunk_size=1000, compression=CompressionType.LZ4)
        writer.start(profile="ros2")
        channels: dict[str, int] = {}
        for topic, kind, time, message in rows:
            if topic not in channels:
                schema = writer.register_schema(kind, "ros2msg", TYPES.generate_msgdef(kind, ros_version=2)[0].encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], time, bytes(TYPES.serialize_cdr(message, kind)), time)
        writer.finish()
    return file


MCAP, SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3
FORMS: dict[str, Callable[[Path, Rows], Path]] = {
    "mcap": lambda folder, rows: write_ros2(folder, rows, MCAP),
    "sqlite3": lambda folder, rows: write_ros2(folder, rows, SQLITE),
    "mcap file": lambda folder, rows: file_of(write_ros2(folder, rows, MCAP), ".mcap"),
    "db3 file": lambda folder, rows: file_of(write_ros2(folder, rows, SQLITE), ".db3"),
    "mcap without metadata": lambda folder, rows: without_metadata(split(folder, rows, MCAP)),
    "sqlite3 without metadata": lambda folder, rows: without_metadata(split(folder, rows, SQLITE)),
    "mcap split": lambda folder, rows: split(folder, rows, MCAP),
    "sqlite3 split": lambda folder, rows: split(folder, rows, SQLITE),
    "sqlite3 file zstd": lambda folder, rows: write_ros2(folder, rows, SQLITE, CompressionMode.FILE),
    "sqlite3 message zstd": lambda folder, rows: write_ros2(folder, rows, SQLITE, CompressionMode.MESSAGE),
    "mcap file zstd": lambda folder, rows: write_ros2(folder, rows, MCAP, CompressionMode.FILE),
    "mcap message zstd": lambda folder, rows: write_ros2(folder, rows, MCAP, CompressionMode.MESSAGE),
    "mcap message zstd without metadata": lambda folder, rows: without_metadata(write_ros2(folder, rows, MCAP, CompressionMode.MESSAGE)),
    "mcap storage zstd": lambda folder, rows: write_ros2(folder, rows, MCAP, CompressionMode.STORAGE),
    "mcap lz4": write_lz4,
    "ros1": write_ros1,
    "ros1 bz2": lambda folder, rows: write_ros1(folder, rows, rosbag1.Writer.CompressionFormat.BZ2),
    "ros1 lz4": lambda folder, rows: write_ros1(folder, rows, rosbag1.Writer.CompressionFormat.LZ4),
}
