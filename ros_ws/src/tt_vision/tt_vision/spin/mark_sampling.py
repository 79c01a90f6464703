"""Look up the brightness of the ball's surface at a given place, in one image or in the image of a frame that shows the place best."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.states import Array

from ..detection.illumination import LIMB
from ..projection import distort, rotate, rotate_back, unpack_rotation
from .surface_map import MarkImages, view_optics

LEAST_WEIGHT = 0.02  # least weight with which a place counts as seen; a pixel that is seen from straight above has the weight 1

POINT_MARK = np.dtype([("brightness", "f8"), ("weight", "f8")])
"""The surface at a point of the ball. brightness: white is 1. weight: what it rests on, 0 where nothing is known."""


class Sample(NamedTuple):
    """The ball's surface at one place, as an image shows it.

    Attributes:
        weight: Weight of the brightness; 0 if the image does not show the place.
        brightness: Brightness of the surface, white is 1.
        gx: Derivative of the brightness by the x component of the place's unit normal.
        gy: Derivative by the y component.
        gz: Derivative by the z component.
    """

    weight: float
    brightness: float
    gx: float
    gy: float
    gz: float


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def sample(marks: np.ndarray, m: int, view: np.ndarray, nx: float, ny: float, nz: float) -> Sample:
    """Return the ball's surface at one place, as one image shows it. The gradient is in the camera's frame.

    Args:
        marks: (images, n, n) MARK, the surface in all images.
        m: Index of the image.
        view: VIEW of this image: how the camera sees the ball.
        nx: x component of the place's outward unit normal in the camera's frame.
        ny: y component of this normal.
        nz: z component of this normal.
    """
    centre = view.centre  # type: ignore[attr-defined]
    cx, cy, cz = centre[0], centre[1], centre[2]
    towards = -(nx * cx + ny * cy + nz * cz)
    if towards < 0.0 or towards * towards < LIMB * LIMB * (cx * cx + cy * cy + cz * cz):
        return Sample(0.0, 0.0, 0.0, 0.0, 0.0)
    px, py, pz = cx + BALL_RADIUS * nx, cy + BALL_RADIUS * ny, cz + BALL_RADIUS * nz
    near = 1.0 / pz
    optics = view_optics(view)
    u, v = distort(optics, px * near, py * near)
    u, v = optics.focal * u + optics.u0, optics.focal * v + optics.v0
    i, j = int(u), int(v)
    if i < 0 or j < 0 or i >= marks.shape[2] - 1 or j >= marks.shape[1] - 1:
        return Sample(0.0, 0.0, 0.0, 0.0, 0.0)
    a, b = np.float32(u - i), np.float32(v - j)
    one = np.float32(1.0)
    q00, q10, q01, q11 = (one - a) * (one - b), a * (one - b), (one - a) * b, a * b
    p00, p10, p01, p11 = marks[m, j, i], marks[m, j, i + 1], marks[m, j + 1, i], marks[m, j + 1, i + 1]
    weight = q00 * p00.weight + q10 * p10.weight + q01 * p01.weight + q11 * p11.weight
    if weight <= np.float32(LEAST_WEIGHT):
        return Sample(0.0, 0.0, 0.0, 0.0, 0.0)
    brightness = q00 * p00.brightness + q10 * p10.brightness + q01 * p01.brightness + q11 * p11.brightness
    scale = optics.focal * BALL_RADIUS * near
    gu = scale * (q00 * p00.slope_u + q10 * p10.slope_u + q01 * p01.slope_u + q11 * p11.slope_u)
    gv = scale * (q00 * p00.slope_v + q10 * p10.slope_v + q01 * p01.slope_v + q11 * p11.slope_v)
    return Sample(np.float64(weight), np.float64(brightness), gu, gv, -(gu * px + gv * py) * near)


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def sample_best(marks: np.ndarray, views: np.ndarray, frame: int, frames: int, x: float, y: float, z: float) -> Sample:
    """Return the ball's surface at one place in one frame, from the camera that sees the place best. The gradient is in `table`.

    Args:
        marks: (images, n, n) MARK, the surface in all images.
        views: (images,) VIEW, how a camera sees the ball in each image.
        frame: Index of the frame.
        frames: Number of frames.
        x: x component of the place's outward unit normal in `table`.
        y: y component of this normal.
        z: z component of this normal.

    Returns:
        The surface; its weight is 0 if no camera shows the place.
    """
    best, cosine = -1, LIMB
    for m in range(frame, len(views), frames):
        towards = views[m].towards_camera
        facing = towards[0] * x + towards[1] * y + towards[2] * z
        if facing > cosine:
            best, cosine = m, facing
    if best < 0:
        return Sample(0.0, 0.0, 0.0, 0.0, 0.0)
    view = views[best]
    rotation = unpack_rotation(view.rotation)
    nx, ny, nz = rotate(rotation, x, y, z)
    seen = sample(marks, best, view, nx, ny, nz)
    gx, gy, gz = rotate_back(rotation, seen.gx, seen.gy, seen.gz)
    return Sample(seen.weight, seen.brightness, gx, gy, gz)


@njit(cache=True, nogil=True, error_model="numpy")
def first_samples(points: Array, pairs: np.ndarray, images: MarkImages) -> np.ndarray:
    """Return the ball's surface at each point in the first frame of each pair of frames.

    Args:
        points: (n, 3) unit vectors in `table`, outward normals of the points.
        pairs: (p, 2) indices of frames, the earlier one first.
        images: The ball's surface in all images.

    Returns:
        (p, n) POINT_MARK; the weight is 0 where no camera shows the point.
    """
    marks, views, frames = images.marks, images.views, len(images.times)
    out = np.zeros((len(pairs), len(points)), dtype=POINT_MARK)
    for p in range(len(pairs)):
        for q in range(len(points)):
            seen = sample_best(marks, views, pairs[p, 0], frames, points[q, 0], points[q, 1], points[q, 2])
            out[p, q].weight, out[p, q].brightness = seen.weight, seen.brightness
    return out
