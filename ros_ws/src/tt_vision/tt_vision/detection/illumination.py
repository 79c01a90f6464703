"""How bright a white ball would be in each pixel: light that is fitted to the burst itself, or that comes from calibrated lamps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

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

NORMAL = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4"), ("cosine", "f4")])
"""Outward unit normal of the ball in a pixel, in the camera's frame but with z towards the camera, and its cosine to the line of sight.

All are 0 in a pixel off the ball.
"""

LAMP = np.dtype([("x", "f8"), ("y", "f8"), ("z", "f8"), ("strength", "f8")])
"""Place of a lamp in the camera's frame, m, and its strength, as in CalibratedLamps."""


@dataclass(frozen=True, eq=False)
class CalibratedLamps:
    """Lamps whose places and strengths were measured.

    A lamp that is not where it is said to be does more harm (23 to 42 rpm) than light that is fitted to each burst.

    Attributes:
        positions: (n, 3) m in `table`.
        strengths: (n,), the light at 1 m on a surface that faces the lamp; it falls with the square of the distance. Only ratios count.
        ambient: Light from everywhere, in the same unit.

    Raises:
        BadShape: There are not as many positions as strengths.
        OutOfRange: A strength is negative.
    """

    positions: Array
    strengths: Array
    ambient: float = 0.0

    def __post_init__(self) -> None:
        """Copy and check the fields."""
        object.__setattr__(self, "positions", check_array("positions", self.positions, (-1, 3)))
        object.__setattr__(self, "strengths", check_array("strengths", self.strengths, (len(self.positions),)))
        check_range("strengths", float(self.strengths.min()), 0.0, math.inf)
        check_range("ambient", self.ambient, 0.0, math.inf)

    def seen_by(self, cameras: Sequence[Camera]) -> np.ndarray:
        """Return the lamps in the frame of each camera, (cameras, n) LAMP."""
        lamps = np.zeros((len(cameras), len(self.positions)), dtype=LAMP)
        for row, camera in zip(lamps, cameras, strict=True):
            row["x"], row["y"], row["z"] = (self.positions @ camera.rotation.T + camera.translation).T
            row["strength"] = self.strengths
        return lamps


class Illumination(NamedTuple):
    """What lights the ball in the images of a burst.

    Attributes:
        harmonics: (cameras, 16) grey levels of a white ball by its normal, coefficients of `polynomials`; 0 where lamps are calibrated.
        gloss: (cameras, 4), coefficients of what shines from marks and white alike.
        gains: (images,), factor of each image, because lamps flicker.
        lamps: (cameras, n) LAMP of calibrated lamps; n = 0 without.
        ambient: Light from everywhere, of calibrated lamps.
    """

    harmonics: Array
    gloss: Array
    gains: Array
    lamps: np.ndarray
    ambient: float = 0.0

    @property
    def is_calibrated(self) -> bool:
        """Whether the lamps are calibrated."""
        return self.lamps.shape[1] > 0


class CameraLight(NamedTuple):
    """The light of an Illumination in the images of one camera."""

    harmonics: Array
    gloss: Array
    lamps: np.ndarray
    ambient: float


def fit_illumination(stack: np.ndarray, normals: np.ndarray, cameras: int) -> Illumination:
    """Return the light that fits the images of a ball of which most is white. Every second pixel of every second row is used.

    Args:
        stack: (images, size, size) float32 grey levels over the background, camera by camera.
        normals: (images, size, size) NORMAL.
        cameras: Number of cameras.
    """
    harmonics, gains = _fit(stack, normals, cameras)
    return Illumination(harmonics, np.zeros((cameras, GLOSS)), gains, np.zeros((cameras, 0), dtype=LAMP))


def lamp_illumination(
    stack: np.ndarray, normals: np.ndarray, centres: Array, cameras: Sequence[Camera], lamps: CalibratedLamps
) -> Illumination:
    """Return the light of calibrated lamps, with the gain of each image.

    Args:
        stack: (images, size, size) float32 grey levels over the background, camera by camera.
        normals: (images, size, size) NORMAL.
        centres: (images, 3) m, the ball's centre in the camera's frame.
        cameras: Who took the images.
        lamps: The lamps.
    """
    light = Illumination(
        np.zeros((len(cameras), HARMONICS)),
        np.zeros((len(cameras), GLOSS)),
        np.ones(len(stack)),
        lamps.seen_by(cameras),
        float(lamps.ambient),
    )
    return light._replace(gains=_gains(stack, normals, centres, light))


def refit_illumination(light: Illumination, stack: np.ndarray, normals: np.ndarray, albedo: np.ndarray) -> Illumination:
    """Return the light, and the gloss, that fit the images best now that the marks are known. Calibrated lamps stay as they are.

    Args:
        light: The light so far.
        stack: (images, size, size) float32 grey levels over the background.
        normals: (images, size, size) NORMAL.
        albedo: (images, size, size) float32, brightness of the surface, white is 1; 0 where it is not known.
    """
    if light.is_calibrated:
        return light
    harmonics, gloss = _fit_to_marks(stack, normals, albedo, light.gains, len(light.harmonics))
    return light._replace(harmonics=harmonics, gloss=gloss)


@njit(cache=True, nogil=True, error_model="numpy")
def image_gain(stack: np.ndarray, normals: np.ndarray, harmonics: Array, gain: float) -> float:
    """Return the gain of one more image of a camera whose light has been fitted.

    Args:
        stack: (size, size) float32 grey levels over the background.
        normals: (size, size) NORMAL.
        harmonics: (16,), the light of the camera.
        gain: Of the image before.
    """
    above, under, size = 0.0, 1e-9, len(stack)
    light = CameraLight(harmonics, harmonics[:GLOSS], np.zeros(0, dtype=LAMP), 0.0)
    for j in range(0, size, 2):
        for i in range(0, size, 2):
            n = normals[j, i]
            if n.cosine < LIMB:
                continue
            white = white_level(n.x, n.y, n.z, 0.0, 0.0, 0.0, light)
            if WHITE * gain * white < stack[j, i] < gain * white / WHITE:
                above, under = above + stack[j, i], under + white
    return above / under if above > 0.0 else gain


@njit(cache=True, nogil=True, forceinline=True)
def camera_light(light: Illumination, c: int) -> CameraLight:
    """Return the light in the images of camera c."""
    return CameraLight(light.harmonics[c], light.gloss[c], light.lamps[c], light.ambient)


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def white_level(x: float, y: float, z: float, cx: float, cy: float, cz: float, light: CameraLight) -> float:
    """Return the grey level, before the gain and without gloss, of a white ball.

    Args:
        x: Of the outward unit normal (x, y, -z) in the camera's frame; so are `y` and `z`.
        y: See `x`.
        z: See `x`.
        cx: Of the ball's centre (cx, cy, cz) m in the camera's frame; so are `cy` and `cz`.
        cy: See `cx`.
        cz: See `cx`.
        light: Of the camera.
    """
    if len(light.lamps) == 0:
        h = light.harmonics
        first = h[0] + x * (h[1] + x * (h[7] + x * h[9] + y * h[10]) + y * (h[4] + y * h[11])) + y * (h[2] + y * (h[8] + y * h[12]))
        return first + z * (h[3] + x * (h[6] + x * h[13] + y * h[14]) + y * (h[5] + y * h[15]))
    grey = light.ambient
    for k in range(len(light.lamps)):
        lamp = light.lamps[k]
        dx, dy, dz = lamp.x - cx - BALL_RADIUS * x, lamp.y - cy - BALL_RADIUS * y, lamp.z - cz + BALL_RADIUS * z
        facing, square = dx * x + dy * y - dz * z, dx * dx + dy * dy + dz * dz
        if facing > 0.0:
            grey += lamp.strength * facing / (square * math.sqrt(square))
    return grey


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def gloss_level(x: float, y: float, z: float, light: CameraLight) -> float:
    """Return the grey level, before the gain, that gloss adds where the outward unit normal is (x, y, -z) in the camera's frame."""
    g = light.gloss
    return g[0] + x * g[1] + y * g[2] + z * g[3]


@njit(cache=True, nogil=True, error_model="numpy")
def _gains(stack: np.ndarray, normals: np.ndarray, centres: Array, light: Illumination) -> Array:
    """Return the gain (images,) of each image: the median of its grey levels over the light of the lamps."""
    images, size, cameras = stack.shape[0], stack.shape[1], len(light.lamps)
    gains, ratios = np.ones(images), np.empty(size * size)
    for m in range(images):
        count, of_camera = 0, camera_light(light, m * cameras // images)
        cx, cy, cz = centres[m]
        for j in range(m % 3, size, 3):
            for i in range(size):
                n = normals[m, j, i]
                if n.cosine > 0.5:
                    white = white_level(n.x, n.y, n.z, cx, cy, cz, of_camera)
                    if white > 0.0:
                        ratios[count] = stack[m, j, i] / white
                        count += 1
        if count > 0:
            gains[m] = np.median(ratios[:count])
    return gains


@njit(cache=True, nogil=True, error_model="numpy")
def polynomials(x: float, y: float, z: float, out: Array) -> None:
    """Fill `out` (16,) with the polynomials of a unit normal that span the spherical harmonics up to third order."""
    out[0], out[1], out[2], out[3] = 1.0, x, y, z
    out[4], out[5], out[6], out[7], out[8] = x * y, y * z, z * x, x * x, y * y
    out[9], out[10], out[11], out[12] = x * x * x, x * x * y, x * y * y, y * y * y
    out[13], out[14], out[15] = z * x * x, z * x * y, z * y * y


@njit(cache=True, nogil=True, error_model="numpy")
def _fit(stack: np.ndarray, normals: np.ndarray, cameras: int) -> tuple[Array, Array]:
    """Return the light (cameras, 16) on a white surface by its normal, and the gain (images,) of each image; marks are left out."""
    images, size = stack.shape[0], stack.shape[1]
    frames = images // cameras
    light, gains = np.zeros((cameras, HARMONICS)), np.ones(images)
    most = frames * ((size + 1) // 2) ** 2
    columns, values, ends, h = np.empty((HARMONICS, most)), np.empty(most), np.empty(frames, dtype=np.int64), np.empty(HARMONICS)
    for c in range(cameras):
        n = 0
        for k in range(frames):
            m = c * frames + k
            for j in range(m % 2, size, 2):
                for i in range(m // 2 % 2, size, 2):
                    normal = normals[m, j, i]
                    if normal.cosine >= LIMB:
                        polynomials(normal.x, normal.y, normal.z, h)
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
    """Return the light (cameras, 16) and the gloss (cameras, 4) with which the marks give the images best, where `albedo` is known."""
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
                    normal = normals[m, j, i]
                    if normal.cosine < LIMB or albedo[m, j, i] <= 0.0:
                        continue
                    polynomials(normal.x, normal.y, normal.z, h)
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
    """Return factors (p,) times the first n entries of the columns (p, most), (n,)."""
    out = np.zeros(n)
    for p in range(len(factors)):
        for i in range(n):
            out[i] += factors[p] * columns[p, i]
    return out


@njit(cache=True, nogil=True, fastmath=True)
def _normal_equations(columns: Array, gain: Array, values: Array, n: int) -> tuple[Array, Array]:
    """Return the normal matrix (p, p) and right side (p,) of the first n equations gain * columns = values; columns: (p, most)."""
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
