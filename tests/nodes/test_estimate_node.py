"""Images in, one measured ball out; what cannot be measured is told and survived."""

import itertools
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image
from tt_core.constants import RPM
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.ros.convert import ball_from_message, camera_to_message, image_to_message
from tt_core.ros.qos import LATCHED, RELIABLE, SENSOR
from tt_core.ros.status import read_status
from tt_core.states import BallState
from tt_sim.footage import footage
from tt_sim.render import Scene
from tt_vision.rig import high_speed_pair

SIDES = ("left", "right")
BALL = BallState(0.0, [2.62, 0.7625, 0.34], [-5.0, 0.1, 1.0], np.array([100.0, -3000.0, 500.0]) * RPM)


@pytest.fixture(scope="module")
def frames():
    return list(footage(BALL, np.eye(3), high_speed_pair(), Scene(), Physics.liu(), np.random.default_rng(0)))


@pytest.mark.parametrize(
    "words, told_last, off",
    [
        ([], "measured", 1.0),
        (["refined:=9", "fast:=true"], "refined", 1.0),
        (["alone:=left"], "measured", 100.0),  # the distance rests on the ball's size: 1 % of it is 10 mm
        (["lamps.positions:=[2.15, 0.42, 0.75, 3.10, 0.02, 0.45]", "lamps.strengths:=[0.24, 0.5]", "lamps.ambient:=0.14"], "measured", 1.0),
    ],
    ids=["plain", "refined", "one camera", "lamps"],
)
def test_a_flight_is_measured(start, probe, until, frames, words, told_last, off):
    parameters = [word for name in words for word in ("-p", name)]
    start("tt_vision.estimate_node", "--ros-args", "-r", "/ball/measured:=/ball/seen", *parameters)
    got, told = [], []
    probe.create_subscription(Odometry, "/ball/seen", got.append, RELIABLE)
    probe.create_subscription(DiagnosticArray, "/diagnostics", told.append, RELIABLE)
    images = [probe.create_publisher(Image, f"/camera/{name}/image_raw", SENSOR) for name in SIDES]
    infos = [probe.create_publisher(CameraInfo, f"/camera/{name}/camera_info", LATCHED) for name in SIDES]
    until(lambda: all(p.get_subscription_count() == 1 for p in images + infos), probe)
    until(lambda: probe.count_publishers("/ball/seen") == 1, probe)

    starts = itertools.count(10.0)

    def send():
        offset = next(starts)
        for frame in frames:
            for publisher, image, name in zip(images, frame.images, SIDES, strict=True):
                publisher.publish(image_to_message(image, offset + frame.time, f"{name}_optical"))
            time.sleep(0.002)

    def heard(text):
        return any(text in message for array in told for _, _, message, _ in read_status(array))

    until(lambda: heard("no camera_info") or send(), probe)
    for publisher, camera, name in zip(infos, high_speed_pair(), SIDES, strict=True):
        publisher.publish(camera_to_message(camera.width, camera.height, camera.matrix, camera.distortion, f"{name}_optical"))
    until(lambda: heard("yuv422") or images[0].publish(Image(encoding="yuv422")), probe)  # refused, survived
    until(lambda: got or send(), probe)
    until(lambda: heard(told_last), probe)
    ball = ball_from_message(got[0])
    after = ball.time % 1.0
    assert np.abs(after - np.array([frame.time for frame in frames])).min() < 1e-6
    true = fly(BALL.vector, after, Physics.liu().air.coefficients)
    assert np.linalg.norm(ball.position - true[:3]) < 3e-4 * off  # m, what is promised at 95 %; the usual is 5e-5
    assert np.linalg.norm(ball.spin - BALL.spin) / RPM < (30.0 if off == 1.0 else 90.0)


def test_a_bad_parameter_ends_it_with_the_reason(start):
    node = start("tt_vision.estimate_node", "--ros-args", "-p", "frames:=2")
    assert node.wait(timeout=30) == 2
    assert "frames = 2 is outside [3, 10]" in node.stderr.read()
