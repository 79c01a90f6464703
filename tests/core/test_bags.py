"""Every form of bag gives the same messages; what is none says why."""

import numpy as np
import pytest
from bagforms import FORMS, MCAP, ROS1, SQLITE, TYPES, split, write_ros1, write_ros2
from refusals import refused
from rosbags import rosbag1, rosbag2
from tt_core.ros.bags import Bag, BagError

START = 1_700_000_000_000_000_000  # ns


def message(kind, **fields):
    return TYPES.types[kind](**fields)


def header(i):
    stamp = message("builtin_interfaces/msg/Time", sec=5, nanosec=i * 1000)
    return message("std_msgs/msg/Header", stamp=stamp, frame_id="left_optical")


def image(i):
    data = np.full(12, i % 256, np.uint8)
    return message("sensor_msgs/msg/Image", header=header(i), height=3, width=4, encoding="mono8", is_bigendian=0, step=4, data=data)


def info(i):
    region = message("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    matrices = {"d": np.arange(5.0), "k": np.arange(9.0), "r": np.eye(3).ravel(), "p": np.arange(12.0)}
    names = {"distortion_model": "plumb_bob", "binning_x": 0, "binning_y": 0, "roi": region}
    return message("sensor_msgs/msg/CameraInfo", header=header(i), height=3, width=4, **matrices, **names)


def rows(count=10):
    found = []
    for i in range(count):
        time = START + i * 10**6
        found.append(("/image", "sensor_msgs/msg/Image", time, image(i)))
        found.append(("/latched", "sensor_msgs/msg/CameraInfo", time + 1, info(i)))
        found.append(("/point", "geometry_msgs/msg/Point", time + 2, message("geometry_msgs/msg/Point", x=float(i), y=2.0, z=3.0)))
    return found


@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_the_same_messages(tmp_path, form):
    wanted = rows()
    path = FORMS[form](tmp_path, wanted)
    with Bag(path) as bag:
        assert [(t.name, t.kind, t.count, t.refusal) for t in bag.topics] == [
            ("/image", "sensor_msgs/msg/Image", 10, ""),
            ("/latched", "sensor_msgs/msg/CameraInfo", 10, ""),
            ("/point", "geometry_msgs/msg/Point", 10, ""),
        ]
        assert (bag.count, bag.start, bag.end) == (30, wanted[0][2], wanted[-1][2])
        files = [path] if path.is_file() else [file for file in path.iterdir() if file.name != "metadata.yaml"]
        assert bag.size == sum(file.stat().st_size for file in files) > 100
        found = list(bag.messages())
        assert [(m.topic, m.kind, m.time) for m in found] == [row[:3] for row in wanted]
        for one, (_, kind, _, true) in zip(found, wanted, strict=True):
            assert bytes(TYPES.serialize_cdr(bag.decode(one), kind)) == bytes(TYPES.serialize_cdr(true, kind))
            assert bytes(TYPES.serialize_cdr(TYPES.deserialize_cdr(one.data, kind), kind)) == bytes(TYPES.serialize_cdr(true, kind))
        assert [m.topic for m in bag.messages(["/point"])] == ["/point"] * 10
        assert not list(bag.messages(["/nothing"]))


def test_a_latched_topic_of_ros1_is_transient_local(tmp_path):
    with Bag(write_ros1(tmp_path, rows())) as bag:
        durable = {topic.name: [qos.durability.name for qos in topic.offered] for topic in bag.topics}
    assert durable == {"/image": [], "/latched": ["TRANSIENT_LOCAL"], "/point": []}


def test_a_type_that_is_not_known_is_left_out_by_name(tmp_path):
    store = type(ROS1)()
    store.register({"std_msgs/msg/Own": ([], [("x", (1, ("float64", 0)))])})
    path = tmp_path / "own.bag"
    with rosbag1.Writer(path) as writer:
        topic = writer.add_connection("/own", "std_msgs/msg/Own", typestore=store)
        writer.write(topic, START, store.serialize_ros1(store.types["std_msgs/msg/Own"](1.0), "std_msgs/msg/Own"))
        point = writer.add_connection("/point", "geometry_msgs/msg/Point", typestore=ROS1)
        writer.write(point, START, ROS1.serialize_ros1(rows()[2][3], "geometry_msgs/msg/Point"))
    with Bag(path) as bag:
        assert {topic.name: bool(topic.refusal) for topic in bag.topics} == {"/own": True, "/point": False}
        assert "std_msgs/msg/Own" in bag.topics[0].refusal
        assert [m.topic for m in bag.messages()] == ["/point"]


def test_a_type_that_only_the_bag_defines_can_be_read(tmp_path):
    store = type(TYPES)()
    store.register({"my_msgs/msg/Own": ([], [("x", (1, ("float64", 0)))])})
    with rosbag2.Writer(tmp_path / "bag", version=9) as writer:
        topic = writer.add_connection("/own", "my_msgs/msg/Own", typestore=store)
        writer.write(topic, START, store.serialize_cdr(store.types["my_msgs/msg/Own"](1.5), "my_msgs/msg/Own"))
        hidden = writer.add_connection("/hidden", "my_msgs/msg/Hidden", msgdef="?", rihs01="RIHS01_0")
        writer.write(hidden, START + 1, b"\0\1\0\0")
    with Bag(tmp_path / "bag") as bag:
        own, hidden = bag.messages()
        assert bag.decode(own).x == 1.5
        with refused(BagError, "/hidden", "my_msgs/msg/Hidden"):
            bag.decode(hidden)


def test_what_is_no_bag_says_why(tmp_path):
    with refused(BagError, tmp_path / "nothing"):
        Bag(tmp_path / "nothing")
    (tmp_path / "notes.txt").write_text("no bag")
    with refused(BagError, "notes.txt", ".mcap", ".db3", ".bag"):
        Bag(tmp_path / "notes.txt")
    with refused(BagError, tmp_path, "*.mcap", "*.db3", "*.bag"):
        Bag(tmp_path)


@pytest.mark.parametrize("form", ["mcap", "mcap file", "mcap without metadata"])
def test_reindex_is_advised_for_mcap(tmp_path, form):
    path = FORMS[form](tmp_path, rows())
    file = path if path.is_file() else min(path.glob("*.mcap"))
    with file.open("r+b") as stream:
        stream.truncate(file.stat().st_size // 2)
    with refused(BagError, f"ros2 bag reindex {path}"):
        Bag(path)


@pytest.mark.parametrize("form", ["sqlite3", "db3 file", "ros1", "mcap file zstd", "sqlite3 file zstd"])
@pytest.mark.parametrize("part", [0.0, 0.3, 0.9])
def test_reindex_is_not_advised_where_it_does_not_help(tmp_path, form, part):
    path = FORMS[form](tmp_path, rows(1000))
    file = path if path.is_file() else next(file for file in path.iterdir() if file.name != "metadata.yaml")
    with file.open("r+b") as stream:
        stream.truncate(int(part * file.stat().st_size))
    with refused(BagError, path) as caught, Bag(path) as bag:
        list(bag.messages())
    assert "ros2 bag reindex" not in str(caught.value)


@pytest.mark.parametrize("plugin", [MCAP, SQLITE])
def test_a_file_that_is_missing_is_told(tmp_path, plugin):
    path = split(tmp_path, rows(), plugin)
    min(path.glob("bag_1*")).unlink()
    with refused(BagError, "bag_1"):
        Bag(path)


@pytest.mark.parametrize("seed", range(20))
def test_broken_bytes_are_an_error_and_nothing_else(tmp_path, seed):
    """Wherever a file is damaged, reading gives messages, then perhaps an error."""
    rng = np.random.default_rng(seed)
    form = ["mcap", "sqlite3", "ros1", "mcap lz4"][seed % 4]
    path = FORMS[form](tmp_path, rows(50))
    file = path if path.is_file() else next(file for file in path.iterdir() if file.name != "metadata.yaml")
    content = bytearray(file.read_bytes())
    for place in rng.integers(0, len(content), 30):
        content[place] = rng.integers(0, 256)
    file.write_bytes(content)
    try:
        with Bag(path) as bag:
            for one in bag.messages():
                bag.decode(one)
    except BagError as error:
        assert str(path) in str(error)


def test_an_empty_bag_has_no_messages(tmp_path):
    with Bag(write_ros2(tmp_path, [], MCAP)) as bag:
        assert not bag.topics and not list(bag.messages()) and bag.count == bag.start == bag.end == 0
