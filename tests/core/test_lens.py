"""A fisheye lens in the rational model images as OpenCV's own fisheye model does."""

import cv2
import numpy as np
import pytest
from tt_core.errors import TtError
from tt_core.lens import RATIONAL_TOLERANCE, rational_from_fisheye

# coefficients of calibrated lenses, and none
LENSES = [[0.0, 0.0, 0.0, 0.0], [-0.042, -0.004, 0.001, -3e-4], [0.1, -0.05, 0.02, -0.003], [-0.0066, 0.0408, -0.0397, 0.0112]]


@pytest.mark.parametrize("fisheye", LENSES)
@pytest.mark.parametrize("degrees", [4.0, 35.0, 55.0, 68.0])
def test_it_images_as_opencv_does(fisheye, degrees):
    focal = 300.0
    matrix = np.array([[focal, 0.0, 500.0], [0.0, focal, 400.0], [0.0, 0.0, 1.0]])
    angles, around = np.meshgrid(np.radians(np.linspace(0.01, degrees, 40)), np.linspace(0.0, 6.0, 7))
    rays = np.stack([np.tan(angles) * np.cos(around), np.tan(angles) * np.sin(around), np.ones_like(angles)], axis=-1).reshape(-1, 1, 3)
    theirs = cv2.fisheye.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, np.array(fisheye))[0].reshape(-1, 2)
    reach = np.linalg.norm(theirs - matrix[:2, 2], axis=1).max() / focal
    ours = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, rational_from_fisheye(fisheye, reach, focal))[0].reshape(-1, 2)
    assert (
        np.abs(ours - theirs).max() < 2.0 * RATIONAL_TOLERANCE
    )  # pixels; RATIONAL_TOLERANCE holds at the samples of the fit, these lie between


@pytest.mark.parametrize(
    ("fisheye", "reach"),
    [
        ([0.0, 0.0, 0.0, 0.0], 1.5),  # 86 degrees
        ([-0.5, 0.0, 0.0, 0.0], 0.7),  # its radius is 0.54 at most
        ([np.nan, 0.0, 0.0, 0.0], 0.5),
        ([0.0, 0.0, 0.0, -1e9], 0.5),
    ],
)
def test_a_lens_that_no_pinhole_can_replace_is_refused(fisheye, reach):
    with pytest.raises(TtError):
        rational_from_fisheye(fisheye, reach, 300.0)
