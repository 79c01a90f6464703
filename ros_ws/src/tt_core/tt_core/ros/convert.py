"""Conversion of messages to states and back; only this module does it.

Every *_from_message raises TtError for a message that does not have the form which its topic promises. Functions whose messages are sent
hundreds of times a second can fill a `message` again that they have made before.
"""

from __future__ import annotations

import array
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, PointStamped, PoseStamped, Transform, Twist, Vector3
from nav_msgs.msg import Odometry, Path
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, Image, JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint, MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from ..errors import BadMessage, BadShape, MessageFailure, NotFinite, OutOfRange, check_array, check_range
from ..images import MOST_PIXELS, grey_image
from ..lens import rational_from_fisheye
from ..states import UNKNOWN_VARIANCE, Array, BallPath, BallState, Bounce, RacketState, ReturnGoal
from .trajectory_rows import TrajectoryRows, rows_from_bytes, rows_to_bytes

# Bounds of the numbers in messages, far above what occurs in table tennis. A message beyond them is refused before anything is computed.
PLACE = 100.0  # m, of each coordinate: no hall is larger
LARGEST_BALL_SPEED = 100.0  # m/s, of each component: three times the fastest smashes
LARGEST_BALL_SPIN = 3000.0  # rad/s, of each component: three times the fastest spins, 150 rev/s
VARIANCE = 1e12  # of anything; what is not known has UNKNOWN_VARIANCE or more
FOCAL = 1e6  # pixels, of every number of K: a field of view of a hundredth of a degree
LENS = 1e9  # of a distortion coefficient; high orders of narrow lenses are large
PIXEL = 1e5  # pixels, of where a ball is seen
LARGEST_STAMP = 2.0**31 - 1000.0  # s, largest stamp: it fits into 32 bits, and so do times that are computed from it
FROM_START = (-1.0, 100.0)  # s, of time_from_start
MOST_PATH_POINTS = 2000  # of a path: predict_node publishes at most tt_predict.rollout.MOST_POINTS
MOST_STROKES = 64  # of a list of candidates: racket_node publishes at most tt_racket.intercept.MOST_CANDIDATES


def stamp(time: float, message: Time | None = None) -> Time:
    """Convert a time to a stamp.

    Args:
        time: s.
        message: The stamp to fill; a new one if None.
    """
    message = message or Time()
    message.sec, message.nanosec = divmod(round(time * 1e9), 10**9)
    return message


def seconds(message: Time | Duration) -> float:
    """Return a stamp or a duration in s, without a check."""
    return message.sec + message.nanosec * 1e-9


def stamp_seconds(message: Time) -> float:
    """Return the stamp of a message in s.

    Raises:
        BadMessage: The stamp has a second of nanoseconds or more.
        OutOfRange: The stamp is outside 0 to LARGEST_STAMP.
    """
    if message.nanosec >= 10**9:
        raise BadMessage(MessageFailure.BAD_STAMP, sec=message.sec, nanosec=message.nanosec)
    return check_range("stamp, s,", seconds(message), 0.0, LARGEST_STAMP)


def _bounded(name: str, values: object, shape: tuple[int, ...], bound: float) -> Array:
    """Return `values` as an array of `shape`; raises NotFinite, or OutOfRange for an absolute value above `bound`."""
    checked = check_array(name, values, shape)
    worst = checked.flat[np.abs(checked).argmax()] if checked.size else 0.0
    if abs(worst) > bound:
        raise OutOfRange(name, float(worst), -bound, bound)
    return checked


def _covariance(name: str, numbers: object) -> Array:
    """Return the covariance (6, 6) of a message; raises TtError for numbers that are none."""
    covariance = _bounded(name, numbers, (36,), VARIANCE).reshape(6, 6)
    largest = np.abs(covariance).max()
    if (np.diag(covariance) < 0.0).any():
        raise BadMessage(MessageFailure.NEGATIVE_VARIANCE, name=name, variance=np.diag(covariance).min())
    if np.abs(covariance - covariance.T).max() > 1e-6 * largest:
        raise BadMessage(MessageFailure.NOT_SYMMETRIC, name=name, difference=np.abs(covariance - covariance.T).max())
    least = np.linalg.eigvalsh(0.5 * (covariance + covariance.T))[0]
    if least < -1e-6 * largest:
        raise BadMessage(MessageFailure.NEGATIVE_EIGENVALUE, name=name, eigenvalue=least)
    return covariance


def _duration(time: float) -> Duration:
    """Return a duration of `time` (s)."""
    nanoseconds = round(time * 1e9)
    return Duration(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def _vector3(v: Sequence[float]) -> Vector3:
    """Return the message of a vector (3,)."""
    x, y, z = v
    return Vector3(x=x, y=y, z=z)


def _numbers(v: Vector3 | Point) -> tuple[float, float, float]:
    """Return the vector (3,) of a message."""
    return v.x, v.y, v.z


def _fill(message: Vector3 | Point, v: Array) -> None:
    """Write a vector (3,) into a message."""
    message.x, message.y, message.z = v.tolist()


def ball_to_message(ball: BallState, message: Odometry | None = None) -> Odometry:
    """Return a state of the ball as a message.

    Odometry has no room for the covariance of position with velocity and spin, so it is left out.

    Args:
        ball: In `table`.
        message: The message to fill, whose covariance stays; a new one if None.
    """
    if message is None:
        message = Odometry(child_frame_id="ball")
        message.header.frame_id = "table"
        covariance = np.diag([UNKNOWN_VARIANCE] * 9) if ball.covariance is None else ball.covariance
        in_pose = np.zeros((6, 6))
        in_pose[:3, :3] = covariance[:3, :3]
        message.pose.covariance, message.twist.covariance = in_pose.ravel(), covariance[3:, 3:].ravel()
    stamp(ball.time, message.header.stamp)
    _fill(message.pose.pose.position, ball.position)
    _fill(message.twist.twist.linear, ball.velocity)
    _fill(message.twist.twist.angular, ball.spin)
    return message


def ball_from_message(message: Odometry) -> BallState:
    """Return the state of the ball in a message, in `table`; its covariance is None if no variance is below UNKNOWN_VARIANCE.

    Raises:
        TtError: The frames are not `table` and `ball`, a number is outside its bound, or a covariance is not positive semidefinite.
    """
    if message.header.frame_id != "table" or message.child_frame_id != "ball":
        frame = f"{message.header.frame_id[:40]} -> {message.child_frame_id[:40]}"
        raise BadMessage(MessageFailure.OTHER_FRAME, wanted="table -> ball", frame=frame)
    position, twist = message.pose.pose.position, message.twist.twist
    covariance = np.zeros((9, 9))
    covariance[:3, :3] = _covariance("covariance of the pose", message.pose.covariance)[:3, :3]
    covariance[3:, 3:] = _covariance("covariance of the twist", message.twist.covariance)
    known = (np.diag(covariance) < UNKNOWN_VARIANCE).any()
    return BallState(
        stamp_seconds(message.header.stamp),
        _bounded("position", _numbers(position), (3,), PLACE),
        _bounded("velocity", _numbers(twist.linear), (3,), LARGEST_BALL_SPEED),
        _bounded("spin", _numbers(twist.angular), (3,), LARGEST_BALL_SPIN),
        covariance if known else None,
    )


def _rows(message: MultiDOFJointTrajectory, joint: str) -> TrajectoryRows:
    """Return the points of a trajectory of a joint in `table`; raises TtError for a message of another form."""
    if len(message.joint_names) != 1 or message.joint_names[0] != joint:
        names = [name[:40] for name in message.joint_names[:4]]
        raise BadMessage(MessageFailure.OTHER_JOINT, wanted=joint, count=len(message.joint_names), joints=names)
    if any(len(p.transforms) != 1 or len(p.velocities) != 1 for p in message.points):
        raise BadMessage(MessageFailure.INCOMPLETE_POINT)
    if message.header.frame_id != "table":
        raise BadMessage(MessageFailure.OTHER_FRAME, wanted="table", frame=message.header.frame_id[:40])
    transforms, velocities = [p.transforms[0] for p in message.points], [p.velocities[0] for p in message.points]
    return TrajectoryRows(
        message.header.stamp,
        np.array([seconds(p.time_from_start) for p in message.points]),
        np.array([_numbers(transform.translation) for transform in transforms]).reshape(-1, 3),
        np.array([(q.x, q.y, q.z, q.w) for q in (transform.rotation for transform in transforms)]).reshape(-1, 4),
        np.array([_numbers(velocity.linear) for velocity in velocities]).reshape(-1, 3),
        np.array([_numbers(velocity.angular) for velocity in velocities]).reshape(-1, 3),
    )


def _read_rows(data: bytes, joint: str) -> TrajectoryRows:
    """Return the points of a serialized trajectory of a joint in `table`.

    Raises:
        TtError: It has another form.
        RuntimeError: The bytes are no trajectory.
    """
    rows = rows_from_bytes(joint, data)
    return _rows(deserialize_message(data, MultiDOFJointTrajectory), joint) if rows is None else rows


def _check_rows(rows: TrajectoryRows, least: int, most: int) -> float:
    """Check the number of points of a trajectory, its stamp and the times of its points; return the stamp in s. Raises TtError."""
    check_range("number of points", len(rows.after), least, most)
    for after in (rows.after.min(), rows.after.max()) if len(rows.after) else ():
        check_range("time_from_start, s,", after, *FROM_START)
    return stamp_seconds(rows.stamp)


def path_to_bytes(path: BallPath) -> bytes:
    """Return a path, the predicted flight of the ball, as a serialized message. Two points of the same time are a bounce.

    Raises:
        TtError: The path has more than MOST_PATH_POINTS points, or a number is outside its bound.
    """
    count, start = len(path.times), float(path.times[0])
    check_range("number of points of the path", count, 1, MOST_PATH_POINTS)
    check_range("duration of the path, s,", path.times[-1] - start, *FROM_START)
    rows = TrajectoryRows(
        stamp(start),
        path.times - start,
        _bounded("position", path.positions, (count, 3), PLACE),
        np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)),
        _bounded("velocity", path.velocities, (count, 3), LARGEST_BALL_SPEED),
        _bounded("spin", path.spins, (count, 3), LARGEST_BALL_SPIN),
    )
    return rows_to_bytes("ball", rows)


def path_to_message(path: BallPath) -> MultiDOFJointTrajectory:
    """Return a path as a message, see `path_to_bytes`."""
    message: MultiDOFJointTrajectory = deserialize_message(path_to_bytes(path), MultiDOFJointTrajectory)
    return message


def path_from_bytes(data: bytes) -> BallPath:
    """Return the path in a serialized message, see `path_from_message`.

    Raises:
        RuntimeError: The bytes are no trajectory.
    """
    return _path(_read_rows(data, "ball"))


def path_from_message(message: MultiDOFJointTrajectory) -> BallPath:
    """Return the path in a message, the predicted flight of the ball in `table`. Two points of the same time are a bounce.

    Raises:
        TtError: The message is no trajectory of one joint `ball` in `table`, has more than MOST_PATH_POINTS points, its times decrease, or
            a number is outside its bound.
    """
    return _path(_rows(message, "ball"))


def _path(rows: TrajectoryRows) -> BallPath:
    """Convert the points of a trajectory to a path; raises TtError if a number is outside its bounds, or the times decrease."""
    times = _check_rows(rows, 1, MOST_PATH_POINTS) + rows.after
    positions = _bounded("position", rows.translations, (-1, 3), PLACE)
    velocities = _bounded("velocity", rows.linear, (-1, 3), LARGEST_BALL_SPEED)
    spins = _bounded("spin", rows.angular, (-1, 3), LARGEST_BALL_SPIN)

    def state(i: int) -> BallState:
        return BallState.trusted(float(times[i]), positions[i], velocities[i], spins[i])

    bounces = tuple(Bounce(state(i), state(i + 1)) for i in np.flatnonzero(np.diff(times) == 0.0).tolist())
    return BallPath(times, positions, velocities, spins, bounces)


def path_to_poses(path: BallPath) -> Path:
    """Return the positions of a path as a message that viewers can draw. Velocities and spins are not in it."""
    message = Path()
    message.header.stamp, message.header.frame_id = stamp(path.times[0]), "table"
    for time, place in zip(path.times.tolist(), path.positions, strict=True):
        pose = PoseStamped()
        pose.header.stamp, pose.header.frame_id = stamp(time), "table"
        _fill(pose.pose.position, place)
        message.poses.append(pose)
    return message


def goal_to_message(goal: ReturnGoal, time: float = 0.0) -> MultiDOFJointTrajectory:
    """Return the goal of a return as a message.

    Args:
        goal: Landing place, flight time and spin that the returned ball is to have.
        time: s, when the goal was set.
    """
    point = MultiDOFJointTrajectoryPoint(
        transforms=[Transform(translation=_vector3([*goal.landing.tolist(), 0.0]))],
        velocities=[Twist(angular=_vector3([0.0, goal.spin_y, goal.spin_z]))],
        time_from_start=_duration(goal.flight_time),
    )
    message = MultiDOFJointTrajectory(joint_names=["ball"], points=[point])
    message.header.stamp, message.header.frame_id = stamp(time), "table"
    return message


def goal_from_message(message: MultiDOFJointTrajectory) -> ReturnGoal:
    """Return the goal of a return in a message.

    Raises:
        TtError: The message is no trajectory of one joint `ball` in `table` with exactly one point, or a number is outside its bound.
    """
    rows = _rows(message, "ball")
    _check_rows(rows, 1, 1)
    landing = _bounded("landing", rows.translations[0], (3,), PLACE)
    spin = _bounded("spin", rows.angular[0], (3,), LARGEST_BALL_SPIN)
    return ReturnGoal(landing[:2], float(rows.after[0]), spin[1], spin[2])


class StampedStrokes(NamedTuple):
    """Candidate strokes, the racket states in `table` that would return the ball.

    Attributes:
        time: s, of the last frame that they are based on.
        rackets: The candidates in order of preference.
    """

    time: float
    rackets: list[RacketState]


def strokes_to_bytes(rackets: Sequence[RacketState], time: float) -> bytes:
    """Return candidate strokes, the racket states that would return the ball, as a serialized message.

    Args:
        rackets: The candidates in order of preference, in `table`.
        time: s, of the last frame that they are based on.

    Raises:
        TtError: There are more than MOST_STROKES, or a number is outside its bound.
    """
    count = len(rackets)
    check_range("number of strokes", count, 0, MOST_STROKES)
    after = [check_range("time of the strike after the path's start, s,", racket.time - time, *FROM_START) for racket in rackets]
    angles = check_array("angles", [(racket.alpha, racket.beta) for racket in rackets] or np.empty((0, 2)), (count, 2))
    rows = TrajectoryRows(
        stamp(time),
        np.array(after),
        _bounded("position", [racket.position for racket in rackets] or np.empty((0, 3)), (count, 3), PLACE),
        _quaternions(angles),
        _bounded("velocity", [racket.velocity for racket in rackets] or np.empty((0, 3)), (count, 3), LARGEST_BALL_SPEED),
        np.zeros((count, 3)),
    )
    return rows_to_bytes("racket", rows)


def _quaternions(angles: Array) -> Array:
    """Return the quaternions (n, 4), in the order x, y, z, w, of Ry(beta) Rx(alpha). angles: (n, 2) rad, alpha and beta."""
    (sin_a, sin_b), (cos_a, cos_b) = np.sin(angles.T / 2.0), np.cos(angles.T / 2.0)
    return np.stack([sin_a * cos_b, cos_a * sin_b, -sin_a * sin_b, cos_a * cos_b], axis=1)


def _normals(quaternions: Array) -> Array:
    """Return the third columns (n, 3) of the rotation matrices of quaternions (n, 4) of any length, in the order x, y, z, w."""
    x, y, z, w = quaternions.T / np.linalg.norm(quaternions, axis=1)
    return np.stack([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w + z * z - x * x - y * y], axis=1)


def strokes_to_message(rackets: Sequence[RacketState], time: float) -> MultiDOFJointTrajectory:
    """Return candidate strokes as a message, see `strokes_to_bytes`."""
    message: MultiDOFJointTrajectory = deserialize_message(strokes_to_bytes(rackets, time), MultiDOFJointTrajectory)
    return message


def strokes_from_bytes(data: bytes) -> StampedStrokes:
    """Return the candidate strokes in a serialized message with the time that they are based on, see `strokes_from_message`.

    Raises:
        RuntimeError: The bytes are no trajectory.
    """
    return _strokes(_read_rows(data, "racket"))


def strokes_from_message(message: MultiDOFJointTrajectory) -> list[RacketState]:
    """Return the candidate strokes in a message, the racket states in `table` that would return the ball, in order of preference.

    Raises:
        TtError: The message is no trajectory of one joint `racket` in `table`, has more than MOST_STROKES points, a number is outside its
            bound, or a quaternion does not have length 1.
    """
    return _strokes(_rows(message, "racket")).rackets


def _strokes(rows: TrajectoryRows) -> StampedStrokes:
    """Convert the points of a trajectory to candidate strokes; raises TtError for a number or a count outside its bounds."""
    start = _check_rows(rows, 0, MOST_STROKES)
    if not len(rows.after):
        return StampedStrokes(start, [])
    with np.errstate(over="ignore"):
        wrong = ~(np.abs(np.linalg.norm(rows.rotations, axis=1) - 1.0) <= 1e-3)  # true for NaN
    if wrong.any():
        raise BadMessage(MessageFailure.NO_ROTATION, quaternion=tuple(rows.rotations[wrong.argmax()].tolist()))
    times = (start + rows.after).tolist()
    positions = _bounded("position", rows.translations, (-1, 3), PLACE)
    velocities = _bounded("velocity", rows.linear, (-1, 3), LARGEST_BALL_SPEED)
    alphas, betas = RacketState.angles(_normals(rows.rotations))
    return StampedStrokes(start, list(map(RacketState.trusted, times, positions, velocities, alphas.tolist(), betas.tolist())))


def pixel_to_message(time: float, pixel: Sequence[float] | Array, frame: str) -> PointStamped:
    """Return the pixel of a ball as a message, for cameras that track the ball on board.

    Args:
        time: s, middle of the exposure.
        pixel: (2,) column and row of the centre of the ball.
        frame: Frame of the camera, e.g. wide_left_optical.
    """
    message = PointStamped(point=Point(x=float(pixel[0]), y=float(pixel[1])))
    message.header.stamp, message.header.frame_id = stamp(time), frame
    return message


def pixel_from_message(message: PointStamped) -> tuple[float, Array]:
    """Return time (s) and pixel (2,), column and row, of a tracked ball.

    Raises:
        TtError: A number is outside its bound.
    """
    return stamp_seconds(message.header.stamp), _bounded("pixel", [message.point.x, message.point.y], (2,), PIXEL)


def racket_to_message(time: float, position: Array, quaternion: Array, velocity: Array, message: Odometry | None = None) -> Odometry:
    """Return position, orientation and velocity of the racket as a message.

    Args:
        time: s.
        position: (3,) m, centre of the face in `table`.
        quaternion: (4,) x, y, z, w of the rotation from the racket's frame to `table`.
        velocity: (3,) m/s in `table`, as for the ball.
        message: The message to fill; a new one if None.
    """
    if message is None:
        message = Odometry(child_frame_id="racket")
        message.header.frame_id = "table"
    stamp(time, message.header.stamp)
    _fill(message.pose.pose.position, position)
    q = message.pose.pose.orientation
    q.x, q.y, q.z, q.w = quaternion.tolist()
    _fill(message.twist.twist.linear, velocity)
    return message


def camera_to_message(width: int, height: int, matrix: Array, distortion: Array | None, frame: str, time: float = 0.0) -> CameraInfo:
    """Return the calibration of a camera as a message.

    Args:
        width: Pixels.
        height: Pixels.
        matrix: (3, 3) camera matrix K in pixels.
        distortion: (n,) in the order of OpenCV, or None. More than 5 coefficients are of the model rational_polynomial.
        frame: Frame of the camera, e.g. left_optical.
        time: s.
    """
    d = np.zeros(5) if distortion is None else np.asarray(distortion, dtype=np.float64)
    model = "plumb_bob" if len(d) <= 5 else "rational_polynomial"
    message = CameraInfo(width=width, height=height, distortion_model=model, d=d.tolist(), k=matrix.ravel())
    message.r, message.p = np.eye(3).ravel(), np.column_stack([matrix, np.zeros(3)]).ravel()
    message.header.stamp, message.header.frame_id = stamp(time), frame
    return message


# How many coefficients each distortion model of sensor_msgs/distortion_models may have. Without a name it is plumb_bob.
_PINHOLE = {"": (0, 4, 5), "none": (0,), "plumb_bob": (0, 4, 5), "rational_polynomial": (8, 12, 14)}
_FISHEYE = {"equidistant": (0, 4), "fisheye": (0, 4), "kannala_brandt": (0, 4)}


def camera_from_message(message: CameraInfo) -> tuple[int, int, Array, Array]:
    """Return the calibration of a camera in a message.

    The coefficients of a fisheye lens are converted to those of a rational model that images in the same way, see `tt_core.lens`. A region
    of interest moves the principal point.

    Returns:
        Width and height in pixels, (3, 3) camera matrix K in pixels, and the distortion in the order of OpenCV: (5,) k1, k2, p1, p2, k3,
        followed by as many of k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y as the message has.

    Raises:
        TtError: The camera is not calibrated, K is skewed, the image is binned, the model is unknown or has another number of coefficients,
            or a number is outside its bound.
    """
    matrix = np.array(_bounded("K", message.k, (9,), FOCAL).reshape(3, 3))
    if matrix[0, 0] <= 0.0 or matrix[1, 1] <= 0.0:
        raise BadMessage(MessageFailure.NOT_CALIBRATED, width=message.width, height=message.height, matrix=matrix.ravel())
    if (matrix[[0, 1, 2, 2], [1, 0, 0, 1]] != 0.0).any() or matrix[2, 2] != 1.0:
        raise BadMessage(MessageFailure.SKEWED, matrix=matrix.ravel())
    if message.binning_x > 1 or message.binning_y > 1:
        raise BadMessage(MessageFailure.BINNED, x=message.binning_x, y=message.binning_y)
    width, height, roi = message.width, message.height, message.roi
    check_range("width of the camera, pixels,", width, 1, MOST_PIXELS)
    check_range("height of the camera, pixels,", height, 1, MOST_PIXELS)
    if roi.width or roi.height:
        check_range("region of interest, pixels to its right edge,", roi.x_offset + roi.width, roi.x_offset + 1, width)
        check_range("region of interest, pixels to its lower edge,", roi.y_offset + roi.height, roi.y_offset + 1, height)
        width, height = roi.width, roi.height
        matrix[:2, 2] -= roi.x_offset, roi.y_offset
    return width, height, matrix, _distortion(message, width, height, matrix)


def _distortion(message: CameraInfo, width: int, height: int, matrix: Array) -> Array:
    """Return the distortion (n,) in the order of OpenCV."""
    model = message.distortion_model.lower()
    counts = (_PINHOLE | _FISHEYE).get(model)
    if counts is None:
        raise BadMessage(MessageFailure.OTHER_MODEL, model=model[:40], known=", ".join(map(repr, _PINHOLE | _FISHEYE)))
    if len(message.d) not in counts:
        raise BadMessage(MessageFailure.COEFFICIENT_COUNT, model=model, known=" or ".join(map(str, counts)), count=len(message.d))
    given = _bounded("distortion", message.d, (-1,), LENS)
    if model in _FISHEYE:
        focal = matrix[[0, 1], [0, 1]]
        corners = np.array([[0.0, 0.0], [width - 1.0, 0.0], [0.0, height - 1.0], [width - 1.0, height - 1.0]])
        reach = np.linalg.norm((corners - matrix[:2, 2]) / focal, axis=1).max()
        given = rational_from_fisheye(given if len(given) else np.zeros(4), reach, focal.max())
    return np.append(given, np.zeros(max(0, 5 - len(given))))


def image_to_message(image: np.ndarray, time: float, frame: str) -> Image:
    """Return an image as a message.

    Args:
        image: (h, w) uint8 or uint16.
        time: s, middle of the exposure.
        frame: Frame of the camera, e.g. left_optical.

    Raises:
        BadShape: The image does not have two dimensions.
        BadMessage: The image has another dtype.
    """
    if image.ndim != 2:
        raise BadShape("image", image.shape, "(height, width)")
    if image.dtype not in (np.uint8, np.uint16):
        raise BadMessage(MessageFailure.OTHER_TYPE, dtype=image.dtype)
    height, width = image.shape
    data = array.array("B")
    data.frombytes(np.ascontiguousarray(image).data.cast("B"))
    message = Image(height=height, width=width, encoding=f"mono{8 * image.itemsize}", step=width * image.itemsize, data=data)
    message.header.stamp, message.header.frame_id = stamp(time), frame
    return message


def image_from_message(message: Image) -> np.ndarray:
    """Return the image in a message, converted to grey.

    Returns:
        (h, w) uint8 or uint16. It is a view of the message's data where these are grey and not padded.

    Raises:
        TtError: The encoding is none of ENCODINGS, or size, step and data do not fit together.
    """
    return grey_image(message.encoding, message.width, message.height, message.step, message.data, big_endian=message.is_bigendian != 0)


def joints_to_message(
    names: Sequence[str], time: float, q: Array, qdot: Array, effort: Array | None = None, message: JointState | None = None
) -> JointState:
    """Return positions, speeds and torques of joints as a message.

    Args:
        names: Names of the joints.
        time: s.
        q: (n,) rad.
        qdot: (n,) rad/s.
        effort: (n,) N m, or None if it is not known.
        message: The message to fill, which has the names already; a new one if None.
    """
    message = message or JointState(name=list(names))
    stamp(time, message.header.stamp)
    if effort is not None:
        message.effort = array.array("d", effort.tobytes())
    message.position, message.velocity = array.array("d", q.tobytes()), array.array("d", qdot.tobytes())
    return message


def joints_from_message(message: JointState, names: Sequence[str]) -> tuple[float, Array, Array | None] | None:
    """Return the state of the joints `names`; other joints in the message are ignored.

    Args:
        message: The message.
        names: Names of the joints.

    Returns:
        Time (s), positions q (n,) in rad and speeds qdot (n,) in rad/s, in the order of `names`. qdot is None if the driver sends no
        speeds:
        none at all, or NaN for each of these joints, as ros2_control does. None if the message holds none of these joints.

    Raises:
        BadMessage: Some of the joints are missing or named twice, or numbers are missing.
        NotFinite: A number is NaN or infinite.
    """
    given = list(message.name)
    if not any(name in names for name in given):
        return None
    wrong = {name: given.count(name) for name in names if given.count(name) != 1}
    if wrong:
        raise BadMessage(MessageFailure.JOINT_COUNT, counts=", ".join(f"{name} {count} times" for name, count in wrong.items()))
    order = [given.index(name) for name in names]
    for field, values in (("position", message.position), ("velocity", message.velocity)):
        if len(values) != len(given) and not (field == "velocity" and len(values) == 0):
            raise BadMessage(MessageFailure.NUMBER_COUNT, field=field, count=len(values), names=len(given))
    q = np.array([message.position[i] for i in order])
    qdot = np.array([message.velocity[i] for i in order]) if len(message.velocity) else None
    if qdot is not None and np.isnan(qdot).all():
        qdot = None
    if not np.isfinite(q).all():
        raise NotFinite("position", q)
    if qdot is not None and not np.isfinite(qdot).all():
        raise NotFinite("velocity", qdot)
    return seconds(message.header.stamp), q, qdot


def swing_to_message(names: Sequence[str], time: float, times: Array, q: Array, qdot: Array) -> JointTrajectory:
    """Return a planned swing, the joint motion that makes a stroke, as a message.

    Args:
        names: Names of the joints.
        time: s, start of the swing.
        times: (n,) s after `time`.
        q: (n, joints) rad.
        qdot: (n, joints) rad/s.
    """
    points = [
        JointTrajectoryPoint(positions=a.tolist(), velocities=b.tolist(), time_from_start=_duration(t))
        for t, a, b in zip(times, q, qdot, strict=True)
    ]
    message = JointTrajectory(joint_names=list(names), points=points)
    message.header.stamp = stamp(time)
    return message
