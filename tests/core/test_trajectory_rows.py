"""`rows_from_bytes` reads each message as rclpy does, and rclpy reads what `rows_to_bytes` has written."""

from __future__ import annotations

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Quaternion, Transform, Twist, Vector3
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint
from tt_core.errors import BadMessage, MessageFailure
from tt_core.ros.convert import path_from_bytes, path_from_message, path_to_bytes, stamp, strokes_from_bytes, strokes_to_bytes
from tt_core.ros.trajectory_rows import TrajectoryRows, rows_from_bytes, rows_to_bytes
from tt_core.states import BallPath, RacketState

numbers = st.floats(-100.0, 100.0)


def vector() -> st.SearchStrategy[Vector3]:
    return st.builds(Vector3, x=numbers, y=numbers, z=numbers)


def points(most: int) -> st.SearchStrategy[MultiDOFJointTrajectoryPoint]:
    return st.builds(
        MultiDOFJointTrajectoryPoint,
        transforms=st.tuples(st.builds(Transform, translation=vector(), rotation=st.builds(Quaternion, x=numbers, w=numbers))).map(list),
        velocities=st.tuples(st.builds(Twist, linear=vector(), angular=vector())).map(list),
        time_from_start=st.builds(Duration, sec=st.integers(-most, most), nanosec=st.integers(0, 10**9 - 1)),
    )


def trajectory(joint: str, points: list[MultiDOFJointTrajectoryPoint], frame: str = "table") -> MultiDOFJointTrajectory:
    message = MultiDOFJointTrajectory(joint_names=[joint], points=points)
    message.header.stamp, message.header.frame_id = stamp(12.345678901), frame
    return message


@given(joint=st.sampled_from(["ball", "racket"]), points=st.lists(points(2**31 - 1), min_size=1, max_size=5))
def test_the_rows_of_a_message_are_its_numbers(joint: str, points: list[MultiDOFJointTrajectoryPoint]) -> None:
    message = trajectory(joint, points)
    rows = rows_from_bytes(joint, serialize_message(message))
    assert rows is not None
    assert rows.stamp == message.header.stamp
    for point, after, place, turn, velocity, spin in zip(points, *rows[1:], strict=True):
        transform, twist = point.transforms[0], point.velocities[0]
        assert after == point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
        assert place.tolist() == [transform.translation.x, transform.translation.y, transform.translation.z]
        assert turn.tolist() == [transform.rotation.x, transform.rotation.y, transform.rotation.z, transform.rotation.w]
        assert velocity.tolist() == [twist.linear.x, twist.linear.y, twist.linear.z]
        assert spin.tolist() == [twist.angular.x, twist.angular.y, twist.angular.z]


@given(joint=st.sampled_from(["ball", "racket"]), points=st.lists(points(100), max_size=5))
def test_what_is_written_is_what_rclpy_writes(joint: str, points: list[MultiDOFJointTrajectoryPoint]) -> None:
    wanted = trajectory(joint, points)
    rows = rows_from_bytes(joint, serialize_message(wanted)) if points else TrajectoryRows(wanted.header.stamp, *np.empty((5, 0)))
    assert rows is not None
    assert deserialize_message(rows_to_bytes(joint, rows), MultiDOFJointTrajectory) == wanted


def path(count: int) -> BallPath:
    times = 5.0 + 0.01 * np.arange(count)
    rows = np.random.default_rng(count).normal(size=(3, count, 3))
    return BallPath(times, *rows)


CHANGES = "acceleration", "two transforms", "no velocity", "other frame", "other joint", "no point", "big endian"


@pytest.mark.parametrize("change", CHANGES)
def test_a_message_of_another_form_is_left_to_rclpy(change: str) -> None:
    message = deserialize_message(path_to_bytes(path(3)), MultiDOFJointTrajectory)
    match change:
        case "acceleration":
            message.points[1].accelerations = [Twist()]
        case "two transforms":
            message.points[0].transforms *= 2
        case "no velocity":
            message.points[2].velocities = []
        case "other frame":
            message.header.frame_id = "world"
        case "other joint":
            message.joint_names = ["balls"]
        case "no point":
            message.points = []
    data = serialize_message(message)
    if change == "big endian":
        data = b"\0\0" + data[2:]
    assert rows_from_bytes("ball", data) is None
    if change == "acceleration":  # nobody needs it, and it does no harm
        assert path_from_bytes(data).positions.tolist() == path_from_message(message).positions.tolist()


@given(cut=st.integers(0, 3 * 128 + 47))
def test_a_part_of_a_message_is_none(cut: int) -> None:
    assert rows_from_bytes("ball", path_to_bytes(path(3))[:cut]) is None


def test_a_message_of_another_form_is_refused_with_its_reason() -> None:
    message = deserialize_message(path_to_bytes(path(3)), MultiDOFJointTrajectory)
    message.points[0].velocities = []
    with pytest.raises(BadMessage) as refusal:
        path_from_bytes(serialize_message(message))
    assert refusal.value.failure.code is MessageFailure.INCOMPLETE_POINT


@given(alpha=st.floats(-1.5, 1.5), beta=st.floats(-math.pi, math.pi))
def test_strokes_come_back_as_they_were(alpha: float, beta: float) -> None:
    sent = [RacketState(6.0 + i, [0.1, 0.2, 0.3 + i], [1.0, 2.0, 3.0], alpha, beta) for i in range(2)]
    time, rackets = strokes_from_bytes(strokes_to_bytes(sent, 5.5))
    assert time == 5.5
    for one, other in zip(sent, rackets, strict=True):
        assert other.time == pytest.approx(one.time, abs=1e-9)  # a stamp has nanoseconds
        assert other.position.tolist() == one.position.tolist()
        assert other.velocity.tolist() == one.velocity.tolist()
        assert other.rotation == pytest.approx(one.rotation, abs=1e-12)  # some roundings of double precision
