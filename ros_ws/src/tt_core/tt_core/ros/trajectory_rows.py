"""The points of a trajectory of one joint as arrays, and the bytes of its message, trajectory_msgs/MultiDOFJointTrajectory.

rclpy makes eight Python objects for each point of such a message. A list of 40 strokes then takes 1 ms to write and 1 ms to read. But if
each point has one transform, one velocity and no acceleration, all points have the same size in the serialized message, so numpy reads and
writes them as one table. The format is that of every ROS 2 middleware: CDR (OMG Common Data Representation), little endian.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time

from ..states import Array

COUNT = struct.Struct("<I")
LITTLE_ENDIAN = 0, 1  # first bytes of a message
FRAME = b"table\0"
POINT = np.dtype(  # a point from its transform on, to the number of transforms of the next point
    [
        ("translation", "<f8", 3),
        ("rotation", "<f8", 4),
        ("velocity_count", "<u4"),
        ("padding", "<u4"),
        ("linear", "<f8", 3),
        ("angular", "<f8", 3),
        ("acceleration_count", "<u4"),
        ("sec", "<i4"),
        ("nanosec", "<u4"),
        ("transform_count", "<u4"),
    ]
)


class TrajectoryRows(NamedTuple):
    """The points of a trajectory of one joint, n of them, as they are in its message.

    Attributes:
        stamp: Reference of `after`.
        after: (n,) s, time_from_start.
        translations: (n, 3) m.
        rotations: (n, 4) quaternions x, y, z, w.
        linear: (n, 3) m/s, linear velocities.
        angular: (n, 3) rad/s, angular velocities.
    """

    stamp: Time
    after: Array
    translations: Array
    rotations: Array
    linear: Array
    angular: Array


@cache
def _start(joint: str) -> tuple[struct.Struct, tuple[object, ...]]:
    """Return the layout of a trajectory in `table` up to the number of its points, and what is between the stamp and that number.

    Args:
        joint: Name of its only joint.
    """
    name = joint.encode() + b"\0"
    return struct.Struct(f"<BBxxiII{len(FRAME)}sxxII{len(name)}s{-len(name) % 4}xI"), (len(FRAME), FRAME, 1, len(name), name)


def rows_to_bytes(joint: str, rows: TrajectoryRows) -> bytes:
    """Return the serialized message of a trajectory in `table`.

    Args:
        joint: Name of its joint. Its length must be one for which the points begin at a multiple of 8 bytes, as for `ball` and `racket`.
        rows: Its points.
    """
    count, (layout, fixed) = len(rows.after), _start(joint)
    start = layout.pack(*LITTLE_ENDIAN, rows.stamp.sec, rows.stamp.nanosec, *fixed, count)
    if not count:
        return start
    points = np.zeros(count, POINT)
    points["translation"], points["rotation"] = rows.translations, rows.rotations
    points["linear"], points["angular"] = rows.linear, rows.angular
    points["velocity_count"] = points["transform_count"] = 1
    points["sec"], points["nanosec"] = np.divmod(np.rint(rows.after * 1e9).astype(np.int64), 10**9)
    first = COUNT.pack(1) + bytes(COUNT.size)  # number of transforms of the first point, and padding to a multiple of 8 bytes
    return start + first + points.tobytes()[: -COUNT.size]


def rows_from_bytes(joint: str, data: bytes) -> TrajectoryRows | None:
    """Read the serialized message of a trajectory in `table`. Numbers are not checked.

    Args:
        joint: Name of its joint, see `rows_to_bytes`.
        data: The message.

    Returns:
        The points; None if the message is not little endian CDR, or is a trajectory of other joints, in another frame, without points, or
        with points that do not have exactly one transform, one velocity and no acceleration. rclpy can read such messages.
    """
    layout, wanted = _start(joint)
    if len(data) < layout.size + 2 * COUNT.size:
        return None
    *endian, sec, nanosec, length, frame, joints, size, name, count = layout.unpack_from(data)
    if tuple(endian) != LITTLE_ENDIAN or (length, frame, joints, size, name) != wanted:
        return None
    if len(data) != layout.size + COUNT.size + POINT.itemsize * count:
        return None
    first, points = COUNT.unpack_from(data, layout.size), np.frombuffer(data[layout.size + 2 * COUNT.size :] + COUNT.pack(1), POINT)
    one = (points["transform_count"] == 1) & (points["velocity_count"] == 1) & (points["acceleration_count"] == 0)
    if first != (1,) or not one.all():
        return None
    after = points["sec"] + 1e-9 * points["nanosec"]
    numbers = (points[name] for name in ("translation", "rotation", "linear", "angular"))
    return TrajectoryRows(Time(sec=sec, nanosec=nanosec), after, *numbers)
