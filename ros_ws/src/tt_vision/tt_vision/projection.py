"""Kernels of the pinhole camera with the distortion polynomial of OpenCV: projection (2.3), (2.4) and its inverse.

From Python a camera comes as the array `Camera.vector`; `unpack_camera` gives its numbers names. None of these kernels validates its
arguments.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

UNDISTORT_STEPS = 8  # fixed-point steps; the error is 1e-9 pixels for lenses with |k1| < 0.3 inside the views used here


class Rotation(NamedTuple):
    """The entries of a (3, 3) rotation matrix, row by row: `xy` is row x, column y."""

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
        k1: Radial distortion coefficient of OpenCV; so are `k2` and `k3`.
        k2: See `k1`.
        p1: Tangential distortion coefficient of OpenCV; so is `p2`.
        p2: See `p1`.
        k3: See `k1`.
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
    """A camera: p_camera = rotation p_table + (tx, ty, tz), (2.3).

    Attributes:
        rotation: From `table` to the camera's frame.
        tx: Translation along the camera's x axis, m; so are `ty` and `tz` along y and z.
        ty: See `tx`.
        tz: See `tx`.
        optics: Intrinsics.
    """

    rotation: Rotation
    tx: float
    ty: float
    tz: float
    optics: Optics


@njit(cache=True, nogil=True, forceinline=True)
def unpack_rotation(matrix: Array) -> Rotation:
    """Return the entries of a rotation matrix (3, 3)."""
    return Rotation(
        matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 0], matrix[1, 1], matrix[1, 2], matrix[2, 0], matrix[2, 1], matrix[2, 2]
    )


@njit(cache=True, nogil=True, forceinline=True)
def unpack_camera(vector: Array) -> CameraModel:
    """Return the camera that `Camera.vector` (20,) describes."""
    v = vector
    rotation = Rotation(v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8])
    return CameraModel(rotation, v[9], v[10], v[11], Optics(v[12], v[13], v[14], v[15], v[16], v[17], v[18], v[19]))


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def rotate(r: Rotation, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return r (x, y, z)."""
    return r.xx * x + r.xy * y + r.xz * z, r.yx * x + r.yy * y + r.yz * z, r.zx * x + r.zy * y + r.zz * z


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def rotate_back(r: Rotation, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the transpose of r times (x, y, z)."""
    return r.xx * x + r.yx * y + r.zx * z, r.xy * x + r.yy * y + r.zy * z, r.xz * x + r.yz * y + r.zz * z


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def to_camera(camera: CameraModel, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a point (x, y, z) m of `table` in the camera's frame, m (2.3)."""
    r = camera.rotation
    return (
        r.xx * x + r.xy * y + r.xz * z + camera.tx,
        r.yx * x + r.yy * y + r.yz * z + camera.ty,
        r.zx * x + r.zy * y + r.zz * z + camera.tz,
    )


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def distort(lens: Optics, x: float, y: float) -> tuple[float, float]:
    """Return the distorted X/Z and Y/Z of x = X/Z and y = Y/Z in the camera's frame: the polynomial model of OpenCV."""
    r2 = x * x + y * y
    radial = 1.0 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3))
    return (
        x * radial + 2.0 * lens.p1 * x * y + lens.p2 * (r2 + 2.0 * x * x),
        y * radial + lens.p1 * (r2 + 2.0 * y * y) + 2.0 * lens.p2 * x * y,
    )


@njit(cache=True, nogil=True)
def project_point(lens: Optics, x: float, y: float, z: float) -> tuple[float, float]:
    """Return the pixel (u, v) of a point (x, y, z) m in the camera's frame, z > 0."""
    a, b = distort(lens, x / z, y / z)
    return lens.focal * a + lens.u0, lens.focal * b + lens.v0


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def ray(lens: Optics, u: float, v: float) -> tuple[float, float]:
    """Return X/Z and Y/Z in the camera's frame of the ray through pixel (u, v), the distortion undone."""
    x0, y0 = (u - lens.u0) / lens.focal, (v - lens.v0) / lens.focal
    x, y = x0, y0
    if lens.k1 != 0.0 or lens.k2 != 0.0 or lens.p1 != 0.0 or lens.p2 != 0.0 or lens.k3 != 0.0:
        for _ in range(UNDISTORT_STEPS):
            a, b = distort(lens, x, y)
            x, y = x + x0 - a, y + y0 - b
    return x, y


@njit(cache=True, nogil=True)
def project_from_table(camera: CameraModel, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return pixel u, v and depth (m) of a point (x, y, z) m in `table`; the pixel is NaN if the point is not in front of the camera."""
    across, down, depth = to_camera(camera, x, y, z)
    if depth <= 0.0:
        return math.nan, math.nan, depth
    u, v = project_point(camera.optics, across, down, depth)
    return u, v, depth


@njit(cache=True, nogil=True)
def project_points(vector: Array, points: Array) -> Array:
    """Return the pixels (n, 2) of points (n, 3) m in `table`, NaN for points that are not in front of the camera `Camera.vector`."""
    camera, pixels = unpack_camera(vector), np.empty((len(points), 2))
    for i in range(len(points)):
        pixels[i, 0], pixels[i, 1], _ = project_from_table(camera, points[i, 0], points[i, 1], points[i, 2])
    return pixels


@njit(cache=True, nogil=True)
def pixel_rays(vector: Array, pixels: Array) -> Array:
    """Return the unit directions (n, 3), in the frame of the camera `Camera.vector`, of the rays through pixels (n, 2)."""
    optics, rays = unpack_camera(vector).optics, np.empty((len(pixels), 3))
    for i in range(len(pixels)):
        x, y = ray(optics, pixels[i, 0], pixels[i, 1])
        length = math.sqrt(x * x + y * y + 1.0)
        rays[i, 0], rays[i, 1], rays[i, 2] = x / length, y / length, 1.0 / length
    return rays
