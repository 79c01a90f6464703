"""Linear calibration of a camera from points with known positions (Appendix B.2.4 of the Nagoya dissertation)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from tt_core.errors import TtError
from tt_core.states import Array

LEAST_RESECTION_POINTS = 6


class CannotCalibrate(TtError):
    """Error: points do not determine a camera, because they are too few or lie in one plane."""


class Resection(NamedTuple):
    """Pose and focal length of a camera, as `resection` estimates them from known points.

    Attributes:
        rotation: (3, 3) rotation matrix from `table` to the camera's frame.
        translation: (3,) m, the origin of `table` in the camera's frame.
        focal: Focal length, pixels.
    """

    rotation: Array
    translation: Array
    focal: float


def resection(points: Array, pixels: Array, focal: float | None) -> Resection:
    """Estimate the pose of a camera, and its focal length if that is not known, by linear least squares.

    The equations are the rows of (B.70) of the dissertation, multiplied by the depth of the point, which makes them linear.

    Args:
        points: (n, 3) m in `table`, the known points, n >= 6.
        pixels: (n, 2) pixels, where the points were seen, relative to the principal point.
        focal: Focal length in pixels; None if it is to be estimated.

    Raises:
        CannotCalibrate: Fewer than six points, or points in one plane.
    """
    if len(points) < LEAST_RESECTION_POINTS:
        raise CannotCalibrate(f"{len(points)} points cannot calibrate a camera, {LEAST_RESECTION_POINTS} needed")
    centre, scale = points.mean(axis=0), max(float(points.std()), 1e-12)
    homogeneous = np.column_stack([(points - centre) / scale, np.ones(len(points))])
    size = max(float(np.abs(pixels).max()), 1e-12)
    zero, (u, v) = np.zeros_like(homogeneous), (pixels / size).T[..., None]
    rows = np.vstack([np.hstack([homogeneous, zero, -u * homogeneous]), np.hstack([zero, homogeneous, -v * homogeneous])])
    _, singular, v_t = np.linalg.svd(rows)
    if singular[-2] < 1e-6 * singular[0]:
        raise CannotCalibrate("the points lie in one plane or in another way leave the camera open")
    p = v_t[-1].reshape(3, 4)
    p[:2] *= size
    m = p[:, :3] / scale
    t = p[:, 3] - m @ centre
    length = np.linalg.norm(m[2])
    m, t = m / length, t / length
    if (points @ m[2] + t[2]).mean() < 0.0:
        m, t = -m, -t
    if focal is None:  # the rows of K R about the principal point: f is their length across the line of sight
        focal = math.sqrt(0.5 * sum(float(row @ row - (row @ m[2]) ** 2) for row in m[:2]))
    u_, _, w = np.linalg.svd(m / np.array([[focal], [focal], [1.0]]))
    rotation = u_ @ np.diag([1.0, 1.0, np.linalg.det(u_ @ w)]) @ w
    # with the rotation fixed the translation follows from the pixels
    seen = points @ rotation.T
    a = np.zeros((2 * len(points), 3))
    a[0::2, 0], a[1::2, 1], a[:, 2] = focal, focal, -pixels.ravel()
    b = (pixels * seen[:, 2:] - focal * seen[:, :2]).ravel()
    return Resection(rotation, np.linalg.lstsq(a, b, rcond=None)[0], focal)
