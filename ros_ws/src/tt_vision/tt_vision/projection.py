"""Compiled functions (kernels) of the pinhole camera with the distortion polynomial of OpenCV: projection and its inverse.

The projection is that of equations (2.3) and (2.4) of the Nagoya dissertation. Python code passes a camera to a kernel as the array
`Camera.vector`; `unpack_camera` gives its numbers their names. None of these kernels validates its arguments.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

UNDISTORT_STEPS = 8  # fixed-point steps; the error is 1e-9 pixels for lenses with |k1| < 0.3 inside the views used here


class Rotation(NamedTuple):
    """The entries of a (3, 3) rotation matrix, row by row: `xy` is the entry in row x (the first) and column y (the second)."""

    xx: float
    xy: float
    xz: float
    yx: float
    yy: float
    yz: float
    zx: float
    zy: float
    zz: float


class Optics(NamedTuple):
    """Intrinsics of a camera.

    Attributes:
        focal: Focal length, pixels.
        u0: Column of the principal point, pixels.
        v0: Row of the principal point, pixels.
        k1: First radial distortion coefficient of OpenCV.
        k2: Second radial distortion coefficient of OpenCV.
        p1: First tangential distortion coefficient of OpenCV.
        p2: Second tangential distortion coefficient of OpenCV.
        k3: Third radial distortion coefficient of OpenCV.
    """

    focal: float
    u0: float
    v0: float
    k1: float
    k2: float
    p1: float
    p2: float
    k3: float


class CameraModel(NamedTuple):
    """A camera with named numbers, as the compiled functions use it.

    A point p_table in the frame `table` is p_camera = rotation p_table + (tx, ty, tz) in the camera's frame, equation (2.3) of the
    dissertation.

    Attributes:
        rotation: Rotation from `table` to the camera's frame.
        tx: m, x coordinate of the origin of `table` in the camera's frame.
        ty: m, y coordinate of the same.
        tz: m, z coordinate of the same.
        optics: Intrinsics of the camera.
    """

    rotation: Rotation
    tx: float
    ty: float
    tz: float
    optics: Optics


@njit(cache=True, nogil=True, forceinline=True)
def unpack_rotation(matrix: Array) -> Rotation:
    """Return the entries of a rotation matrix (3, 3) as a `Rotation`."""
    return Rotation(
        matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 0], matrix[1, 1], matrix[1, 2], matrix[2, 0], matrix[2, 1], matrix[2, 2]
    )


@njit(cache=True, nogil=True, forceinline=True)
def unpack_camera(vector: Array) -> CameraModel:
    """Return the camera that the array `Camera.vector` (20,) describes."""
    v = vector
    rotation = Rotation(v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8])
    return CameraModel(rotation, v[9], v[10], v[11], Optics(v[12], v[13], v[14], v[15], v[16], v[17], v[18], v[19]))


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def rotate(r: Rotation, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the vector (x, y, z) rotated by `r`."""
    return r.xx * x + r.xy * y + r.xz * z, r.yx * x + r.yy * y + r.yz * z, r.zx * x + r.zy * y + r.zz * z


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def rotate_back(r: Rotation, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the vector (x, y, z) rotated by the inverse of `r`."""
    return r.xx * x + r.yx * y + r.zx * z, r.xy * x + r.yy * y + r.zy * z, r.xz * x + r.yz * y + r.zz * z


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def to_camera(camera: CameraModel, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Transform a point (x, y, z) m from the frame `table` to the camera's frame, m; equation (2.3) of the dissertation."""
    r = camera.rotation
    return (
        r.xx * x + r.xy * y + r.xz * z + camera.tx,
        r.yx * x + r.yy * y + r.yz * z + camera.ty,
        r.zx * x + r.zy * y + r.zz * z + camera.tz,
    )


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def distort(lens: Optics, x: float, y: float) -> tuple[float, float]:
    """Apply the lens distortion, which is the polynomial model of OpenCV.

    Args:
        lens: Intrinsics of the camera.
        x: Undistorted image coordinate X/Z of a point (X, Y, Z) in the camera's frame.
        y: Undistorted image coordinate Y/Z of that point.

    Returns:
        The distorted X/Z and Y/Z.
    """
    r2 = x * x + y * y
    radial = 1.0 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3))
    return (
        x * radial + 2.0 * lens.p1 * x * y + lens.p2 * (r2 + 2.0 * x * x),
        y * radial + lens.p1 * (r2 + 2.0 * y * y) + 2.0 * lens.p2 * x * y,
    )


@njit(cache=True, nogil=True)
def project_point(lens: Optics, x: float, y: float, z: float) -> tuple[float, float]:
    """Return the pixel (column u, row v) at which the camera sees a point (x, y, z) m in the camera's frame, z > 0."""
    a, b = distort(lens, x / z, y / z)
    return lens.focal * a + lens.u0, lens.focal * b + lens.v0


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def ray(lens: Optics, u: float, v: float) -> tuple[float, float]:
    """Return the ray through pixel (u, v) as X/Z and Y/Z in the camera's frame, with the distortion undone."""
    x0, y0 = (u - lens.u0) / lens.focal, (v - lens.v0) / lens.focal
    x, y = x0, y0
    if lens.k1 != 0.0 or lens.k2 != 0.0 or lens.p1 != 0.0 or lens.p2 != 0.0 or lens.k3 != 0.0:
        for _ in range(UNDISTORT_STEPS):
            a, b = distort(lens, x, y)
            x, y = x + x0 - a, y + y0 - b
    return x, y


@njit(cache=True, nogil=True)
def project_from_table(camera: CameraModel, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Project a point into an image.

    Args:
        camera: The camera.
        x: m, x coordinate of the point in `table`.
        y: m, y coordinate of the point in `table`.
        z: m, z coordinate of the point in `table`.

    Returns:
        The column u and the row v (pixels), both NaN if the point is not in front of the camera, and the depth along the line of sight (m).
    """
    across, down, depth = to_camera(camera, x, y, z)
    if depth <= 0.0:
        return math.nan, math.nan, depth
    u, v = project_point(camera.optics, across, down, depth)
    return u, v, depth


@njit(cache=True, nogil=True)
def project_points(vector: Array, points: Array) -> Array:
    """Return the pixels (n, 2) at which a camera sees points (n, 3) m in `table`; NaN for a point that is not in front of the camera.

    Args:
        vector: (20,) `Camera.vector` of the camera.
        points: (n, 3) m in `table`.
    """
    camera, pixels = unpack_camera(vector), np.empty((len(points), 2))
    for i in range(len(points)):
        pixels[i, 0], pixels[i, 1], _ = project_from_table(camera, points[i, 0], points[i, 1], points[i, 2])
    return pixels


@njit(cache=True, nogil=True)
def pixel_rays(vector: Array, pixels: Array) -> Array:
    """Return the unit directions (n, 3), in the camera's frame, of the rays through pixels (n, 2), with the distortion undone.

    Args:
        vector: (20,) `Camera.vector` of the camera.
        pixels: (n, 2) pixels, column and row.
    """
    optics, rays = unpack_camera(vector).optics, np.empty((len(pixels), 3))
    for i in range(len(pixels)):
        x, y = ray(optics, pixels[i, 0], pixels[i, 1])
        length = math.sqrt(x * x + y * y + 1.0)
        rays[i, 0], rays[i, 1], rays[i, 2] = x / length, y / length, 1.0 / length
    return rays
