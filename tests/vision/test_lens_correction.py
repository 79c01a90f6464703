"""A ball seen through any lens of OpenCV is measured as through a straight one."""

import dataclasses

import cv2
import numpy as np
import pytest
from tt_core.errors import TtError
from tt_core.lens import rational_from_fisheye
from tt_vision.capture.burst import BallDetection, Burst
from tt_vision.detection.lens_correction import Lens, straighten
from tt_vision.measure import measure_burst
from tt_vision.rig import high_speed_pair

WIDE = np.array([[600.0, 0.0, 320.0], [0.0, 603.0, 250.0], [0.0, 0.0, 1.0]])
# coefficients as calibrations give them; the rational ones are those of a depth camera
LENSES = {
    "none": [0.0] * 5,
    "plumb_bob": [-0.28, 0.09, 1e-3, -5e-4, 0.0],
    "rational": [0.45, -2.7, 5e-4, -2e-4, 1.6, 0.33, -2.5, 1.5],
    "thin prism": [-0.2, 0.05, 1e-3, -5e-4, 0.0, 0.01, 0.0, 0.0, 1e-3, -2e-4, 5e-4, 1e-4],
    "tilted": [-0.2, 0.05, 1e-3, -5e-4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.02, -0.01],
    "fisheye": rational_from_fisheye([-0.042, -0.004, 0.001, -3e-4], 0.7, 600.0),
}
STRONG = [-5.0, 10.0, 1e-2, -2e-2, 0.05]  # shifts the corners of the high speed cameras' narrow view by pixels


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("place", [(320.0, 250.0), (90.0, 80.0), (560.0, 420.0)])
def test_a_straightened_image_shows_the_world_where_its_camera_says(name, place):
    """The image holds its own column and row numbers: what is resampled tells where it was."""
    lens = Lens(WIDE, LENSES[name], 640, 480)
    pose = high_speed_pair()[0]
    column, row = (np.tile(np.arange(n, dtype=np.float32), (640 * 480 // n, 1)) for n in (640, 480))
    ball = BallDetection(None, u=place[0], v=place[1], radius=30.0)
    scale = 64.0  # 16 bits hold 640 columns to a 64th of a pixel
    images = np.array([scale * column, scale * row.T]).astype(np.uint16)
    straight = straighten(Burst((images,), np.arange(2.0), detections=((ball, ball),)), [lens], [pose])
    (resampled,), (camera,) = straight.images, straight.cameras
    assert not lens.is_nearly_straight  # nor is "none": its pixels are not square
    v, u = np.mgrid[10 : camera.height - 10 : 7, 10 : camera.width - 10 : 7]
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float)) @ camera.rotation  # in `table`
    seen = lens.project(rays @ pose.rotation.T)
    inside = ((seen > 3.0) & (seen < (636.0, 476.0))).all(axis=1)
    assert inside.sum() > 20
    off = resampled[:, v.ravel(), u.ravel()].T[inside] / scale - seen[inside]
    # pixels: OpenCV interpolates at 32 places between two pixels, a 64th off at most, and both images hold whole 64ths
    assert np.abs(off).max() < 3 / 64
    assert np.abs(off.mean(axis=0)).max() < 0.01


@pytest.mark.parametrize("name", ["plumb_bob", "rational", "thin prism", "tilted", "fisheye"])
def test_its_directions_are_those_of_its_pixels(name):
    lens = Lens(WIDE, LENSES[name], 640, 480)
    pixels = np.random.default_rng(0).uniform((0.0, 0.0), (639.0, 479.0), (200, 2))
    assert np.abs(lens.project(lens.directions(pixels)) - pixels).max() < 0.01  # pixels
    rays = np.random.default_rng(1).uniform(-0.3, 0.3, (20, 3)) + [0.0, 0.0, 1.0]
    theirs = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), WIDE, np.array(LENSES[name]))[0][:, 0]
    assert lens.project(rays) == pytest.approx(theirs, abs=1e-9)


def test_a_nearly_straight_lens_leaves_the_burst_as_it_is(rendered):
    for camera in (high_speed_pair()[0], dataclasses.replace(high_speed_pair()[0], distortion=[-0.2, 0.1, 1e-3, -2e-3, 0.05])):
        lens = Lens(camera.matrix, camera.distortion, camera.width, camera.height)
        straight = straighten(rendered.left_burst, [lens], [camera])
        assert np.shares_memory(straight.images[0], rendered.left)
        assert straight.detections == rendered.left_burst.detections
        assert straight.cameras[0].vector == pytest.approx(camera.vector, abs=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_ball_is_measured_through_a_strong_lens(film, seed):
    """The renderer knows plumb_bob exactly, so the straightened burst has a truth."""
    cameras = [dataclasses.replace(camera, distortion=STRONG) for camera in high_speed_pair()]
    shot = film(seed, cameras=cameras)
    lenses = [Lens(camera.matrix, camera.distortion, camera.width, camera.height) for camera in cameras]
    assert not any(lens.is_nearly_straight for lens in lenses)
    found = measure_burst(straighten(shot.burst, lenses, cameras))
    assert found.reason is None
    # what is promised at 95 % of a ball through straight lenses: 0.3 mm and 30 rpm
    assert np.linalg.norm(found.ball.position - shot.ball.position) < 3e-4
    assert np.linalg.norm(found.ball.spin - shot.ball.spin) < 3.1


@pytest.mark.parametrize(
    ("matrix", "distortion"),
    [
        (WIDE, [-3.0, 0.0, 0.0, 0.0]),  # folds the image
        (WIDE, [1e9, -1e9, 1e9, 1e9]),
        (WIDE, [0.1]),
        (WIDE, [np.nan, 0.0, 0.0, 0.0]),
        (WIDE * [[4.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]], [0.0] * 5),  # fx four times fy
    ],
)
def test_a_lens_that_cannot_be_undone_is_refused(matrix, distortion):
    with pytest.raises(TtError):
        Lens(matrix, distortion, 640, 480)
