"""Pixels in, the ball in each pair of frames out; a measured ball starts it; nonsense is survived."""

import itertools
import math
import time

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from nav_msgs.msg import Odometry
from refusals import is_told
from sensor_msgs.msg import CameraInfo
from tt_core.errors import MessageFailure, ValueFailure
from tt_core.failures import Failure
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.ros.convert import ball_from_message, ball_to_message, camera_to_message, pixel_to_message
from tt_core.ros.diagnostics import Event, read_status
from tt_core.ros.qos import LATCHED, RELIABLE, SENSOR
from tt_core.states import BallState
from tt_vision.rig import WIDE_RATE, WIDE_SIDES, wide_pair

START = np.array([2.5, 0.76, 0.34, -5.0, 0.1, 1.5, 10.0, -150.0, 20.0])


def ball_at(since):
    return fly(START, since, Physics.liu().air.coefficients)


def test_pixels_in_are_the_ball_out_and_nonsense_is_survived(start, probe, until):
    start("tt_vision.track_node")
    got, arrays = [], []
    probe.create_subscription(Odometry, "/ball/state", got.append, RELIABLE)
    probe.create_subscription(DiagnosticArray, "/diagnostics", arrays.append, RELIABLE)
    infos = [probe.create_publisher(CameraInfo, f"/camera/{name}/camera_info", LATCHED) for name in WIDE_SIDES]
    pixels = [probe.create_publisher(PointStamped, f"/camera/{name}/ball", SENSOR) for name in WIDE_SIDES]
    first_estimate, measured = (probe.create_publisher(Odometry, f"/ball/{name}", RELIABLE) for name in ("first", "measured"))
    until(lambda: all(p.get_subscription_count() == 1 for p in [*infos, *pixels, first_estimate, measured]), probe)
    until(lambda: probe.count_publishers("/ball/state") == 1, probe)

    def statuses():
        return [one for array in arrays for one in read_status(array)]

    for camera, publisher, name in zip(wide_pair(), infos, WIDE_SIDES, strict=True):
        publisher.publish(camera_to_message(camera.width, camera.height, camera.matrix, camera.distortion, f"{name}_optical"))
    measured.publish(Odometry())  # no frame
    until(lambda: is_told(Failure(MessageFailure.OTHER_FRAME), statuses()), probe)
    bad = pixel_to_message(100.0, [math.nan, 1.0], "wide_left_optical")
    until(lambda: pixels[0].publish(bad) or is_told(Failure(ValueFailure.NOT_FINITE, name="pixel"), statuses()), probe)

    def send(first):
        """Send 30 frames of a flight that begins at `first` (s)."""
        for since in np.arange(30) / WIDE_RATE:
            for camera, publisher, name in zip(wide_pair(), pixels, WIDE_SIDES, strict=True):
                pixel = camera.project(ball_at(since)[None, :3])[0]
                publisher.publish(pixel_to_message(first + since, pixel, f"{name}_optical"))
            time.sleep(0.002)

    firsts = itertools.count(100.0, 5.0)  # again, should some pixels or states be lost
    until(lambda: len(got) > 10 or send(next(firsts)), probe)
    ball = ball_from_message(got[-1])
    off = ball.vector - ball_at(ball.time % 5.0)
    assert np.abs(off[:3]).max() < 0.01  # the pixels are exact; 0.01 m is what an assumed bias of a camera may do, 1 pixel
    assert any(one.event is Event.FOLLOWED for one in statuses())

    later = BallState.from_vector(30000.0, START, np.diag(np.repeat([1e-3, 0.02, 5.0], 3) ** 2))
    measured.publish(ball_to_message(later))
    until(lambda: any(message.header.stamp.sec == 30000 for message in got), probe)
    (state,) = [ball_from_message(message) for message in got if message.header.stamp.sec == 30000]
    assert np.abs(state.vector - START).max() < 1e-6

    # a first estimate starts it, and the refined measurement of the same ball replaces it
    rough = BallState.from_vector(40000.0, START + [0.01, 0.0, 0.0, 0.05, 0.0, 0.0, 5.0, 0.0, 0.0], np.diag(np.full(9, 1e-2)))
    first_estimate.publish(ball_to_message(rough))
    until(lambda: any(message.header.stamp.sec == 40000 for message in got), probe)
    assert np.abs(ball_from_message(got[-1]).vector - rough.vector).max() < 1e-6
    measured.publish(ball_to_message(BallState.from_vector(40000.0, START, np.diag(np.full(9, 1e-6)))))
    until(lambda: sum(message.header.stamp.sec == 40000 for message in got) == 2, probe)
    assert np.abs(ball_from_message(got[-1]).vector - START).max() < 1e-6
