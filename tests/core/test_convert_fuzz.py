"""Whatever a message holds: a conversion returns finite values within their bounds or raises a TtError, and nothing else."""

import math

import numpy as np
from geometry_msgs.msg import Point, PointStamped, Quaternion, Transform, Twist, Vector3
from hypothesis import example, given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image, RegionOfInterest
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint
from tt_core.errors import TtError
from tt_core.images import ENCODINGS, MOST_PIXELS
from tt_core.ros import convert

modest = st.floats(-50.0, 50.0)
wild = st.sampled_from([0.0, -0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 1e17, -1e300, 1e-300, 1.8e308, 100.0, 3000.0])
numbers = st.one_of(modest, modest, modest, wild, st.floats())
texts = st.one_of(st.sampled_from(["table", "ball", "racket", ""]), st.text(st.characters(codec="ascii", min_codepoint=1), max_size=8))
int32 = st.one_of(st.integers(-2, 50), st.integers(-(2**31), 2**31 - 1))
uint32 = st.one_of(st.integers(0, 300), st.integers(0, 2**32 - 1))
nanoseconds = st.one_of(st.integers(0, 10**9 - 1), st.integers(0, 2**32 - 1))
vectors = st.tuples(numbers, numbers, numbers)


def usually(good, otherwise):
    return st.one_of(st.just(good), st.just(good), st.just(good), otherwise)


def stamped(message, sec, nanosec, frame):
    message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id = sec, nanosec, frame
    return message


def xyz(kind, values):
    return kind(x=values[0], y=values[1], z=values[2])


def is_bounded(values, bound):
    return bool((np.abs(np.asarray(values)) <= bound).all())  # not so for NaN


def matrices(size):
    """Covariances, and what is none."""
    diagonal = st.lists(st.floats(0.0, 1e3), min_size=size, max_size=size).map(lambda d: np.diag(d).ravel().tolist())
    changed = st.tuples(diagonal, st.integers(0, size * size - 1), numbers).map(lambda t: [*t[0][: t[1]], t[2], *t[0][t[1] + 1 :]])
    return st.one_of(diagonal, changed, st.lists(numbers, min_size=size * size, max_size=size * size))


@st.composite
def odometries(draw):
    message = Odometry(child_frame_id=draw(usually("ball", texts)))
    stamped(message, draw(int32), draw(nanoseconds), draw(usually("table", texts)))
    message.pose.pose.position = xyz(Point, draw(vectors))
    message.twist.twist = Twist(linear=xyz(Vector3, draw(vectors)), angular=xyz(Vector3, draw(vectors)))
    message.pose.covariance, message.twist.covariance = draw(matrices(6)), draw(matrices(6))
    return message


@st.composite
def points(draw):
    point = MultiDOFJointTrajectoryPoint()
    quaternion = draw(usually((0.0, 0.6, 0.0, 0.8), st.tuples(numbers, numbers, numbers, numbers)))
    rotation = Quaternion(x=quaternion[0], y=quaternion[1], z=quaternion[2], w=quaternion[3])
    count = draw(usually(1, st.integers(0, 2)))
    point.transforms = [Transform(translation=xyz(Vector3, draw(vectors)), rotation=rotation)] * count
    point.velocities = [Twist(linear=xyz(Vector3, draw(vectors)), angular=xyz(Vector3, draw(vectors)))] * draw(usually(1, st.just(count)))
    point.time_from_start.sec, point.time_from_start.nanosec = draw(int32), draw(nanoseconds)
    return point


@st.composite
def trajectories(draw, joint):
    message = MultiDOFJointTrajectory(joint_names=draw(usually([joint], st.lists(texts, max_size=3))))
    message.points = draw(st.lists(points(), max_size=4)) * draw(usually(1, st.sampled_from([2, 40, 3000])))
    return stamped(message, draw(int32), draw(nanoseconds), draw(usually("table", texts)))


@st.composite
def cameras(draw):
    size = st.one_of(st.integers(1, 700), uint32)
    focal, middle = st.one_of(st.floats(50.0, 5000.0), numbers), st.one_of(st.floats(0.0, 700.0), numbers)
    k = [draw(focal), draw(usually(0.0, numbers)), draw(middle), draw(usually(0.0, numbers)), draw(focal), draw(middle), 0.0, 0.0]
    models = st.sampled_from([*convert._PINHOLE, *convert._FISHEYE])
    coefficients = st.one_of(st.floats(-0.5, 0.5), numbers)
    return CameraInfo(
        width=draw(size),
        height=draw(size),
        k=[*k, draw(usually(1.0, numbers))],
        d=draw(st.sampled_from([0, 4, 5, 8, 12, 14, 3]).flatmap(lambda n: st.lists(coefficients, min_size=n, max_size=n))),
        distortion_model=draw(st.one_of(models, texts)),
        binning_x=draw(usually(0, uint32)),
        roi=RegionOfInterest(x_offset=draw(usually(0, uint32)), width=draw(usually(0, uint32)), height=draw(usually(0, uint32))),
    )


@st.composite
def images(draw):
    encoding, width, height = draw(st.one_of(st.sampled_from(list(ENCODINGS)), texts)), draw(uint32), draw(uint32)
    known = ENCODINGS.get(encoding, ENCODINGS["mono8"])
    row = width * known.channels * np.dtype(known.dtype).itemsize
    step = draw(st.one_of(st.just(row), st.integers(row, row + 9), uint32)) % 2**32
    length = draw(usually(step * int(height * known.rows), st.integers(0, 5000)))
    data = bytes(length) if length < 10**6 else b""
    return Image(encoding=encoding, width=width, height=height, step=step, data=data, is_bigendian=draw(st.integers(0, 255)))


@given(odometries())
@example(Odometry())
def test_a_ball_is_bounded_or_refused(message):
    try:
        ball = convert.ball_from_message(message)
    except TtError:
        return
    assert 0.0 <= ball.time <= convert.LARGEST_STAMP
    assert (
        is_bounded(ball.position, convert.PLACE)
        and is_bounded(ball.velocity, convert.LARGEST_BALL_SPEED)
        and is_bounded(ball.spin, convert.LARGEST_BALL_SPIN)
    )
    assert ball.covariance is None or is_bounded(ball.covariance, convert.VARIANCE)
    convert.ball_to_message(ball)  # so can it be sent


@given(trajectories("ball"))
def test_a_path_is_bounded_or_refused(message):
    try:
        path = convert.path_from_message(message)
    except TtError:
        return
    assert 1 <= len(path.times) <= convert.MOST_PATH_POINTS
    assert (
        is_bounded(path.positions, convert.PLACE)
        and is_bounded(path.velocities, convert.LARGEST_BALL_SPEED)
        and is_bounded(path.spins, convert.LARGEST_BALL_SPIN)
    )
    assert path.times[-1] - path.times[0] <= convert.FROM_START[1] - convert.FROM_START[0]


@given(trajectories("ball"))
def test_a_goal_is_bounded_or_refused(message):
    try:
        goal = convert.goal_from_message(message)
    except TtError:
        return
    assert is_bounded(goal.landing, convert.PLACE) and is_bounded([goal.spin_y, goal.spin_z], convert.LARGEST_BALL_SPIN)
    assert 0.0 < goal.flight_time <= convert.FROM_START[1]


@given(trajectories("racket"))
def test_strokes_are_bounded_or_refused(message):
    try:
        rackets = convert.strokes_from_message(message)
    except TtError:
        return
    assert len(rackets) <= convert.MOST_STROKES
    for racket in rackets:
        assert is_bounded(racket.position, convert.PLACE) and is_bounded(racket.velocity, convert.LARGEST_BALL_SPEED)
        assert np.abs(racket.rotation @ racket.rotation.T - np.eye(3)).max() < 1e-9
        assert math.isfinite(racket.time)


@given(int32, nanoseconds, numbers, numbers)
def test_a_pixel_is_bounded_or_refused(sec, nanosec, x, y):
    try:
        time, pixel = convert.pixel_from_message(stamped(PointStamped(point=Point(x=x, y=y)), sec, nanosec, "x"))
    except TtError:
        return
    assert 0.0 <= time <= convert.LARGEST_STAMP and is_bounded(pixel, convert.PIXEL)


@given(cameras())
def test_a_camera_is_bounded_or_refused(message):
    try:
        width, height, matrix, distortion = convert.camera_from_message(message)
    except TtError:
        return
    assert 1 <= width <= MOST_PIXELS and 1 <= height <= MOST_PIXELS
    assert is_bounded(matrix, convert.FOCAL + MOST_PIXELS) and matrix[0, 0] > 0.0 and matrix[1, 1] > 0.0
    assert len(distortion) in (5, 8, 12, 14) and np.isfinite(distortion).all()


@given(images())
@example(Image(encoding="yuv422", width=1, height=1, step=2, data=bytes(2)))
def test_an_image_is_grey_or_refused(message):
    try:
        image = convert.image_from_message(message)
    except TtError:
        return
    assert image.shape == (message.height, message.width) and image.dtype in (np.uint8, np.uint16)
