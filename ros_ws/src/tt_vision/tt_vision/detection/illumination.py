"""How bright a white ball would be in each pixel: fitted to the burst itself, or from lamps that are known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.errors import check_array, check_range
from tt_core.states import Array

from ..camera import Camera

LIMB = 0.30  # cosine to the line of sight below which a pixel is not used: two pixels inside the outline
WHITE = 0.85  # of the fitted light: darker pixels are marks
HARMONICS = 16  # spherical harmonics up to third order; the second holds 99 % of diffuse light (Ramamoorthi, Hanrahan 2001), not gloss
GLOSS = 4  # harmonics of what gloss adds: a constant and a slope
GLOSS_RIDGE = 1e-4  # of the light's weight in the fit, that keeps gloss at zero where the marks do not tell it from light
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


@dataclass(frozen=True, eq=False)
class Light:
    """What lights the ball in the images of a burst.

    harmonics: (cameras, 16) grey levels of a white ball by its normal; zero where lamps are known. gloss: (cameras, 4), what shines from
    marks and white alike. gains: (images,), because lamps flicker. lamps: Lamps.seen_by, (cameras, 0, 4) where they are not known.
    """

    harmonics: Array
    gloss: Array
    gains: Array
    lamps: Array

    @classmethod
    def of(cls, stack: np.ndarray, normals: np.ndarray, views: Array, cameras: Sequence[Camera], lamps: Lamps | None) -> Light:
        """Fitted to the images, or of known lamps; arrays as in `shade`."""
        gloss = np.zeros((len(cameras), GLOSS))
        if lamps is None:
            harmonics, gains = _fit(stack, normals, len(cameras))
            return cls(harmonics, gloss, gains, np.zeros((len(cameras), 0, 4)))
        seen = lamps.seen_by(cameras)
        return cls(np.zeros((len(cameras), HARMONICS)), gloss, _gains(stack, normals, views, seen), seen)

    @property
    def known(self) -> bool:
        """Whether the lamps are."""
        return self.lamps.shape[1] > 0

    def again(self, stack: np.ndarray, normals: np.ndarray, albedo: np.ndarray) -> Light:
        """Fitted once more, with gloss, now that the marks are known; albedo: (images, size, size), 0 where it is not. Known lamps stay."""
        if self.known:
            return self
        harmonics, gloss = _fit_to_marks(stack, normals, albedo, self.gains, len(self.harmonics))
        return replace(self, harmonics=harmonics, gloss=gloss)


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def level(x: float, y: float, z: float, cx: float, cy: float, cz: float, h: Array, lamps: Array) -> float:
    """Grey level, before the gain, of a white ball around (cx, cy, cz) m where its outward normal is (x, y, -z), in the camera's frame.

    h: (16,) harmonics as in `polynomials`, and lamps: (n + 1, 4) of that camera.
    """
    if len(lamps) == 0:
        first = h[0] + x * (h[1] + x * (h[7] + x * h[9] + y * h[10]) + y * (h[4] + y * h[11])) + y * (h[2] + y * (h[8] + y * h[12]))
        return first + z * (h[3] + x * (h[6] + x * h[13] + y * h[14]) + y * (h[5] + y * h[15]))
    light = lamps[-1, 3]
    for k in range(len(lamps) - 1):
        dx, dy, dz = lamps[k, 0] - cx - BALL_RADIUS * x, lamps[k, 1] - cy - BALL_RADIUS * y, lamps[k, 2] - cz + BALL_RADIUS * z
        facing, square = dx * x + dy * y - dz * z, dx * dx + dy * dy + dz * dz
        if facing > 0.0:
            light += lamps[k, 3] * facing / (square * math.sqrt(square))
    return light


@njit(cache=True, nogil=True, error_model="numpy")
def shade(normals: np.ndarray, views: Array, harmonics: Array, gloss: Array, gains: Array, lamps: Array) -> tuple[np.ndarray, np.ndarray]:
    """(white, shine), both (images, size, size) float32: grey levels of a white ball, and what its gloss adds; 0 off the ball.

    normals: (images, size, size, 4) in the camera's frame, z towards the camera, and the cosine to the line of sight. views: (images, 23).
    """
    images, size = normals.shape[0], normals.shape[1]
    white, sheen = np.zeros(normals.shape[:3], dtype=np.float32), np.zeros(normals.shape[:3], dtype=np.float32)
    cameras = len(harmonics)
    for m in range(images):
        c = m * cameras // images
        of, adds, lit, gain = harmonics[c], gloss[c], lamps[c], gains[m]
        cx, cy, cz = views[m, 9], views[m, 10], views[m, 11]
        for j in range(size):
            for i in range(size):
                if normals[m, j, i, 3] > 0.0:
                    x, y, z = normals[m, j, i, 0], normals[m, j, i, 1], normals[m, j, i, 2]
                    white[m, j, i] = gain * level(x, y, z, cx, cy, cz, of, lit)
                    sheen[m, j, i] = gain * (adds[0] + x * adds[1] + y * adds[2] + z * adds[3])
    return white, sheen


@njit(cache=True, nogil=True, error_model="numpy")
def _gains(stack: np.ndarray, normals: np.ndarray, views: Array, lamps: Array) -> Array:
    """(images,) median of grey level over the light of the lamps."""
    images, size = stack.shape[0], stack.shape[1]
    gains, ratios, unused = np.ones(images), np.empty(size * size), np.empty(0)
    for m in range(images):
        count, lit = 0, lamps[m * len(lamps) // images]
        cx, cy, cz = views[m, 9], views[m, 10], views[m, 11]
        for j in range(m % 3, size, 3):
            for i in range(size):
                if normals[m, j, i, 3] > 0.5:
                    light = level(normals[m, j, i, 0], normals[m, j, i, 1], normals[m, j, i, 2], cx, cy, cz, unused, lit)
                    if light > 0.0:
                        ratios[count] = stack[m, j, i] / light
                        count += 1
        if count > 0:
            gains[m] = np.median(ratios[:count])
    return gains


@njit(cache=True, nogil=True, error_model="numpy")
def polynomials(x: float, y: float, z: float, out: Array) -> None:
    """Polynomials that span the spherical harmonics up to third order."""
    out[0], out[1], out[2], out[3] = 1.0, x, y, z
    out[4], out[5], out[6], out[7], out[8] = x * y, y * z, z * x, x * x, y * y
    out[9], out[10], out[11], out[12] = x * x * x, x * x * y, x * y * y, y * y * y
    out[13], out[14], out[15] = z * x * x, z * x * y, z * y * y


@njit(cache=True, nogil=True, error_model="numpy")
def _fit(stack: np.ndarray, normals: np.ndarray, cameras: int) -> tuple[Array, Array]:
    """(cameras, 16) light on a white surface by its normal, and (images,) gain of each image; marks are left out step by step."""
    images, size = stack.shape[0], stack.shape[1]
    frames = images // cameras
    light, gains = np.zeros((cameras, HARMONICS)), np.ones(images)
    most = frames * ((size + 3) // 4) ** 2
    columns, values, ends, h = np.empty((HARMONICS, most)), np.empty(most), np.empty(frames, dtype=np.int64), np.empty(HARMONICS)
    for c in range(cameras):
        n = 0
        for k in range(frames):
            m = c * frames + k
            for j in range(m % 4, size, 4):
                for i in range(m % 4, size, 4):
                    if normals[m, j, i, 3] >= LIMB:
                        polynomials(normals[m, j, i, 0], normals[m, j, i, 1], normals[m, j, i, 2], h)
                        columns[:, n], values[n] = h, stack[m, j, i]
                        n += 1
            ends[k] = n
        gain = np.ones(n)
        for step in range(LIGHT_STEPS):
            if step > 0:
                white, n = _products(columns, light[c], n), 0
                for k in range(frames):
                    m = c * frames + k
                    above, under = 0.0, 1e-9
                    for i in range(n, ends[k]):
                        expected = gains[m] * white[i]
                        gain[i] = 0.0 if values[i] < WHITE * expected or (step > 2 and values[i] * WHITE > expected) else gains[m]
                        if gain[i] > 0.0:
                            above, under = above + values[i], under + white[i]
                    n = ends[k]
                    if step > 1:
                        gains[m] = above / under
            a, b = _normal_equations(columns, gain, values, n)
            for p in range(HARMONICS):
                a[p, p] = (1.0 + 1e-4) * a[p, p] + 1e-6
            light[c] = np.linalg.solve(a, b)
    return light, gains


@njit(cache=True, nogil=True)
def _fit_to_marks(stack: np.ndarray, normals: np.ndarray, albedo: np.ndarray, gains: Array, cameras: int) -> tuple[Array, Array]:
    """(cameras, 16) light and (cameras, 4) gloss with which the marks give the images best, pixel by pixel where `albedo` is known."""
    images, size = stack.shape[0], stack.shape[1]
    frames, both = images // cameras, HARMONICS + GLOSS
    light, gloss, h = np.zeros((cameras, HARMONICS)), np.zeros((cameras, GLOSS)), np.empty(HARMONICS)
    most = frames * ((size + 2) // 3) ** 2
    columns, gain, values = np.empty((both, most)), np.empty(most), np.empty(most)
    for c in range(cameras):
        n = 0
        for m in range(c * frames, (c + 1) * frames):
            for j in range(m % 3, size, 3):
                for i in range(m % 3, size, 3):
                    if normals[m, j, i, 3] < LIMB or albedo[m, j, i] <= 0.0:
                        continue
                    polynomials(normals[m, j, i, 0], normals[m, j, i, 1], normals[m, j, i, 2], h)
                    columns[:HARMONICS, n], columns[HARMONICS:, n] = albedo[m, j, i] * h, h[:GLOSS]
                    gain[n], values[n] = gains[m], stack[m, j, i]
                    n += 1
        a, b = _normal_equations(columns, gain, values, n)
        largest = a[0, 0] + 1e-6
        for p in range(both):
            a[p, p] += largest * (1e-5 if p < HARMONICS else GLOSS_RIDGE)
        found = np.linalg.solve(a, b)
        light[c], gloss[c] = found[:HARMONICS], found[HARMONICS:]
    return light, gloss


@njit(cache=True, nogil=True, fastmath=True)
def _products(columns: Array, factors: Array, n: int) -> Array:
    """(n,) of the first n entries of the columns (p, most), times factors (p,)."""
    out = np.zeros(n)
    for p in range(len(factors)):
        for i in range(n):
            out[i] += factors[p] * columns[p, i]
    return out


@njit(cache=True, nogil=True, fastmath=True)
def _normal_equations(columns: Array, gain: Array, values: Array, n: int) -> tuple[Array, Array]:
    """(p, p) and (p,) of the first n equations gain * columns = values; columns: (p, most)."""
    unknowns = len(columns)
    scaled, a, b = columns[:, :n] * gain[:n], np.empty((unknowns, unknowns)), np.empty(unknowns)
    for p in range(unknowns):
        first, total = scaled[p], 0.0
        for i in range(n):
            total += first[i] * values[i]
        b[p] = total
        for q in range(p + 1):
            second, total = scaled[q], 0.0
            for i in range(n):
                total += first[i] * second[i]
            a[p, q] = a[q, p] = total
    return a, b
