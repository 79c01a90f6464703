"""How bright a white ball would be in each pixel: fitted to the burst itself, or from lamps that are known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.errors import check_array, check_range
from tt_core.states import Array

from .camera import Camera

LIMB = 0.30  # cosine to the line of sight below which a pixel is not used: two pixels inside the outline
WHITE = 0.85  # of the fitted light: darker pixels are marks
HARMONICS = 16  # spherical harmonics up to third order; the second holds 99 % of diffuse light (Ramamoorthi, Hanrahan 2001), not gloss
LIGHT_STEPS = 6  # of the fit, each leaving out more of the marks


@dataclass(frozen=True, eq=False)
class Lamps:
    """Lamps whose places were measured. positions: (n, 3) m in `table`. strengths: (n,) of their light at 1 m on a surface that faces them,
    it falls with the square of the distance. ambient: light from everywhere, in the same unit; only the ratios count. A lamp that is not
    where it is said to be does more harm (23 to 42 rpm) than light fitted to each burst."""

    positions: Array
    strengths: Array
    ambient: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "positions", check_array("positions", self.positions, (-1, 3)))
        object.__setattr__(self, "strengths", check_array("strengths", self.strengths, (len(self.positions),)))
        check_range("strengths", float(self.strengths.min()), 0.0, math.inf)
        check_range("ambient", self.ambient, 0.0, math.inf)

    def seen_by(self, cameras: Sequence[Camera]) -> Array:
        """(cameras, n + 1, 4): position in the camera's frame and strength; the last row holds the ambient light."""
        rows = [np.column_stack([self.positions @ c.rotation.T + c.translation, self.strengths]) for c in cameras]
        return np.array([np.vstack([row, [0.0, 0.0, 0.0, self.ambient]]) for row in rows])


@njit(cache=True, nogil=True)
def lit(stack: np.ndarray, normals: np.ndarray, views: Array, lamps: Array) -> np.ndarray:
    """(images, size, size) grey levels of a white ball, diffuse; each image has a gain of its own, because lamps flicker.

    stack: (images, size, size), background taken off. normals: (images, size, size, 4). views: (images, 23). lamps: Lamps.seen_by.
    """
    images, size = stack.shape[0], stack.shape[1]
    white = np.zeros(stack.shape, dtype=np.float32)
    ratios = np.empty(size * size)
    for m in range(images):
        of = lamps[m * len(lamps) // images]
        count = 0
        for j in range(size):
            for i in range(size):
                if normals[m, j, i, 3] <= 0.0:
                    continue
                nx, ny, nz = normals[m, j, i, 0], normals[m, j, i, 1], -normals[m, j, i, 2]
                light = of[-1, 3]
                for k in range(len(of) - 1):
                    x = of[k, 0] - views[m, 9] - BALL_RADIUS * nx
                    y = of[k, 1] - views[m, 10] - BALL_RADIUS * ny
                    z = of[k, 2] - views[m, 11] - BALL_RADIUS * nz
                    facing, square = x * nx + y * ny + z * nz, x * x + y * y + z * z
                    if facing > 0.0:
                        light += of[k, 3] * facing / (square * math.sqrt(square))
                white[m, j, i] = light
                if normals[m, j, i, 3] > 0.5 and light > 0.0 and (i + j) % 3 == 0:
                    ratios[count] = stack[m, j, i] / light
                    count += 1
        gain = np.float32(np.median(ratios[:count])) if count > 0 else np.float32(1.0)
        white[m] *= gain
    return white


@njit(cache=True, nogil=True)
def fitted(stack: np.ndarray, normals: np.ndarray, cameras: int) -> np.ndarray:
    """(images, size, size) grey levels of a white ball under the light that fits all images of a camera."""
    images, size = stack.shape[0], stack.shape[1]
    light, gains = _fit_light(stack, normals, cameras)
    white, h = np.zeros(stack.shape, dtype=np.float32), np.empty(HARMONICS)
    for m in range(images):
        of = light[m * cameras // images]
        for j in range(size):
            for i in range(size):
                if normals[m, j, i, 3] <= 0.0:
                    continue
                _harmonics(normals[m, j, i, 0], normals[m, j, i, 1], normals[m, j, i, 2], h)
                value = 0.0
                for p in range(HARMONICS):
                    value += of[p] * h[p]
                white[m, j, i] = value * gains[m]
    return white


@njit(cache=True, nogil=True)
def _harmonics(x: float, y: float, z: float, out: Array) -> None:
    """Polynomials that span the spherical harmonics up to third order."""
    out[0], out[1], out[2], out[3] = 1.0, x, y, z
    out[4], out[5], out[6], out[7], out[8] = x * y, y * z, z * x, x * x, y * y
    out[9], out[10], out[11], out[12] = x * x * x, x * x * y, x * y * y, y * y * y
    out[13], out[14], out[15] = z * x * x, z * x * y, z * y * y


@njit(cache=True, nogil=True)
def _fit_light(stack: np.ndarray, normals: np.ndarray, cameras: int) -> tuple[Array, Array]:
    """(cameras, 16) light on a white surface by its normal, and (images,) gain of each image; marks are left out step by step."""
    images, size = stack.shape[0], stack.shape[1]
    frames = images // cameras
    light, gains, h = np.zeros((cameras, HARMONICS)), np.ones(images), np.empty(HARMONICS)
    for c in range(cameras):
        for step in range(LIGHT_STEPS):
            a, b = np.zeros((HARMONICS, HARMONICS)), np.zeros(HARMONICS)
            for m in range(c * frames, (c + 1) * frames):
                above, under = 0.0, 1e-9
                for j in range(m % 3, size, 3):
                    for i in range(m % 3, size, 3):
                        if normals[m, j, i, 3] < LIMB:
                            continue
                        _harmonics(normals[m, j, i, 0], normals[m, j, i, 1], normals[m, j, i, 2], h)
                        value = stack[m, j, i]
                        if step > 0:
                            white = 0.0
                            for p in range(HARMONICS):
                                white += light[c, p] * h[p]
                            if value < WHITE * gains[m] * white or (step > 2 and value * WHITE > gains[m] * white):
                                continue
                            above += value
                            under += white
                        for p in range(HARMONICS):
                            b[p] += gains[m] * value * h[p]
                            for q in range(p + 1):
                                a[p, q] += gains[m] ** 2 * h[p] * h[q]
                if step > 1:
                    gains[m] = above / under
            for p in range(HARMONICS):
                a[p, p] *= 1.0 + 1e-4
                a[p, p] += 1e-6
                for q in range(p):
                    a[q, p] = a[p, q]
            light[c] = np.linalg.solve(a, b)
    return light, gains
