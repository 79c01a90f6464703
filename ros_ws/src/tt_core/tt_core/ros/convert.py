"""Messages to states and back: the only place that does it. Every *_from_message raises TtError for a message that breaks its promise.

What leaves hundreds of times a second takes a `message` to fill again, one that the same function has made.
"""

from __future__ import annotations

import array
import itertools
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, PointStamped, Transform, Twist, Vector3
from nav_msgs.msg import Odometry
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image, JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint, MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from ..errors import BadMessage, BadShape, check_array
from ..states import Array, BallPath, BallState, Bounce, RacketState, ReturnGoal

UNKNOWN = 1e6  # variance of what is not known


def stamp(time: float, message: Time | None = None) -> Time:
    """time: s."""
    message = message or Time()
    message.sec, message.nanosec = divmod(round(time * 1e9), 10**9)
    return message


def seconds(message: Time | Duration) -> float:
    return message.sec + message.nanosec * 1e-9


def _duration(time: float) -> Duration:
    nanoseconds = round(time * 1e9)
    return Duration(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def _vector3(v: Sequence[float] | Array) -> Vector3:
    return Vector3(x=float(v[0]), y=float(v[1]), z=float(v[2]))


def _numbers(v: Vector3 | Point) -> Array:
    return np.array([v.x, v.y, v.z])


def _fill(message: Vector3 | Point, v: Array) -> None:
    message.x, message.y, message.z = v.tolist()


def ball_to_message(ball: BallState, message: Odometry | None = None) -> Odometry:
    """Odometry has no room for the covariance of position with velocity and spin: it is left out. message: its covariance stays."""
    if message is None:
        message = Odometry(child_frame_id="ball")
        message.header.frame_id = "table"
        covariance = np.diag([UNKNOWN] * 9) if ball.covariance is None else ball.covariance
        in_pose = np.zeros((6, 6))
        in_pose[:3, :3] = covariance[:3, :3]
        message.pose.covariance, message.twist.covariance = in_pose.ravel(), covariance[3:, 3:].ravel()
    stamp(ball.time, message.header.stamp)
    _fill(message.pose.pose.position, ball.position)
    _fill(message.twist.twist.linear, ball.velocity)
    _fill(message.twist.twist.angular, ball.spin)
    return message


def ball_from_message(message: Odometry) -> BallState:
    if message.header.frame_id != "table" or message.child_frame_id != "ball":
        raise BadMessage(f"frames table -> ball expected, got {message.header.frame_id!r} -> {message.child_frame_id!r}")
    position, twist = message.pose.pose.position, message.twist.twist
    covariance = np.zeros((9, 9))
    covariance[:3, :3] = np.reshape(message.pose.covariance, (6, 6))[:3, :3]
    covariance[3:, 3:] = np.reshape(message.twist.covariance, (6, 6))
    known = (np.diag(covariance) < UNKNOWN).any()
    state = _numbers(position), _numbers(twist.linear), _numbers(twist.angular)
    return BallState(seconds(message.header.stamp), *state, covariance if known else None)


def _trajectory(time: float, joint: str, points: list[MultiDOFJointTrajectoryPoint]) -> MultiDOFJointTrajectory:
    message = MultiDOFJointTrajectory(joint_names=[joint], points=points)
    message.header.stamp, message.header.frame_id = stamp(time), "table"
    return message


def _point(after: float, position: Array, velocity: Array, spin: Sequence[float] | Array) -> MultiDOFJointTrajectoryPoint:
    return MultiDOFJointTrajectoryPoint(
        transforms=[Transform(translation=_vector3(position))],
        velocities=[Twist(linear=_vector3(velocity), angular=_vector3(spin))],
        time_from_start=_duration(after),
    )


def _check(message: MultiDOFJointTrajectory, joint: str, least: int) -> None:
    if list(message.joint_names) != [joint] or len(message.points) < least:
        raise BadMessage(f"joint [{joint}] and {least} points expected, got {list(message.joint_names)} and {len(message.points)}")
    if any(len(p.transforms) != 1 or len(p.velocities) != 1 for p in message.points):
        raise BadMessage("each point must hold one transform and one velocity")
    if message.header.frame_id != "table":
        raise BadMessage(f"frame table expected, got {message.header.frame_id!r}")


def path_to_message(path: BallPath) -> MultiDOFJointTrajectory:
    start = path.times[0]
    points = [_point(t - start, p, v, w) for t, p, v, w in zip(path.times, path.positions, path.velocities, path.spins, strict=True)]
    return _trajectory(start, "ball", points)


def path_from_message(message: MultiDOFJointTrajectory) -> BallPath:
    """Two points of one time are a bounce."""
    _check(message, "ball", 1)
    start = seconds(message.header.stamp)
    states = [
        BallState(
            start + seconds(p.time_from_start),
            _numbers(p.transforms[0].translation),
            _numbers(p.velocities[0].linear),
            _numbers(p.velocities[0].angular),
        )
        for p in message.points
    ]
    bounces = tuple(Bounce(a, b) for a, b in itertools.pairwise(states) if a.time == b.time)
    rows = np.array([s.vector for s in states])
    return BallPath(np.array([s.time for s in states]), rows[:, :3], rows[:, 3:6], rows[:, 6:], bounces)


def goal_to_message(goal: ReturnGoal, time: float = 0.0) -> MultiDOFJointTrajectory:
    """time: s, when the goal was set."""
    point = _point(goal.flight_time, np.append(goal.landing, 0.0), np.zeros(3), [0.0, goal.spin_y, goal.spin_z])
    return _trajectory(time, "ball", [point])


def goal_from_message(message: MultiDOFJointTrajectory) -> ReturnGoal:
    _check(message, "ball", 1)
    point = message.points[0]
    landing, spin = point.transforms[0].translation, point.velocities[0].angular
    return ReturnGoal(np.array([landing.x, landing.y]), seconds(point.time_from_start), spin.y, spin.z)


def strokes_to_message(rackets: Sequence[RacketState], time: float) -> MultiDOFJointTrajectory:
    """Candidates in order of preference; time: s, of the last frame that they rest on."""
    points = []
    for racket in rackets:
        point = _point(racket.time - time, racket.position, racket.velocity, np.zeros(3))
        q = point.transforms[0].rotation
        q.x, q.y, q.z, q.w = Rotation.from_matrix(racket.rotation).as_quat()
        points.append(point)
    return _trajectory(time, "racket", points)


def strokes_from_message(message: MultiDOFJointTrajectory) -> list[RacketState]:
    _check(message, "racket", 0)
    start = seconds(message.header.stamp)
    rackets = []
    for point in message.points:
        q = point.transforms[0].rotation
        if abs(q.x**2 + q.y**2 + q.z**2 + q.w**2 - 1.0) > 1e-3:
            raise BadMessage(f"quaternion of length 1 expected, got {q.x}, {q.y}, {q.z}, {q.w}")
        normal = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()[:, 2]
        position, velocity = _numbers(point.transforms[0].translation), _numbers(point.velocities[0].linear)
        rackets.append(RacketState.facing(start + seconds(point.time_from_start), position, velocity, normal))
    return rackets


def pixel_to_message(time: float, pixel: Sequence[float] | Array, frame: str) -> PointStamped:
    """pixel: (2,) where a camera that tracks on board saw the ball's centre at `time` (s), the middle of the exposure."""
    message = PointStamped(point=Point(x=float(pixel[0]), y=float(pixel[1])))
    message.header.stamp, message.header.frame_id = stamp(time), frame
    return message


def pixel_from_message(message: PointStamped) -> tuple[float, Array]:
    """Time (s) and pixel (2,)."""
    return seconds(message.header.stamp), check_array("pixel", [message.point.x, message.point.y], (2,))


def racket_to_message(time: float, position: Array, rotation: Array, velocity: Array, message: Odometry | None = None) -> Odometry:
    """position: (3,) m, face centre. rotation: (3, 3) racket to table. velocity: (3,) m/s in `table`, as for the ball."""
    if message is None:
        message = Odometry(child_frame_id="racket")
        message.header.frame_id = "table"
    stamp(time, message.header.stamp)
    _fill(message.pose.pose.position, position)
    q = message.pose.pose.orientation
    q.x, q.y, q.z, q.w = Rotation.from_matrix(rotation).as_quat()
    _fill(message.twist.twist.linear, velocity)
    return message


def camera_to_message(width: int, height: int, matrix: Array, distortion: Array | None, frame: str, time: float = 0.0) -> CameraInfo:
    """matrix: (3, 3) K in pixels. distortion: (5,) in the order of OpenCV, or None. frame: e.g. left_optical."""
    d = np.zeros(5) if distortion is None else distortion
    message = CameraInfo(width=width, height=height, distortion_model="plumb_bob", d=d.tolist(), k=matrix.ravel())
    message.r, message.p = np.eye(3).ravel(), np.column_stack([matrix, np.zeros(3)]).ravel()
    message.header.stamp, message.header.frame_id = stamp(time), frame
    return message


def camera_from_message(message: CameraInfo) -> tuple[int, int, Array, Array]:
    """(width, height, (3, 3) K in pixels, (5,) distortion in OpenCV order)."""
    if message.distortion_model not in ("", "plumb_bob") or len(message.d) > 5:
        raise BadMessage(f"distortion model {message.distortion_model!r} with {len(message.d)} numbers is not plumb_bob")
    if message.k[0] <= 0.0 or message.k[4] <= 0.0:
        raise BadMessage(f"camera of {message.width} x {message.height} pixels is not calibrated: K = {message.k}")
    return message.width, message.height, check_array("k", np.reshape(message.k, (3, 3)), (3, 3)), np.resize([*message.d, *[0.0] * 5], 5)


_ENCODINGS: dict[str, np.dtype] = {"mono8": np.dtype(np.uint8), "mono16": np.dtype("<u2")}
_GREY = {"rgb8": (77, 150, 29), "bgr8": (29, 150, 77)}  # 256ths of each colour, ITU-R BT.601


def image_to_message(image: np.ndarray, time: float, frame: str) -> Image:
    """image: (h, w) uint8 or uint16. time: s, middle of the exposure. frame: e.g. left_optical."""
    if image.ndim != 2:
        raise BadShape("image", image.shape, "(height, width)")
    encoding = next((name for name, dtype in _ENCODINGS.items() if dtype == image.dtype), None)
    if encoding is None:
        raise BadMessage(f"image of dtype uint8 or uint16 expected, got {image.dtype}")
    height, width = image.shape
    data = array.array("B")
    data.frombytes(np.ascontiguousarray(image).data.cast("B"))
    message = Image(height=height, width=width, encoding=encoding, step=width * image.itemsize, data=data)
    message.header.stamp, message.header.frame_id = stamp(time), frame
    return message


def image_from_message(message: Image) -> np.ndarray:
    """(h, w) uint8 or uint16, a view of the message's data; colour becomes grey."""
    shares = _GREY.get(message.encoding)
    dtype = np.dtype(np.uint8) if shares else _ENCODINGS.get(message.encoding)
    if dtype is None:
        raise BadMessage(f"encoding {message.encoding!r} is none of {', '.join([*_ENCODINGS, *_GREY])}")
    step = message.width * dtype.itemsize * (3 if shares else 1)
    if message.step != step or len(message.data) != step * message.height:
        raise BadMessage(f"{len(message.data)} bytes of step {message.step} are no {message.width} x {message.height} {message.encoding}")
    values = np.frombuffer(message.data, dtype.newbyteorder(">") if message.is_bigendian else dtype)
    if shares:
        colours = values.reshape(message.height, message.width, 3).astype(np.uint16)
        return ((colours @ np.array(shares, dtype=np.uint16)) >> 8).astype(np.uint8)
    return values.reshape(message.height, message.width)


def joints_to_message(names: Sequence[str], time: float, q: Array, qdot: Array, message: JointState | None = None) -> JointState:
    """q: (n,) rad. qdot: (n,) rad/s."""
    message = message or JointState(name=list(names))
    stamp(time, message.header.stamp)
    message.position, message.velocity = array.array("d", q.tobytes()), array.array("d", qdot.tobytes())
    return message


def joints_from_message(message: JointState, names: Sequence[str]) -> tuple[float, Array, Array | None] | None:
    """Return the state of the joints `names`, whatever other joints the message holds.

    Returns:
        Time s, q (n,) rad and qdot (n,) rad/s in the order of `names`. qdot is None where the driver sends no speeds: none at all, or
        NaN for each of these joints, as ros2_control does. None if the message holds none of these joints.

    Raises:
        BadMessage: some of the joints are missing or named twice, or numbers are missing or not finite.
    """
    given = list(message.name)
    if not any(name in names for name in given):
        return None
    wrong = {name: given.count(name) for name in names if given.count(name) != 1}
    if wrong:
        raise BadMessage(f"each joint once expected, got {', '.join(f'{name} {count} times' for name, count in wrong.items())}")
    order = [given.index(name) for name in names]
    for field, values in (("position", message.position), ("velocity", message.velocity)):
        if len(values) != len(given) and not (field == "velocity" and len(values) == 0):
            raise BadMessage(f"{field} holds {len(values)} numbers for {len(given)} names")
    q = np.array([message.position[i] for i in order])
    qdot = np.array([message.velocity[i] for i in order]) if len(message.velocity) else None
    if qdot is not None and np.isnan(qdot).all():
        qdot = None
    if not np.isfinite(q).all():
        raise BadMessage(f"positions are not finite: {q}")
    if qdot is not None and not np.isfinite(qdot).all():
        raise BadMessage(f"velocities are not finite: {qdot}")
    return seconds(message.header.stamp), q, qdot


def swing_to_message(names: Sequence[str], time: float, times: Array, q: Array, qdot: Array) -> JointTrajectory:
    """time: s, reference. times: (n,) s after it. q, qdot: (n, joints) rad and rad/s."""
    points = [
        JointTrajectoryPoint(positions=a.tolist(), velocities=b.tolist(), time_from_start=_duration(t))
        for t, a, b in zip(times, q, qdot, strict=True)
    ]
    message = JointTrajectory(joint_names=list(names), points=points)
    message.header.stamp = stamp(time)
    return message
