"""The camera sees what it must, and is found again from what it saw."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tt_core.errors import BadShape, NotFinite, OutOfRange
from tt_vision.camera import Camera, CannotTriangulate, NotARotation, calibrate, triangulate
from tt_vision.resection import CannotCalibrate
from tt_vision.rig import DISTANCE, SIGHT_ANGLE, VIEW_CENTRE, high_speed_pair

LEFT, RIGHT = high_speed_pair()
BENT = dataclasses.replace(LEFT, distortion=[-0.2, 0.1, 1e-3, -2e-3, 0.05])
near = st.floats(-0.05, 0.05)


def around(*offset):
    return (np.array(VIEW_CENTRE) + offset)[None]


def test_the_rig_stands_as_described():
    for camera in (LEFT, RIGHT):
        assert np.linalg.norm(camera.position - VIEW_CENTRE) == pytest.approx(DISTANCE)
        assert camera.project(around(0, 0, 0))[0] == pytest.approx([115.5, 115.5])
        assert camera.position[1] < VIEW_CENTRE[1] and camera.position[2] > VIEW_CENTRE[2]
        assert (camera.project(around(0, 0, 0.01))[0] - 115.5) @ [0, 1] < 0.0  # up in the world is up in the image
    assert math.acos(LEFT.rotation[2] @ RIGHT.rotation[2]) == pytest.approx(SIGHT_ANGLE)
    flight = LEFT.project(np.vstack([around(0.02, 0, 0), around(-0.02, 0, 0)]))
    assert flight[1, 0] < flight[0, 0]  # a ball to -x flies to the left


@given(near, near, near)
def test_the_ray_of_a_pixel_goes_through_the_point(x, y, z):
    for camera in (LEFT, BENT):
        point = around(x, y, z)
        ray = camera.rays(camera.project(point))[0]
        seen = camera.rotation @ point[0] + camera.translation
        # 1e-9: an angle that moves a pixel by 2e-6
        assert np.linalg.norm(np.cross(ray, seen)) / np.linalg.norm(seen) < 1e-9


def test_projection_is_that_of_opencv():
    import cv2

    points = np.array(VIEW_CENTRE) + np.random.default_rng(0).uniform(-0.05, 0.05, (20, 3))
    theirs = cv2.projectPoints(points, cv2.Rodrigues(BENT.rotation)[0], BENT.translation, BENT.matrix, BENT.distortion)[0][:, 0]
    assert BENT.project(points) == pytest.approx(theirs, abs=1e-9)


def test_a_point_behind_is_not_seen():
    assert np.isnan(LEFT.project(2.0 * LEFT.position[None] - VIEW_CENTRE)).all()


@given(near, near, near)
def test_triangulation_undoes_projection(x, y, z):
    point = around(x, y, z)
    for pair in ((LEFT, RIGHT), (BENT, RIGHT)):
        pixels = np.array([camera.project(point) for camera in pair])
        assert triangulate(pair, pixels) == pytest.approx(point, abs=1e-9)
        assert triangulate(pair, pixels[:, 0]) == pytest.approx(point[0], abs=1e-9)


def test_triangulation_shares_the_error_of_the_image():
    rng = np.random.default_rng(0)
    points = np.repeat(around(0, 0, 0), 2000, axis=0)
    pixels = np.array([camera.project(points) + rng.normal(0.0, 0.1, (2000, 2)) for camera in (LEFT, RIGHT)])
    spread = triangulate((LEFT, RIGHT), pixels).std(axis=0)
    # 0.1 pixels is 57 um on the ball; across the baseline two looks average, along it 45 deg between the rays widen it
    assert spread.max() < 57e-6 / math.sin(SIGHT_ANGLE / 2)


def test_what_cannot_be_triangulated_says_so():
    pixels = np.array([LEFT.project(around(0, 0, 0))])
    with pytest.raises(CannotTriangulate):
        triangulate((LEFT,), pixels)
    with pytest.raises(CannotTriangulate):
        triangulate((LEFT, LEFT), np.repeat(pixels, 2, axis=0))


@pytest.mark.parametrize(
    ("method", "focal", "bent"),
    [("nonlinear", True, False), ("nonlinear", False, False), ("linear", False, False), ("nonlinear", True, True)],
)
def test_calibration_finds_the_camera_again(method, focal, bent):
    camera = dataclasses.replace(RIGHT, distortion=[-0.2, 0.1, 0.0, 0.0]) if bent else RIGHT
    points = np.array(VIEW_CENTRE) + np.random.default_rng(0).uniform(-0.06, 0.06, (40, 3))
    found = calibrate(points, camera.project(points), focal_length=35e-3 if focal else None, distortion=bent, method=method)
    assert found.project(points) == pytest.approx(camera.project(points), abs=1e-5)
    assert found.position == pytest.approx(camera.position, abs=1e-6)
    assert found.rotation == pytest.approx(camera.rotation, abs=1e-7)
    assert found.focal_length == pytest.approx(35e-3, rel=1e-6)


def test_calibration_averages_the_error_of_the_image():
    rng = np.random.default_rng(1)
    points = np.array(VIEW_CENTRE) + rng.uniform(-0.06, 0.06, (60, 3))
    pixels = RIGHT.project(points) + rng.normal(0.0, 0.1, (60, 2))
    nonlinear, linear = (calibrate(points, pixels, focal_length=35e-3, method=m) for m in ("nonlinear", "linear"))
    off = [np.sqrt(((camera.project(points) - RIGHT.project(points)) ** 2).mean()) for camera in (nonlinear, linear)]
    assert off[0] < 0.1 * math.sqrt(6 / 120) * 2.0  # twice what six parameters of 120 numbers leave
    assert off[0] <= off[1]


def test_what_cannot_be_calibrated_says_so():
    flat = np.array(VIEW_CENTRE) + np.random.default_rng(0).uniform(-0.05, 0.05, (20, 3)) * [1.0, 1.0, 0.0]
    with pytest.raises(CannotCalibrate):
        calibrate(flat, RIGHT.project(flat))
    with pytest.raises(CannotCalibrate):
        calibrate(flat[:5], RIGHT.project(flat[:5]))
    with pytest.raises(BadShape):
        calibrate(flat, RIGHT.project(flat)[:5])


def test_bad_cameras_name_what_is_bad():
    with pytest.raises(NotFinite) as error:
        dataclasses.replace(LEFT, translation=[0.0, np.nan, 0.0])
    assert error.value.name == "translation"
    with pytest.raises(NotARotation):
        dataclasses.replace(LEFT, rotation=2.0 * np.eye(3))
    with pytest.raises(NotARotation):
        dataclasses.replace(LEFT, rotation=np.diag([1.0, 1.0, -1.0]))
    with pytest.raises(OutOfRange) as error:
        dataclasses.replace(LEFT, focal_length=0.0)
    assert (error.value.name, error.value.value) == ("focal_length", 0.0)
    with pytest.raises(BadShape) as error:
        dataclasses.replace(LEFT, distortion=[0.1])
    assert (error.value.name, error.value.shape) == ("distortion", (1,))
    with pytest.raises(BadShape):
        LEFT.project(np.zeros((3, 2)))


def test_a_turned_world_is_seen_the_same():
    turn = Rotation.random(random_state=0).as_matrix()
    points = np.array(VIEW_CENTRE) + np.random.default_rng(0).uniform(-0.05, 0.05, (20, 3))
    turned = Camera(LEFT.rotation @ turn.T, LEFT.translation, LEFT.focal_length, LEFT.pixel_size, 232, 232)
    assert turned.project(points @ turn.T) == pytest.approx(LEFT.project(points), abs=1e-9)
