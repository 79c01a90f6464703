"""What goes over the wire is what is recorded and what is played again."""

import errno
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import rclpy
import yaml
from bagforms import FORMS, TYPES
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point
from mcap.reader import make_reader
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from refusals import check_named
from rosbags.interfaces import QosDurability, QosReliability
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from tt_core.ros.bags import Bag
from tt_core.ros.diagnostics import read_status
from tt_core.ros.qos import RELIABLE
from tt_tools.describe import describe_bag
from tt_tools.record import DiskFailure, Recording
from tt_tools.record_node import offered_qos
from tt_tools.reindex import reindex

BEST_EFFORT = QoSProfile(depth=64, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
START = 1_700_000_000_000_000_000  # ns


def contents(bag):
    """Messages as bytes and the offered quality of service, by topic."""
    with Bag(bag) as reader:
        found = {topic.name: [] for topic in reader.topics}
        for message in reader.messages():
            found[message.topic].append(message.data)
        return found, {topic.name: topic.offered for topic in reader.topics}


def test_it_records_all_that_is_offered(start, probe, until, tmp_path):
    latched = probe.create_publisher(Point, "/latched", LATCHED)
    latched.publish(Point(x=7.0))  # before anybody listens
    sensor = probe.create_publisher(Point, "/sensor", BEST_EFFORT)
    reliable = probe.create_publisher(Point, "/reliable", 1000)
    excluded = probe.create_publisher(Point, "/excluded", 10)
    bag = tmp_path / "bag"
    recorder = start(
        "tt_tools.record_node", "--ros-args", "-p", f"output:={bag}", "-p", "exclude:=^/(excluded|rosout|parameter_events|diagnostics)$"
    )
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
    assert recorder.wait(timeout=120) == 0

    found, offered = contents(bag)
    assert set(found) == {"/latched", "/sensor", "/reliable"}
    assert found["/reliable"] == [serialize_message(message) for message in messages]
    assert found["/latched"] == [serialize_message(Point(x=7.0))]
    assert set(found["/sensor"]) <= set(found["/reliable"])  # some may be lost
    assert offered["/sensor"][0].reliability is QosReliability.BEST_EFFORT
    assert offered["/latched"][0].durability is QosDurability.TRANSIENT_LOCAL
    topics = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]["topics_with_message_count"]
    assert {topic["topic_metadata"]["type_description_hash"] for topic in topics} == {str(info.topic_type_hash)}


def test_it_records_what_matches_and_attaches_what_the_graph_is(start, probe, until, tmp_path):
    probe.declare_parameter("speed.scale", 0.5)
    latched = probe.create_publisher(String, "/robot_description", LATCHED)
    latched.publish(String(data="<robot/>"))
    outputs = [probe.create_publisher(Point, f"/{name}", 10) for name in ("ball_a", "ball_b", "joint", "_hidden")]
    bag = tmp_path / "bag"
    options = [
        "output:=" + str(bag),
        "topics:=[/joint, /robot_description]",
        "regex:=ball",
        "exclude_topics:=[/ball_b]",
        "compression:=zstd",
        f"layout:={tmp_path / 'layout.json'}",
    ]
    (tmp_path / "layout.json").write_text('{"tabs": "ä"}')
    recorder = start("tt_tools.record_node", "--ros-args", *(word for option in options for word in ("-p", option)))
    names = ("parameters/probe.yaml", "revision.txt", "robot_arm_urdf.urdf", "layout.json")
    until(lambda: outputs[0].get_subscription_count() and outputs[2].get_subscription_count(), probe)
    until(lambda: all(name.encode() in (bag / "bag.mcap").read_bytes() for name in names) or outputs[0].publish(Point()), probe)
    recorder.send_signal(signal.SIGINT)
    assert recorder.wait(timeout=120) == 0
    found = describe_bag(bag)
    assert {topic.name for topic in found.topics} == {"/ball_a", "/joint", "/robot_description"}
    assert set(found.attachments) == set(names)
    with (bag / "bag.mcap").open("rb") as stream:
        texts = {attachment.name: attachment.data.decode() for attachment in make_reader(stream).iter_attachments()}
    assert yaml.safe_load(texts["parameters/probe.yaml"])["/probe"]["ros__parameters"]["speed"] == {"scale": 0.5}
    assert texts["robot_arm_urdf.urdf"] == "<robot/>" and texts["revision.txt"].strip() and texts["layout.json"] == '{"tabs": "ä"}'
    assert (bag / "bag.mcap").read_bytes().count(b"zstd") > 1


def test_an_existing_directory_is_refused(start, tmp_path):
    recorder = start("tt_tools.record_node", "--ros-args", "-p", f"output:={tmp_path}")
    assert recorder.wait(timeout=120) == 2
    check_named(recorder.stderr.read(), tmp_path)


def test_a_layout_that_cannot_be_read_is_refused_before_there_is_a_bag(start, tmp_path):
    recorder = start("tt_tools.record_node", "--ros-args", "-p", f"layout:={tmp_path / 'none.json'}", "-p", f"output:={tmp_path / 'bag'}")
    assert recorder.wait(timeout=120) == 2
    check_named(recorder.stderr.read(), tmp_path / "none.json")
    assert not (tmp_path / "bag").exists()


def test_a_killed_recorder_leaves_what_can_be_saved(start, probe, until, tmp_path):
    output = probe.create_publisher(Image, "/image", 10)
    bag = tmp_path / "bag"
    recorder = start("tt_tools.ros2", "bag", "record", "/image", "-o", str(bag))
    until(lambda: output.get_subscription_count(), probe)
    image = Image(height=100, width=1000, step=1000, encoding="mono8", data=bytes(100_000))
    until(lambda: len((bag / "bag.mcap").read_bytes().rstrip(b"\0")) > 2_000_000 or output.publish(image), probe)
    recorder.kill()
    recorder.wait(timeout=120)

    summary = reindex(bag)
    assert summary.counts["/image"] >= 11  # a chunk of 1 MB
    saved = [deserialize_message(data, Image) for data in contents(bag)[0]["/image"]]  # the padding of CDR is arbitrary
    assert saved == [image] * summary.counts["/image"]


def image(size=100_000):
    return Image(height=100, width=size // 100, step=size // 100, encoding="mono8", data=bytes(size))


def test_a_recorder_that_hangs_while_it_is_destroyed_leaves_a_whole_bag(start, probe, until, monkeypatch, tmp_path):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=":")
    sender, bag = probe.create_publisher(Point, "/sensor", RELIABLE), tmp_path / "bag"
    recorder = start("hanging_recorder", "--ros-args", "-p", f"output:={bag}")
    until(lambda: sender.get_subscription_count(), probe)
    sender.publish(Point(x=1.0))
    until(lambda: sender.wait_for_all_acked(rclpy.duration.Duration(seconds=1)), probe)
    recorder.send_signal(signal.SIGINT)
    assert recorder.wait(timeout=120) == -signal.SIGINT
    assert contents(bag)[0]["/sensor"] == [serialize_message(Point(x=1.0))]


def test_a_full_disk_is_told_and_holds_nothing_up(start, probe, until, tmp_path):
    """The file of the recorder may not grow beyond 20 MB; then it may again."""
    output, statuses = probe.create_publisher(Image, "/image", 10), []
    probe.create_subscription(DiagnosticArray, "/diagnostics", lambda message: statuses.extend(read_status(message)), RELIABLE)
    bag, picture = tmp_path / "bag", image(1_000_000)
    recorder = start("tt_tools.record_node", "--ros-args", "-p", f"output:={bag}", "-p", "topics:=[/image]")
    until(lambda: output.get_subscription_count(), probe)
    soft, hard = resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (20_000_000, hard))

    def dropping():
        output.publish(picture)
        full = [s.values for s in statuses if s.values.get("code") == DiskFailure.FULL.name]
        return [values for values in full if int(values.get("dropped /image", 0)) > 3]

    until(dropping, probe)
    values = dropping()[0]
    assert int(values["errno"]) == errno.EFBIG and int(values["free_bytes"]) > 0 and int(values["queued_bytes"]) >= 0
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (soft, hard))
    until(lambda: output.publish(picture) or statuses[-1].values.get("code") == "NONE", probe)
    picture.header.frame_id = "last"
    output.publish(picture)
    until(lambda: output.wait_for_all_acked(rclpy.duration.Duration(seconds=1)), probe)
    recorder.send_signal(signal.SIGINT)
    assert recorder.wait(timeout=120) == 1
    errors = recorder.stderr.read()
    assert "Traceback" not in errors
    found, _ = contents(bag)
    check_named(errors, bag, f"{len(found['/image'])} messages", "/image")
    assert len(found["/image"]) > 10
    assert deserialize_message(found["/image"][-1], Image).header.frame_id == "last"


def test_a_recorder_whose_disk_is_full_at_the_start_says_so(start, tmp_path):
    recorder = start("tt_tools.record_node", "--ros-args", "-p", f"output:={tmp_path / 'bag'}", "-p", f"reserve_bytes:={2**40}")
    assert recorder.wait(timeout=120) == 2
    errors = recorder.stderr.read()
    check_named(errors, tmp_path / "bag", 2**40)
    assert "Traceback" not in errors


def points(count=100):
    """Rows for a bag: count points on /old, 10 ms apart, the first of them on /latched and all on /unwanted."""
    kind = "geometry_msgs/msg/Point"
    rows = [("/latched", kind, START, TYPES.types[kind](0.0, 0.0, 0.0))]
    for i in range(count):
        rows += [(topic, kind, START + i * 10_000_000, TYPES.types[kind](float(i), 0.0, 0.0)) for topic in ("/old", "/unwanted")]
    return rows


def listen(probe, topics, qos=1000):
    """What comes on each of `topics`, as bytes."""
    got = {topic: [] for topic in topics}
    for topic, messages in got.items():
        probe.create_subscription(Point, topic, messages.append, qos, raw=True)
    return got


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

    got, latched, clock = listen(probe, ["/new", "/unwanted"]), listen(probe, ["/latched"], LATCHED), []
    probe.create_subscription(Clock, "/clock", lambda message: clock.append(Time.from_msg(message.clock).nanoseconds), 1000)
    values = {
        "bag": tmp_path / "bag",
        "clock": 100.0,
        "rate": 2.0,
        "topics": ["/latched", "/old"],
        "wait_for": ["/latched", "/new", "/clock"],
    }
    options = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    player = start("tt_tools.play_node", "--ros-args", *options, "-r", "/old:=/new")
    until(lambda: player.poll() is not None and len(got["/new"]) == len(messages), probe)
    assert player.returncode == 0
    assert got["/new"] == messages and latched["/latched"] == messages[:1] and not got["/unwanted"]
    assert clock == sorted(clock) and clock[0] == START
    assert START + 970_000_000 <= clock[-1] <= START + 990_000_001  # a tick every 20 ms of recorded time, to its end


@pytest.mark.parametrize("form", ["sqlite3", "mcap message zstd", "ros1"])
def test_other_forms_are_played_too(start, probe, until, tmp_path, form):
    bag, got = FORMS[form](tmp_path, points()), listen(probe, ["/old", "/latched", "/unwanted"])
    start("tt_tools.play_node", "--ros-args", "-p", f"bag:={bag}", "-p", "rate:=5", "-p", f"wait_for:={list(got)}")
    until(lambda: [len(messages) for messages in got.values()] == [100, 1, 100], probe)
    assert [deserialize_message(data, Point).x for data in got["/old"]] == [float(i) for i in range(100)]


def test_playback_begins_when_every_consumer_is_there(start, probe, until, tmp_path):
    """Neither the first listener nor the recorder is enough."""
    bag, early = FORMS["mcap"](tmp_path, points()), listen(probe, ["/old"])
    options = ("-p", f"bag:={bag}", "-p", "rate:=5", "-p", "wait_for:=[/old, /unwanted, /result]", "-p", "recorded:=true")
    player = start("tt_tools.play_node", "--ros-args", *options)
    until(lambda: "player" in probe.get_node_names(), probe)
    recorded = tmp_path / "again"
    recorder = start("tt_tools.record_node", "--ros-args", "-p", f"output:={recorded}")
    until(lambda: "record" in probe.get_node_names(), probe)
    late = listen(probe, ["/unwanted"])
    until(lambda: probe.count_publishers("/unwanted"), probe)
    assert not early["/old"] and player.poll() is None
    listen(probe, ["/result"])
    until(lambda: player.poll() is not None, probe)
    until(lambda: len(early["/old"]) == len(late["/unwanted"]) == 100, probe)
    recorder.send_signal(signal.SIGINT)
    assert recorder.wait(timeout=120) == 0
    assert len(contents(recorded)[0]["/unwanted"]) == 100


def test_playback_pauses_steps_seeks_and_loops(start, probe, until, tmp_path):
    bag, got = FORMS["mcap"](tmp_path, points()), listen(probe, ["/old"])["/old"]
    options = ["position:=0.5", "duration:=0.3", "loop:=true", "paused:=true", "topics:=[/old]", f"bag:={bag}"]
    player = start("tt_tools.play_node", "--ros-args", *(word for option in options for word in ("-p", option)))

    def values():
        return [round(deserialize_message(data, Point).x) for data in got]

    def call(kind, name, request):
        client = probe.create_client(kind, name)
        until(client.service_is_ready, probe)
        answer = client.call_async(request)
        until(answer.done, probe)
        return answer.result()

    until(lambda: probe.count_publishers("/old"), probe)
    until(lambda: call(Trigger, "/player/step", Trigger.Request()).success and values(), probe)
    assert values()[0] == 50  # 0.5 s after the first message
    position = Parameter("position", value=0.7).to_parameter_msg()
    assert call(SetParameters, "/player/set_parameters", SetParameters.Request(parameters=[position])).results[0].successful
    got.clear()
    until(lambda: call(Trigger, "/player/step", Trigger.Request()).success and values(), probe)
    assert values()[0] == 70
    got.clear()
    assert call(SetBool, "/player/pause", SetBool.Request(data=False)).success
    assert not call(Trigger, "/player/step", Trigger.Request()).success
    until(lambda: values().count(55) >= 2, probe)
    assert set(values()) <= set(range(50, 81)) and 80 in values()
    player.send_signal(signal.SIGINT)
    assert player.wait(timeout=120) == 0


def test_a_consumer_that_does_not_come_is_named(start, probe, until, tmp_path):
    bag = FORMS["mcap"](tmp_path, points())
    player = start("tt_tools.play_node", "--ros-args", "-p", f"bag:={bag}", "-p", "wait_for:=[/old, /result]", "-p", "patience:=0.5")
    until(lambda: player.poll() is not None, probe)
    assert player.returncode == 2
    check_named(player.stderr.read(), "/old", "/result", 0.5)


def test_the_command_plays_when_nobody_listens(start, probe, until, tmp_path):
    bag, clock = FORMS["sqlite3"](tmp_path, points(10)), []
    probe.create_subscription(Clock, "/clock", lambda message: clock.append(time.monotonic()), 1000)
    player = start("tt_tools.ros2", "bag", "play", str(bag), "--clock", "100")
    until(lambda: player.poll() is not None, probe, 90.0)
    assert player.returncode == 0
    assert clock[-1] - clock[0] < 15.0  # s, of which 0.3 to look for subscribers and 0.1 to play; it does not wait half a minute


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("after", [0.2, 0.8, 1.5])
def test_a_player_ends_at_once(ros, tmp_path, number, after):
    """Whatever it does: load, look for listeners or play."""
    bag = FORMS["mcap file zstd"](tmp_path, points(10_000))
    command = ["env", "--block-signal=INT", sys.executable, "-m", "tt_core.start", "tt_tools.ros2", "bag", "play", str(bag)]
    player = subprocess.Popen(command, env=os.environ, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    time.sleep(after)
    player.send_signal(number)
    _, errors = player.communicate(timeout=5)
    assert player.returncode in (130, -number)
    assert "Traceback" not in errors and "Error" not in errors


def test_full_shared_memory_is_told_in_one_line(ros, tmp_path):
    """In a mount namespace of its own, whose /dev/shm is full."""
    shell = ["unshare", "-m", "sh", "-c", 'mount -t tmpfs -o size=16k tmpfs /dev/shm && dd if=/dev/zero of=/dev/shm/hog; exec "$@"', "sh"]
    tried = subprocess.run([*shell, "true"], capture_output=True, text=True, check=False)
    if tried.returncode or "mount:" in tried.stderr:
        pytest.skip(f"no mount namespace can be made here: {tried.stderr.strip()}")
    node = [sys.executable, "-m", "tt_core.start", "tt_tools.record_node", "--ros-args", "-p", f"output:={tmp_path / 'bag'}"]
    done = subprocess.run([*shell, *node], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 2
    check_named(done.stderr.splitlines()[-1], "/dev/shm", 0, 65536)
