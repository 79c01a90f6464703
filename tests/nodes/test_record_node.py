"""What goes over the wire is what is recorded and what is played again."""

import signal
from contextlib import closing

import rclpy
import yaml
from geometry_msgs.msg import Point
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from rosbags.interfaces import QosDurability, QosReliability
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image
from tt_bringup.record import Recording, open_bag, reindex
from tt_bringup.record_node import offered_qos

BEST_EFFORT = QoSProfile(depth=64, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
START = 1_700_000_000_000_000_000  # ns


def contents(bag):
    """Messages as bytes and the offered quality of service, by topic."""
    with closing(open_bag(bag)) as reader:
        found = {connection.topic: [] for connection in reader.connections}
        for connection, _, data in reader.messages():
            found[connection.topic].append(bytes(data))
        return found, {connection.topic: connection.ext.offered_qos_profiles for connection in reader.connections}


def test_it_records_all_that_is_offered(start, probe, until, tmp_path):
    latched = probe.create_publisher(Point, "/latched", LATCHED)
    latched.publish(Point(x=7.0))  # before anybody listens
    sensor = probe.create_publisher(Point, "/sensor", BEST_EFFORT)
    reliable = probe.create_publisher(Point, "/reliable", 1000)
    excluded = probe.create_publisher(Point, "/excluded", 10)
    bag = tmp_path / "bag"
    recorder = start("tt_bringup.record_node", "--ros-args", "-p", f"output:={bag}", "-p", "exclude:=^/(excluded|rosout|parameter_events)$")
    until(lambda: all(output.get_subscription_count() for output in (latched, sensor, reliable)), probe)

    messages = [Point(x=float(i)) for i in range(500)]
    for message in messages:
        sensor.publish(message)
        reliable.publish(message)
    until(lambda: reliable.wait_for_all_acked(rclpy.duration.Duration(seconds=1)), probe)
    until(lambda: latched.wait_for_all_acked(rclpy.duration.Duration(seconds=1)), probe)
    (info,) = probe.get_publishers_info_by_topic("/sensor")
    assert not excluded.get_subscription_count()
    recorder.send_signal(signal.SIGINT)
    assert recorder.wait(timeout=20) == 0

    found, offered = contents(bag)
    assert set(found) == {"/latched", "/sensor", "/reliable"}
    assert found["/reliable"] == [serialize_message(message) for message in messages]
    assert found["/latched"] == [serialize_message(Point(x=7.0))]
    assert set(found["/sensor"]) <= set(found["/reliable"])  # some may be lost
    assert offered["/sensor"][0].reliability is QosReliability.BEST_EFFORT
    assert offered["/latched"][0].durability is QosDurability.TRANSIENT_LOCAL
    topics = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]["topics_with_message_count"]
    assert {topic["topic_metadata"]["type_description_hash"] for topic in topics} == {str(info.topic_type_hash)}


def test_an_existing_directory_is_refused(start, tmp_path):
    recorder = start("tt_bringup.record_node", "--ros-args", "-p", f"output:={tmp_path}")
    assert recorder.wait(timeout=20) == 2
    assert "exists already" in recorder.stderr.read()


def test_a_killed_recorder_leaves_what_can_be_saved(start, probe, until, tmp_path):
    output = probe.create_publisher(Image, "/image", 10)
    bag = tmp_path / "bag"
    recorder = start("tt_bringup.ros2", "bag", "record", "/image", "-o", str(bag))
    until(lambda: output.get_subscription_count(), probe)
    image = Image(height=100, width=1000, step=1000, encoding="mono8", data=bytes(100_000))
    until(lambda: (bag / "bag.mcap").stat().st_size > 2_000_000 or output.publish(image), probe)
    recorder.kill()
    recorder.wait(timeout=20)

    summary = reindex(bag)
    assert summary.counts["/image"] >= 11  # a chunk of 1 MB
    saved = [deserialize_message(data, Image) for data in contents(bag)[0]["/image"]]  # the padding of CDR is arbitrary
    assert saved == [image] * summary.counts["/image"]


def test_a_bag_is_played_as_it_was(start, probe, until, tmp_path):
    messages = [serialize_message(Point(x=float(i))) for i in range(100)]
    recording = Recording(tmp_path / "bag")
    recording.add_topic("/latched", "geometry_msgs/msg/Point", [offered_qos(LATCHED)])
    recording.add_topic("/old", "geometry_msgs/msg/Point", [offered_qos(QoSProfile(depth=10))])
    recording.add_topic("/unwanted", "geometry_msgs/msg/Point", [])
    recording.add("/latched", START, messages[0])
    for i, message in enumerate(messages):
        recording.add("/old", START + i * 10_000_000, message)
        recording.add("/unwanted", START + i * 10_000_000, message)
    recording.close()

    got, latched, unwanted, clock = [], [], [], []
    probe.create_subscription(Point, "/new", got.append, 1000, raw=True)
    probe.create_subscription(Point, "/latched", latched.append, LATCHED, raw=True)
    probe.create_subscription(Point, "/unwanted", unwanted.append, 1000, raw=True)
    probe.create_subscription(Clock, "/clock", lambda message: clock.append(Time.from_msg(message.clock).nanoseconds), 1000)
    options = ("--clock", "100", "--rate", "2", "--topics", "/latched", "/old", "--remap", "/old:=/new")
    player = start("tt_bringup.ros2", "bag", "play", str(tmp_path / "bag"), *options)
    until(lambda: player.poll() is not None and len(got) == len(messages), probe)
    assert player.returncode == 0
    assert got == messages and latched == messages[:1] and not unwanted
    assert clock == sorted(clock) and clock[0] == START
    assert START + 970_000_000 <= clock[-1] <= START + 990_000_001  # a tick every 20 ms of recorded time, to its end
