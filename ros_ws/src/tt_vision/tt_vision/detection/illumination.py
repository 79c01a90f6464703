"""The light on the ball: how bright a white ball would be in each pixel.

The light is fitted to the images of a burst (the images of one ball's passage through the high speed cameras), or computed from calibrated
lamps. "Marks" are the printed or drawn dots on the ball. Grey levels are counted from the background.
"""

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

LIMB = 0.30  # cosine between normal and line of sight below which a pixel is not used; it is reached two pixels inside the outline
WHITE_SHARE = 0.85  # share of the fitted light; darker pixels are taken as marks
HARMONICS = 16  # spherical harmonics up to third order; those up to second order hold 99 % of diffuse light (Ramamoorthi, Hanrahan 2001)
GLOSS = 4  # coefficients of the light that gloss adds: a constant and a slope
GLOSS_RIDGE = 1e-4  # weight, relative to the light's in the fit, that keeps gloss at zero where the marks cannot tell it from light
LIGHT_STEPS = 6  # iterations of the fit; each leaves out more of the marks

NORMAL = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4"), ("cosine", "f4")])
"""Outward unit normal of the ball in a pixel, in the camera's frame but with z towards the camera, and its cosine to the line of sight.

All are 0 in a pixel off the ball.
"""

LAMP = np.dtype([("x", "f8"), ("y", "f8"), ("z", "f8"), ("strength", "f8")])
"""Place of a lamp in the camera's frame, m, and its strength, as in CalibratedLamps."""


@dataclass(frozen=True, eq=False)
class CalibratedLamps:
    """Lamps whose positions and strengths have been measured.

    If the position of a lamp is wrong, the spin has larger errors (23 to 42 rpm) than with light that is fitted to each burst.

    Attributes:
        positions: (n, 3) m in `table`.
        strengths: (n,) brightness of a white surface that faces the lamp at a distance of 1 m, in any unit, because only ratios count. It
            falls with the square of the distance.
        ambient: Brightness of a white surface by light that comes from all directions, in the same unit.

    Raises:
        BadShape: There are not as many strengths as positions.
        OutOfRange: A strength or `ambient` is negative.
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
        """Return the lamps in the frames of the cameras, a (cameras, n) array of dtype LAMP."""
        lamps = np.zeros((len(cameras), len(self.positions)), dtype=LAMP)
        for row, camera in zip(lamps, cameras, strict=True):
            row["x"], row["y"], row["z"] = (self.positions @ camera.rotation.T + camera.translation).T
            row["strength"] = self.strengths
        return lamps


class Illumination(NamedTuple):
    """The light on the ball in all images of a burst, either as a fitted function of the ball's normal or as calibrated lamps.

    Attributes:
        harmonics: (cameras, 16) coefficients of `polynomials` of the normal; their sum is the grey level of a white ball. All are 0 if the
            lamps are calibrated.
        gloss: (cameras, 4) coefficients of 1, x, y and z of the normal; their sum is the grey level that gloss adds, to marks as to white.
        gains: (images,) factor on the brightness of each image, because lamps flicker.
        lamps: (cameras, n) LAMP, calibrated lamps in the frame of each camera; n = 0 if the lamps are not calibrated.
        ambient: Light from all directions, as in `CalibratedLamps`.
    """

    harmonics: Array
    gloss: Array
    gains: Array
    lamps: np.ndarray
    ambient: float = 0.0

    @property
    def is_calibrated(self) -> bool:
        """Whether this is the light of calibrated lamps."""
        return self.lamps.shape[1] > 0


class CameraLight(NamedTuple):
    """The light on the ball in the images of one camera; the attributes are those of `Illumination` for this camera.

    Attributes:
        harmonics: (16,) coefficients of `polynomials`.
        gloss: (4,) coefficients of gloss.
        lamps: (n,) LAMP, in the camera's frame.
        ambient: Light from all directions.
    """

    harmonics: Array
    gloss: Array
    lamps: np.ndarray
    ambient: float


def fit_illumination(stack: np.ndarray, normals: np.ndarray, cameras: int) -> Illumination:
    """Fit the light to images of a ball that is mostly white; pixels that are too dark are left out as marks.

    Every second pixel of every second row is used.

    Args:
        stack: (images, size, size) float32 grey levels over the background, all images of the first camera first.
        normals: (images, size, size) NORMAL, the ball's normal in each pixel.
        cameras: Number of cameras.
    """
    harmonics, gains = _fit(stack, normals, cameras)
    return Illumination(harmonics, np.zeros((cameras, GLOSS)), gains, np.zeros((cameras, 0), dtype=LAMP))


def lamp_illumination(
    stack: np.ndarray, normals: np.ndarray, centres: Array, cameras: Sequence[Camera], lamps: CalibratedLamps
) -> Illumination:
    """Return the light of calibrated lamps, with the gain (brightness factor) of each image, which is estimated from the image.

    Args:
        stack: (images, size, size) float32 grey levels over the background, all images of the first camera first.
        normals: (images, size, size) NORMAL, the ball's normal in each pixel.
        centres: (images, 3) m, the ball's centre in the camera's frame.
        cameras: The cameras that took the images.
        lamps: The calibrated lamps.
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
    """Fit light and gloss to the images again, once the marks on the ball are known. Light of calibrated lamps is returned unchanged.

    Args:
        light: The light so far; its gains are kept.
        stack: (images, size, size) float32 grey levels over the background.
        normals: (images, size, size) NORMAL, the ball's normal in each pixel.
        albedo: (images, size, size) float32, brightness of the ball's surface in each pixel without the effect of light: 1 for white, less
            for marks, 0 where it is not known.
    """
    if light.is_calibrated:
        return light
    harmonics, gloss = _fit_to_marks(stack, normals, albedo, light.gains, len(light.harmonics))
    return light._replace(harmonics=harmonics, gloss=gloss)


@njit(cache=True, nogil=True, error_model="numpy")
def image_gain(stack: np.ndarray, normals: np.ndarray, harmonics: Array, gain: float) -> float:
    """Estimate the gain (brightness factor) of one further image of a camera for which the light has been fitted.

    Args:
        stack: (size, size) float32 grey levels of the image over the background.
        normals: (size, size) NORMAL, the ball's normal in each pixel.
        harmonics: (16,) coefficients of the light of this camera.
        gain: Gain of the image before, which tells marks from white; it is returned if no pixel is white.
    """
    above, under, size = 0.0, 1e-9, len(stack)
    light = CameraLight(harmonics, harmonics[:GLOSS], np.zeros(0, dtype=LAMP), 0.0)
    for j in range(0, size, 2):
        for i in range(0, size, 2):
            n = normals[j, i]
            if n.cosine < LIMB:
                continue
            white = white_level(n.x, n.y, n.z, 0.0, 0.0, 0.0, light)
            if WHITE_SHARE * gain * white < stack[j, i] < gain * white / WHITE_SHARE:
                above, under = above + stack[j, i], under + white
    return above / under if above > 0.0 else gain


@njit(cache=True, nogil=True, forceinline=True)
def camera_light(light: Illumination, c: int) -> CameraLight:
    """Return the light in the images of the camera with index c."""
    return CameraLight(light.harmonics[c], light.gloss[c], light.lamps[c], light.ambient)


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def white_level(x: float, y: float, z: float, cx: float, cy: float, cz: float, light: CameraLight) -> float:
    """Return the grey level of a white ball at one place of its surface, without the gain of the image and without gloss.

    The outward unit normal of the place is (x, y, -z) in the camera's frame, as in NORMAL. The ball's centre matters only for calibrated
    lamps.

    Args:
        x: First component of the normal.
        y: Second component of the normal.
        z: Third component of the normal, positive towards the camera.
        cx: m, x coordinate of the ball's centre in the camera's frame.
        cy: m, y coordinate of the ball's centre.
        cz: m, z coordinate of the ball's centre.
        light: The light in the images of the camera.
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
    """Return the grey level that gloss adds at one place of the ball's surface, without the gain of the image.

    Args:
        x: First component of the outward unit normal (x, y, -z) in the camera's frame.
        y: Second component of the normal.
        z: Third component of the normal, positive towards the camera.
        light: The light in the images of the camera.
    """
    g = light.gloss
    return g[0] + x * g[1] + y * g[2] + z * g[3]


@njit(cache=True, nogil=True, error_model="numpy")
def _gains(stack: np.ndarray, normals: np.ndarray, centres: Array, light: Illumination) -> Array:
    """Return the gain (images,) of each image: the median ratio of its grey levels to those that a white ball would have."""
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
    """Fill `out` (16,) with the polynomials of a unit normal (x, y, z) that span the spherical harmonics up to third order."""
    out[0], out[1], out[2], out[3] = 1.0, x, y, z
    out[4], out[5], out[6], out[7], out[8] = x * y, y * z, z * x, x * x, y * y
    out[9], out[10], out[11], out[12] = x * x * x, x * x * y, x * y * y, y * y * y
    out[13], out[14], out[15] = z * x * x, z * x * y, z * y * y


@njit(cache=True, nogil=True, error_model="numpy")
def _fit(stack: np.ndarray, normals: np.ndarray, cameras: int) -> tuple[Array, Array]:
    """Fit the light to images of a mostly white ball; see `fit_illumination` for the arguments.

    Returns:
        The coefficients (cameras, 16) of the light, and the gain (images,) of each image.
    """
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
                        gain[i] = (
                            0.0 if values[i] < WHITE_SHARE * expected or (step > 2 and values[i] * WHITE_SHARE > expected) else gains[m]
                        )
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
    """Fit light and gloss to images of a ball whose marks are known; see `refit_illumination` for the arguments.

    Returns:
        The coefficients of the light (cameras, 16) and of the gloss (cameras, 4).
    """
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
    """Return the sums (n,) over p of factors (p,) times columns (p, most), for the first n entries."""
    out = np.zeros(n)
    for p in range(len(factors)):
        for i in range(n):
            out[i] += factors[p] * columns[p, i]
    return out


@njit(cache=True, nogil=True, fastmath=True)
def _normal_equations(columns: Array, gain: Array, values: Array, n: int) -> tuple[Array, Array]:
    """Return the normal equations of linear least squares for p unknowns.

    Args:
        columns: (p, most) coefficients of the unknowns, one column of the design matrix after the other.
        gain: (most,) factor of each equation.
        values: (most,) right side of each equation: gain * (columns^T x) = values.
        n: Number of equations that are used, from the first on.

    Returns:
        The normal matrix (p, p) and the right side (p,).
    """
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
