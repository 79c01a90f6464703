"""The brightness of the ball's surface at a given place, from the marks in one image or from the best image of a frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.states import Array

from ..detection.illumination import LIMB
from ..projection import distort, rotate, rotate_back, unpack_rotation
from .surface_map import MarkImages, view_optics

LEAST_WEIGHT = 0.02  # of a pixel that is seen straight on, below which a place is not seen

POINT_MARK = np.dtype([("brightness", "f8"), ("weight", "f8")])
"""The surface at a point of the ball. brightness: white is 1. weight: what it rests on, 0 where nothing is known."""


class Sample(NamedTuple):
    """The surface at one place as an image shows it.

    Attributes:
        weight: 0 where the image does not show the place.
        brightness: White is 1.
        gx: Gradient (gx, gy, gz) of the brightness by the unit normal of the place; so are `gy` and `gz`.
        gy: See `gx`.
        gz: See `gx`.
    """

    weight: float
    brightness: float
    gx: float
    gy: float
    gz: float


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def sample(marks: np.ndarray, m: int, view: np.ndarray, nx: float, ny: float, nz: float) -> Sample:
    """Return what one image shows at a place.

    Args:
        marks: (images, n, n) MARK.
        m: Which image.
        view: Its VIEW.
        nx: Of the outward unit normal (nx, ny, nz) in the camera's frame; so are `ny` and `nz`. The gradient is by it.
        ny: See `nx`.
        nz: See `nx`.
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
    """Return what the camera shows that sees a place best in a frame.

    Args:
        marks: (images, n, n) MARK.
        views: (images,) VIEW.
        frame: Which frame.
        frames: Number of frames.
        x: Of the outward unit normal (x, y, z) of the place in `table`; so are `y` and `z`. The gradient is by it.
        y: See `x`.
        z: See `x`.
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
    """Return each point in the first frame of each pair, (pairs, points) POINT_MARK.

    Args:
        points: (n, 3) unit vectors in `table`.
        pairs: (p, 2) frames, the earlier one first.
        images: The marks.
    """
    marks, views, frames = images.marks, images.views, len(images.times)
    out = np.zeros((len(pairs), len(points)), dtype=POINT_MARK)
    for p in range(len(pairs)):
        for q in range(len(points)):
            seen = sample_best(marks, views, pairs[p, 0], frames, points[q, 0], points[q, 1], points[q, 2])
            out[p, q].weight, out[p, q].brightness = seen.weight, seen.brightness
    return out
