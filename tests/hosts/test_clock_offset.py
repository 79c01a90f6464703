"""A node finds out whose clock is off, and by how much."""

import json

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import TimeReference
from tt_core.clock_offsets import MAX_NAME, MAX_SOURCES
from tt_core.ros.clock_offset import PING, PONG, ClockMonitor
from tt_core.ros.convert import seconds, stamp
from tt_core.ros.diagnostics import Status, read_status

OFF = 0.050  # s


@pytest.fixture
def answer(probe):
    """answer(source, off) publishes answers like those of a node whose clock is `off` (s) from ours; returns the times asked."""
    pongs = probe.create_publisher(TimeReference, PONG, qos_profile_sensor_data)

    def answer(source, off, asker="probe"):
        asked = []

        def reply(ping):
            asked.append(seconds(ping.header.stamp))
            pong = TimeReference(time_ref=ping.header.stamp, source=source)
            pong.header.frame_id = asker
            pong.header.stamp = stamp(probe.get_clock().now().nanoseconds * 1e-9 + off)
            pongs.publish(pong)

        probe.create_subscription(TimeReference, PING, reply, qos_profile_sensor_data)
        return asked

    return answer


def test_a_node_that_stamps_answers_and_its_clock_is_right(start, probe, until):
    monitor = ClockMonitor(probe, Status(probe))
    start("tt_vision.estimate_node")
    until(lambda: monitor.worst() is not None, probe)
    worst = monitor.worst()
    assert worst.source == "estimate" and worst.least == 0.0  # on one machine, however long an answer takes


def test_a_clock_that_is_off_is_named_with_its_offset(probe, answer, until):
    statuses = []
    probe.create_subscription(DiagnosticArray, "/diagnostics", lambda m: statuses.extend(read_status(m)), 10)
    monitor = ClockMonitor(probe, Status(probe))
    answer("right", 0.0)
    answer("wrong", OFF)
    until(lambda: monitor.worst() is not None and monitor.worst().source == "wrong", probe)
    worst = monitor.worst()
    assert abs(worst.offset - OFF) <= worst.uncertainty + 1e-6 and 0.0 < worst.least <= OFF + 1e-6
    until(lambda: any(values["worst"] == "wrong" for *_, values in statuses), probe)
    values = next(values for *_, values in statuses if values["worst"] == "wrong")
    assert float(values["least_ms"]) > 0.0 and "wrong" in json.loads(values["offset_and_uncertainty_ms"])


def test_answers_that_are_none_are_not_heard(probe, answer, until):
    monitor = ClockMonitor(probe, Status(probe))
    asked = answer("other", OFF, asker="somebody")  # not for us
    answer("x" * (MAX_NAME + 1), OFF)
    answer("y" * 5000, OFF)  # larger than any answer
    invented = TimeReference(source="invented")  # to no question
    invented.header.frame_id = "probe"
    pongs = probe.create_publisher(TimeReference, PONG, qos_profile_sensor_data)
    until(lambda: pongs.publish(invented) or len(asked) > 3, probe)
    assert monitor.worst() is None
    for number in range(2 * MAX_SOURCES):
        answer(f"node {number}", 0.0)
    until(lambda: len(monitor._offsets.all(monitor._now())) == MAX_SOURCES, probe)
    count = len(asked)
    until(lambda: len(asked) > count + 2, probe)
    assert len(monitor._offsets.all(monitor._now())) == MAX_SOURCES


def test_with_simulated_time_nothing_is_asked(probe):
    probe.set_parameters([Parameter("use_sim_time", value=True)])
    monitor = ClockMonitor(probe, Status(probe))
    assert monitor.worst() is None and probe.count_publishers(PING) == 0
