"""A recording reads back in every reader, whole or cut."""

import errno
import json
import resource
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from bagforms import FORMS
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from refusals import check_named, refused
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from tt_core.failures import Failure
from tt_core.ros.bags import TYPESTORE, Bag, BagError
from tt_tools import record
from tt_tools.bagfile import CHUNK, CHUNK_SHARE, BagFile, SplitRule
from tt_tools.describe import describe_bag, lines
from tt_tools.record import DiskFailure, Recording
from tt_tools.reindex import compress, reindex

POINT = TYPESTORE.types["geometry_msgs/msg/Point"]
START = 1_700_000_000_000_000_000  # ns
PERIOD = 1_000_000  # ns
ANY = QosTime(9223372036, 854775807)
LATCHED = Qos(
    QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL, ANY, ANY, QosLiveliness.AUTOMATIC, ANY, False
)


def point(i):
    return bytes(TYPESTORE.serialize_cdr(POINT(float(i), 2.0, -1.0), "geometry_msgs/msg/Point"))


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
    check_named(str(summary), tmp_path / "bag", 101, 2, 0.1)


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
    with refused(BagError, bag):
        Recording(bag)
    recording = Recording(tmp_path / "other")
    with refused(BagError, "/a", "my_msgs/msg/Own"):
        recording.add_topic("/a", "my_msgs/msg/Own", [])
    recording.close()


def test_chunks_grow_with_the_file(tmp_path):
    """A crash loses one chunk, and each chunk takes memory until the end."""
    size, count = 2**18, 320  # bytes of a message: 80 MB
    bag = BagFile(tmp_path / "bag", reserve=0)
    bag.add_topic("/point", "geometry_msgs/msg/Point", [])
    for i in range(count):
        bag.make_room(size, START + i * PERIOD)
        bag.write("/point", START + i * PERIOD, bytes(size))
    bag.close()
    with (tmp_path / "bag" / "bag.mcap").open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    for chunk in chunks:
        assert chunk.uncompressed_size <= max(CHUNK, CHUNK_SHARE * chunk.chunk_start_offset) + size + 2**12, chunk
    assert chunks[0].uncompressed_size < 2 * CHUNK < 2.4 * CHUNK < chunks[-2].uncompressed_size


@pytest.mark.parametrize("part", [0.4, 0.7, 0.99])
def test_a_cut_recording_is_saved_up_to_the_last_whole_chunk(tmp_path, part):
    bag = tmp_path / "bag"
    count, chunk = 50_000, 18_000  # a message takes 59 bytes, a chunk 1 MB
    write(bag, count)
    (file,) = bag.glob("*.mcap")
    (bag / "metadata.yaml").unlink()
    with file.open("r+b") as stream:
        stream.truncate(int(part * file.stat().st_size))
    with refused(BagError, bag):
        Bag(bag)

    summary = reindex(bag)
    saved = summary.counts["/point"]
    assert saved > part * count - chunk
    with Bag(bag) as reader:
        messages = list(reader.messages())
        offered = {topic.name: topic.offered for topic in reader.topics}
    assert [message.time for message in messages] == [START + i * PERIOD for i in range(saved)]
    assert messages[-1].data == point(saved - 1)
    assert offered["/point"] == (LATCHED,)


def test_nothing_to_save_is_told_and_left_as_it_is(tmp_path):
    bag = tmp_path / "bag"
    write(bag, 10)
    (file,) = bag.glob("*.mcap")
    with file.open("r+b") as stream:
        stream.truncate(100)
    with refused(BagError, bag):
        reindex(bag)
    assert file.stat().st_size == 100
    assert {path.name for path in bag.iterdir()} == {"bag.mcap", "metadata.yaml"}


def test_a_recording_whose_metadata_is_lost_is_saved_whole(tmp_path):
    """Split files become one, messages that were compressed one by one are unpacked."""
    for form in ("mcap without metadata", "mcap message zstd without metadata", "mcap file"):
        (folder := tmp_path / form).mkdir()
        rows = [("/point", "geometry_msgs/msg/Point", START + i * PERIOD, POINT(float(i), 2.0, -1.0)) for i in range(100)]
        path = FORMS[form](folder, rows)
        reindex(path)
        with Bag(path) as reader:
            assert [message.data for message in reader.messages()] == [point(i) for i in range(100)], form
        assert not path.is_dir() or {file.name for file in path.iterdir()} == {"bag.mcap", "metadata.yaml"}


def test_what_cannot_be_reindexed_says_so(tmp_path):
    write(tmp_path / "bag", 10)
    (tmp_path / "bag" / "bag.mcap").rename(tmp_path / "bag" / "bag.mcap.zstd")
    with refused(BagError, "bag.mcap.zstd"):
        reindex(tmp_path / "bag")
    with refused(BagError, tmp_path / "nothing"):
        reindex(tmp_path / "nothing")


@pytest.mark.parametrize("form", ["mcap", "sqlite3", "ros1"])
def test_a_description_tells_size_and_counts(tmp_path, form):
    rows = [("/point", "geometry_msgs/msg/Point", START + i * PERIOD, POINT(float(i), 2.0, -1.0)) for i in range(1001)]
    path = FORMS[form](tmp_path, rows)
    found = describe_bag(path, sizes=True)
    assert (found.start, found.end, found.files) == (START, START + 1000 * PERIOD, [file_of(path).name])
    assert (found.size, found.sizes) == (file_of(path).stat().st_size, {"/point": 1001 * len(point(0))})
    text = list(lines(found, "count"))
    assert "Topic information: Topic: /point | Type: geometry_msgs/msg/Point | Count: 1001 | Size Contribution:" in " ".join(text)
    assert f"Storage id:        {'rosbag_v1' if form == 'ros1' else form}" in text and "Duration:          1.000000000s" in text


def file_of(path):
    return path if path.is_file() else next(path.glob("bag.*"))


@pytest.mark.parametrize(("split", "least"), [(SplitRule(size=500_000), 5), (SplitRule(duration=0.01), 3), (SplitRule(500_000, 0.01), 5)])
def test_a_recording_is_split_and_reads_as_one(tmp_path, split, least):
    recording = begin(tmp_path / "bag", split=split)
    recording.attach("note.txt", "text/plain", "ä")
    for i in range(40):
        recording.add("/image", START + i * PERIOD, IMAGE)
    summary = recording.close()
    found = describe_bag(tmp_path / "bag")
    assert least <= len(found.files) == len(list((tmp_path / "bag").glob("*.mcap")))
    assert found.attachments == ["note.txt"] and summary.counts == {"/image": 40} and found.topics[0].count == 40
    if split.size:
        assert max(file.stat().st_size for file in (tmp_path / "bag").glob("*.mcap")) < split.size + 2**20 + len(IMAGE)  # and a chunk
    with Bag(tmp_path / "bag") as reader:
        assert [message.time for message in reader.messages()] == [START + i * PERIOD for i in range(40)]
    for file in (tmp_path / "bag").glob("*.mcap"):  # each stands alone
        with Bag(file) as reader:
            assert len(list(reader.messages())) == reader.count == reader.topics[0].count


@pytest.mark.parametrize("how", ["lz4", "zstd", "afterwards"])
def test_a_compressed_recording_is_smaller_and_the_same(tmp_path, how):
    recording = begin(tmp_path / "bag", compression="none" if how == "afterwards" else how)
    recording.attach("note.txt", "text/plain", "ä")
    for i in range(40):
        recording.add("/image", START + i * PERIOD, IMAGE)
    recording.close()
    if how == "afterwards":
        compress(tmp_path / "bag", "zstd")
    assert describe_bag(tmp_path / "bag").size < 100_000 and describe_bag(tmp_path / "bag").attachments == ["note.txt"]
    with Bag(tmp_path / "bag") as reader:
        assert [(message.time, message.data) for message in reader.messages()] == [(START + i * PERIOD, IMAGE) for i in range(40)]


def test_attachments_outlive_a_crash(tmp_path):
    recording = begin(tmp_path / "bag")
    recording.attach("note.txt", "text/plain", "ä")
    fill(recording, lambda: recording._bag.counts.get("/image", 0) > 30)
    recording.close()
    with (tmp_path / "bag" / "bag.mcap").open("r+b") as stream:
        stream.truncate(int(0.7 * (tmp_path / "bag" / "bag.mcap").stat().st_size))
    assert reindex(tmp_path / "bag").counts["/image"] > 10
    assert describe_bag(tmp_path / "bag").attachments == ["note.txt"]


ARRAY = TYPESTORE.types["std_msgs/msg/UInt8MultiArray"](
    TYPESTORE.types["std_msgs/msg/MultiArrayLayout"]([], 0), np.zeros(100_000, np.uint8)
)
IMAGE = bytes(TYPESTORE.serialize_cdr(ARRAY, "std_msgs/msg/UInt8MultiArray"))


def begin(directory, **bounds):
    recording = Recording(directory, **bounds)
    recording.add_topic("/image", "std_msgs/msg/UInt8MultiArray", [])
    return recording


def wait(condition, bound=20.0):
    end = time.monotonic() + bound
    while not condition():
        assert time.monotonic() < end, f"not within {bound} s"
        time.sleep(0.01)


def fill(recording, condition, first=0):
    """Add images until the condition holds; the number of the last one."""
    count = first

    def step():
        nonlocal count
        recording.add("/image", START + count * PERIOD, IMAGE)
        count += 1
        return condition()

    wait(step)
    return count


def check(bag, summary, sent):
    """What was written is read back in order, and the rest is counted in the summary and in the bag."""
    written = summary.counts["/image"]
    assert written + summary.dropped["/image"] == sent
    with Bag(bag) as reader:
        found = list(reader.messages())
        assert json.loads(reader.custom["dropped"]) == summary.dropped
    assert len(found) == written > 10
    assert [message.time for message in found] == sorted(message.time for message in found)
    assert all(message.data == IMAGE for message in found)
    assert describe_bag(bag).losses["dropped"] == summary.dropped and f"Count: {summary.dropped['/image']} because" in "".join(
        lines(describe_bag(bag))
    )


@pytest.fixture
def limit():
    """limit(bytes) lets no file of this process grow beyond it; None lifts that."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (soft if size is None else size, hard))
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_file_that_may_not_grow_is_told_and_what_was_taken_is_kept(tmp_path, limit):
    limit(3_000_000)
    recording = begin(tmp_path / "bag")
    sent = fill(recording, lambda: recording.state().dropped.get("/image", 0) > 5)
    trouble = recording.state().trouble
    assert (trouble.code, trouble.values["errno"]) == (DiskFailure.FULL, errno.EFBIG)
    summary = recording.close()
    check(tmp_path / "bag", summary, sent)
    assert 2_000_000 < summary.size < 3_000_000


def test_it_goes_on_when_there_is_room_again(tmp_path, limit):
    limit(3_000_000)
    recording = begin(tmp_path / "bag")
    sent = fill(recording, lambda: recording.state().trouble)
    limit(None)
    sent = fill(recording, lambda: not recording.state().trouble, sent)
    for _ in range(20):
        recording.add("/image", START + sent * PERIOD, IMAGE)
        sent += 1
    summary = recording.close()
    check(tmp_path / "bag", summary, sent)
    with Bag(tmp_path / "bag") as reader:
        assert reader.end == START + (sent - 1) * PERIOD


@pytest.mark.parametrize("reserve", [0, 1_000_000])
def test_a_full_disk_is_told_and_what_was_taken_is_kept(tmp_path, reserve):
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(disk)], capture_output=True, text=True, check=False)
    if mounted.returncode:
        pytest.skip(f"no small file system can be mounted here: {mounted.stderr.strip()}")
    try:
        recording = begin(disk / "bag", reserve_bytes=reserve)
        sent = fill(recording, lambda: recording.state().dropped.get("/image", 0) > 5)
        state = recording.state()
        assert state.trouble.code is DiskFailure.FULL and state.free < 4 * 2**20
        hog = disk / "hog"
        if reserve:  # somebody else takes what is left: the file can be closed all the same
            with pytest.raises(OSError), hog.open("wb", buffering=0) as stream:
                while True:
                    stream.write(bytes(4096))
        summary = recording.close()
        check(disk / "bag", summary, sent)
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_disk_that_is_full_from_the_start_is_refused(tmp_path):
    with refused(BagError, tmp_path / "bag", 2**40):
        Recording(tmp_path / "bag", reserve_bytes=2**40)


def test_a_slow_disk_is_told_and_holds_nobody_up(tmp_path, monkeypatch):
    recording, gate = begin(tmp_path / "bag", queue_bytes=4_000_000), threading.Event()
    write = recording._bag.write
    monkeypatch.setattr(recording._bag, "write", lambda *sample: gate.wait(60.0) and write(*sample))
    sent = fill(recording, lambda: recording.state().dropped.get("/image", 0) > 5)  # while the disk does nothing
    assert recording.state().trouble == Failure(DiskFailure.SLOW)
    assert recording.state().queued <= 4_000_000
    gate.set()
    wait(lambda: recording.state().queued == 0)
    wait(lambda: not recording.state().trouble)
    check(tmp_path / "bag", recording.close(), sent)


def test_one_slow_write_is_told_while_it_lasts(tmp_path, monkeypatch):
    recording, gate = begin(tmp_path / "bag"), threading.Event()
    monkeypatch.setattr(recording._bag, "make_room", lambda *_: gate.wait(60.0))
    recording.add("/image", START, IMAGE)
    start = time.monotonic()
    wait(lambda: recording.state().trouble == Failure(DiskFailure.SLOW))
    assert time.monotonic() - start >= record.SLOW_WRITE - 0.1
    gate.set()
    recording.close()


def test_a_disk_that_never_answers_is_left(tmp_path, monkeypatch):
    monkeypatch.setattr(record, "QUEUE_TIMEOUT", 0.1)
    monkeypatch.setattr(record, "CLOSE_TIMEOUT", 0.1)
    recording, gate = begin(tmp_path / "bag"), threading.Event()
    monkeypatch.setattr(recording._bag, "write", lambda *sample: gate.wait(60.0))
    fill(recording, lambda: recording.state().queued > 1_000_000)
    with refused(BagError, tmp_path / "bag", 0.2):
        recording.close()
    gate.set()


def test_what_waits_too_long_at_the_end_is_dropped_and_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(record, "QUEUE_TIMEOUT", 0.2)
    recording = begin(tmp_path / "bag")
    write = recording._bag.write
    monkeypatch.setattr(recording._bag, "write", lambda *sample: time.sleep(0.01) or write(*sample))
    for i in range(500):
        recording.add("/image", START + i * PERIOD, IMAGE)
    wait(lambda: recording._bag.counts.get("/image", 0) > 10)
    check(tmp_path / "bag", recording.close(), 500)


def test_a_disk_that_fails_is_told_and_what_was_written_can_be_saved(tmp_path, monkeypatch):
    recording = begin(tmp_path / "bag")
    fill(recording, lambda: recording._bag.counts.get("/image", 0) > 50)
    wait(lambda: not recording.state().queued)

    def fail(*sample):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(recording._bag, "write", fail)
    fill(recording, lambda: recording.state().trouble is not None)
    trouble = recording.state().trouble
    assert (trouble.code, trouble.values["errno"]) == (DiskFailure.FAILED, errno.EIO)
    wait(lambda: recording.state().dropped.get("/image", 0) > 0)
    with refused(BagError, tmp_path / "bag", "Errno 5"):
        recording.close()
    assert reindex(tmp_path / "bag").counts["/image"] >= 40


def test_a_recorder_that_is_started_again_takes_a_new_directory(tmp_path):
    from tt_tools.record_node import free_name

    names = []
    for _ in range(3):
        names.append(free_name(str(tmp_path / "bag")))
        Path(names[-1]).mkdir()
    assert [Path(name).name for name in names] == ["bag", "bag_2", "bag_3"]
