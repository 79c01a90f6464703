"""A recording reads back in every reader, whole or cut."""

from contextlib import closing

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from tt_bringup.record import TYPES, BagError, Recording, open_bag, reindex

POINT = TYPES.types["geometry_msgs/msg/Point"]
START = 1_700_000_000_000_000_000  # ns
PERIOD = 1_000_000  # ns
ANY = QosTime(9223372036, 854775807)
LATCHED = Qos(
    QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL, ANY, ANY, QosLiveliness.AUTOMATIC, ANY, False
)


def point(i):
    return bytes(TYPES.serialize_cdr(POINT(float(i), 2.0, -1.0), "geometry_msgs/msg/Point"))


def write(directory, count):
    recording = Recording(directory)
    recording.add_topic("/point", "geometry_msgs/msg/Point", [LATCHED])
    recording.add_topic("/silent", "sensor_msgs/msg/Image", [])
    for i in range(count):
        recording.add("/point", START + i * PERIOD, point(i))
    return recording.close()


@pytest.fixture
def bag(tmp_path):
    write(tmp_path / "bag", 100)
    return tmp_path / "bag"


def test_the_summary_tells_what_there_is(tmp_path):
    summary = write(tmp_path / "bag", 101)
    assert summary.counts == {"/point": 101, "/silent": 0}
    assert summary.duration == pytest.approx(0.1)
    assert "101 messages on 2 topics in 0.1 s" in str(summary)


def test_it_reads_with_rosbags(bag):
    with AnyReader([bag]) as reader:
        found = [(time, reader.deserialize(data, connection.msgtype).x) for connection, time, data in reader.messages()]
    assert found == [(START + i * PERIOD, float(i)) for i in range(100)]


def test_it_reads_with_mcap(bag):
    (file,) = bag.glob("*.mcap")
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert reader.get_summary().statistics.message_count == 100
        found = [(message.log_time, decoded.x) for _, _, message, decoded in reader.iter_decoded_messages()]
    assert found == [(START + i * PERIOD, float(i)) for i in range(100)]


def test_the_metadata_is_that_of_rosbag2(bag):
    """The keys of version 9, rosbag2_storage 0.26."""
    information = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert information["version"] == 9
    assert information["storage_identifier"] == "mcap"
    assert [(bag / path).is_file() for path in information["relative_file_paths"]] == [True]
    assert information["starting_time"]["nanoseconds_since_epoch"] == START
    assert information["duration"]["nanoseconds"] == 99 * PERIOD
    assert information["message_count"] == 100
    topics = {topic["topic_metadata"]["name"]: topic for topic in information["topics_with_message_count"]}
    assert topics["/point"]["message_count"] == 100 and topics["/silent"]["message_count"] == 0
    point = topics["/point"]["topic_metadata"]
    assert point["type"] == "geometry_msgs/msg/Point" and point["serialization_format"] == "cdr"
    # by REP-2011; tests/nodes/test_record_node.py compares with the middleware
    assert point["type_description_hash"].startswith("RIHS01_6963084842a9b04494d6b2941d11444708d892da2f4b09843b9c43f42a7f6881")
    assert point["offered_qos_profiles"][0]["reliability"] == "reliable"
    assert point["offered_qos_profiles"][0]["durability"] == "transient_local"


def test_an_existing_directory_and_an_unknown_type_are_refused(bag, tmp_path):
    with pytest.raises(BagError, match="exists"):
        Recording(bag)
    recording = Recording(tmp_path / "other")
    with pytest.raises(BagError, match="/a has the unknown type my_msgs/msg/Own"):
        recording.add_topic("/a", "my_msgs/msg/Own", [])
    recording.close()


@pytest.mark.parametrize("part", [0.4, 0.7, 0.99])
def test_a_cut_recording_is_saved_up_to_the_last_whole_chunk(tmp_path, part):
    bag = tmp_path / "bag"
    count, chunk = 50_000, 18_000  # a message takes 59 bytes, a chunk 1 MB
    write(bag, count)
    (file,) = bag.glob("*.mcap")
    (bag / "metadata.yaml").unlink()
    with file.open("r+b") as stream:
        stream.truncate(int(part * file.stat().st_size))
    with pytest.raises(BagError, match="ros2 bag reindex"):
        open_bag(bag)

    summary = reindex(bag)
    saved = summary.counts["/point"]
    assert saved > part * count - chunk
    with closing(open_bag(bag)) as reader:
        messages = list(reader.messages())
        offered = {connection.topic: connection.ext.offered_qos_profiles for connection in reader.connections}
    assert [time for _, time, _ in messages] == [START + i * PERIOD for i in range(saved)]
    assert bytes(messages[-1][2]) == point(saved - 1)
    assert offered["/point"] == [LATCHED]


def test_nothing_to_save_is_told_and_left_as_it_is(tmp_path):
    bag = tmp_path / "bag"
    write(bag, 10)
    (file,) = bag.glob("*.mcap")
    with file.open("r+b") as stream:
        stream.truncate(100)
    with pytest.raises(BagError, match="no whole chunk"):
        reindex(bag)
    assert file.stat().st_size == 100
    assert {path.name for path in bag.iterdir()} == {"bag.mcap", "metadata.yaml"}
