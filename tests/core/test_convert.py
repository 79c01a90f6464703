"""States become messages and the same states again; a message that breaks its promise is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from nav_msgs.msg import Odometry
from refusals import refused
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image, JointState
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_core.errors import BadMessage, BadShape, TtError
from tt_core.ros import convert
from tt_core.states import BallPath, BallState, Bounce, RacketState, ReturnGoal

times = st.floats(0.0, 2e9)
vectors = arrays(float, 3, elements=st.floats(-100, 100))
NANOSECOND = 3e-7  # s: a double holds seconds of this century to 2.4e-7


@given(times, vectors, vectors, vectors, st.booleans())
def test_balls(time, p, v, w, known):
    covariance = None
    if known:
        half = np.random.default_rng(0).normal(size=(9, 9))
        covariance = half @ half.T
        covariance[:3, 3:], covariance[3:, :3] = 0.0, 0.0  # an Odometry has no room for it
    again = convert.ball_from_message(convert.ball_to_message(BallState(time, p, v, w, covariance)))
    assert again.time == pytest.approx(time, abs=NANOSECOND)
    assert again.vector == pytest.approx(np.concatenate([p, v, w]), abs=0.0)
    assert (again.covariance is None) == (not known)
    assert not known or again.covariance == pytest.approx(covariance, abs=0.0)


def test_paths_and_their_bounces():
    states = [BallState(t, [t, 0, 0.1 * t], [1, 0, v], [0, t, 0]) for t, v in ((5.0, -1), (5.1, -2), (5.1, 2), (5.2, 1))]
    rows = np.array([s.vector for s in states])
    path = BallPath([s.time for s in states], rows[:, :3], rows[:, 3:6], rows[:, 6:], (Bounce(states[1], states[2]),))
    again = convert.path_from_message(convert.path_to_message(path))
    assert again.times == pytest.approx(path.times, abs=1e-9)
    assert again.positions == pytest.approx(path.positions, abs=0.0)
    assert again.velocities == pytest.approx(path.velocities, abs=0.0)
    assert again.spins == pytest.approx(path.spins, abs=0.0)
    assert len(again.bounces) == 1
    assert again.bounces[0].after.velocity[2] == 2


@given(st.floats(1.4, 2.7), st.floats(0, 1.5), st.floats(0.1, 2.0), st.floats(-300, 300), st.floats(-300, 300))
def test_goals(x, y, flight_time, spin_y, spin_z):
    again = convert.goal_from_message(convert.goal_to_message(ReturnGoal([x, y], flight_time, spin_y, spin_z)))
    assert again.landing == pytest.approx([x, y], abs=0.0)
    assert again.flight_time == pytest.approx(flight_time, abs=1e-9)
    assert (again.spin_y, again.spin_z) == (spin_y, spin_z)


@given(st.lists(st.tuples(vectors, vectors, st.floats(-1.4, 1.4), st.floats(-3.1, 3.1)), max_size=4))
def test_strokes_keep_their_order(rows):
    rackets = [RacketState(100.0 + 0.1 * i, p, v, alpha, beta) for i, (p, v, alpha, beta) in enumerate(rows)]
    message = convert.strokes_to_message(rackets, 99.5)
    again = convert.strokes_from_message(message)
    assert len(again) == len(rackets)
    for one, point in zip(rackets, message.points, strict=True):
        q = point.transforms[0].rotation
        orientation = Rotation.from_euler("xy", (one.alpha, one.beta))  # of the class RacketState
        assert (orientation * Rotation.from_quat([q.x, q.y, q.z, q.w]).inv()).magnitude() == pytest.approx(0.0, abs=1e-9)
    for one, other in zip(rackets, again, strict=True):
        assert other.time == pytest.approx(one.time, abs=1e-7)
        assert np.concatenate([other.position, other.velocity]) == pytest.approx(np.concatenate([one.position, one.velocity]), abs=0.0)
        assert other.normal == pytest.approx(one.normal, abs=1e-9)  # a quaternion of doubles


def test_the_length_of_a_quaternion_does_not_matter():
    """The bound of the conversion is 0.1 %."""
    message = convert.strokes_to_message([RacketState(100.0, np.zeros(3), np.zeros(3), 0.3, 1.2)], 99.5)
    rotation = message.points[0].transforms[0].rotation
    (one,) = convert.strokes_from_message(message)
    for name in "xyzw":
        setattr(rotation, name, 1.0009 * getattr(rotation, name))
    (other,) = convert.strokes_from_message(message)
    assert other.normal == pytest.approx(one.normal, abs=1e-9)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_images(dtype):
    image = np.arange(12, dtype=dtype).reshape(3, 4) * 20
    message = convert.image_to_message(image, 7.5, "left_optical")
    assert (message.header.frame_id, convert.seconds(message.header.stamp)) == ("left_optical", 7.5)
    assert (convert.image_from_message(message) == image).all()


def test_an_image_that_is_a_view_is_written_as_it_looks():
    image = np.arange(40, dtype=np.uint8).reshape(5, 8)[::2, ::2]
    assert (convert.image_from_message(convert.image_to_message(image, 0.0, "x")) == image).all()


def test_cameras():
    matrix, distortion = np.array([[1750.0, 0, 115.5], [0, 1750, 116], [0, 0, 1]]), np.array([0.1, -0.2, 0.001, 0.002, 0.0])
    width, height, k, d = convert.camera_from_message(convert.camera_to_message(232, 230, matrix, distortion, "left_optical"))
    assert (width, height) == (232, 230)
    assert k == pytest.approx(matrix, abs=0.0)
    assert d == pytest.approx(distortion, abs=0.0)


@given(times, arrays(float, 2, elements=st.floats(0, 2000)))
def test_pixels(time, pixel):
    message = convert.pixel_to_message(time, pixel, "wide_left_optical")
    again, where = convert.pixel_from_message(message)
    assert again == pytest.approx(time, abs=NANOSECOND) and where == pytest.approx(pixel, abs=0.0)
    assert message.header.frame_id == "wide_left_optical"
    message.point.x = float("nan")
    with refused(TtError, "pixel"):
        convert.pixel_from_message(message)


def test_joints_come_in_the_order_that_is_asked_for():
    message = convert.joints_to_message(["a", "b"], 3.0, np.array([1.0, 2.0]), np.array([3.0, 4.0]))
    time, q, qdot = convert.joints_from_message(message, ["b", "a"])
    assert (time, q.tolist(), qdot.tolist()) == (3.0, [2.0, 1.0], [4.0, 3.0])


@pytest.mark.parametrize(
    ("convert_one", "message", "named"),
    [
        (convert.ball_from_message, Odometry(), ("table", "ball")),
        (convert.path_from_message, MultiDOFJointTrajectory(), ("ball", 1, 0)),
        (convert.path_from_message, convert.strokes_to_message([], 0.0), ("ball", "racket")),
        (convert.strokes_from_message, convert.goal_to_message(ReturnGoal([2, 0.7], 0.6, 0, 0)), ("racket", "ball")),
        (convert.image_from_message, Image(encoding="32FC1"), ("32FC1", "mono8", "8UC1")),
        (convert.image_from_message, Image(encoding="mono8", width=4, height=4, step=4), (0, 4)),
        (convert.camera_from_message, CameraInfo(), ("K",)),
        (lambda m: convert.joints_from_message(m, ["a"]), JointState(name=["a"], position=[np.nan], velocity=[0.0]), ("nan",)),
    ],
)
def test_a_broken_message_is_refused(convert_one, message, named):
    with refused(TtError, *named):
        convert_one(message)


def test_a_number_that_is_none_is_refused():
    message = convert.ball_to_message(BallState(0.0, [1, 2, 3], [0, 0, 0], [0, 0, 0]))
    message.twist.twist.angular.y = np.nan
    with refused(TtError, "spin", "nan"):
        convert.ball_from_message(message)


def test_what_is_no_image_is_refused():
    with refused(BadShape, "image", (2, 2, 3)):
        convert.image_to_message(np.zeros((2, 2, 3), np.uint8), 0.0, "x")
    with refused(BadMessage, "float64"):
        convert.image_to_message(np.zeros((2, 2)), 0.0, "x")
