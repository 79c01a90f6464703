"""From grey levels to marks: where each pixel lies on the ball, and the light divided out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.states import Array

from ..camera import Camera, project_point, ray
from ..detection.ball_detection import Image
from ..detection.illumination import LIMB, Lamps, Light, shade

FULL = 0.55  # and above which it counts fully
DIM = 0.15  # of the brightest light: below it marks drown in noise
BORDER = 4  # pixels around the ball that are cut out with it
SOFT = 1.0  # pixels of half the resolution, sigma of the blur for the coarse search
DULL = 0.004  # variance of the marks, relative to white, below which the ball is taken as bare: bare balls reach 0.0005, 2 % of marks 0.006


@dataclass(frozen=True, eq=False)
class Surface:
    """The ball's surface in every image of a burst, light divided out: white is 1, marks near 0.

    marks: (images, n, n, 4) float32, cut out around the ball: brightness, its weight, 0 where nothing is known, and the slopes of the
    brightness along row and column. soft: (images, n / 2, n / 2, 4), the same, blurred and of half the size, for coarse search. views:
    (images, 23), as Camera.vector but with the ball's centre, aligned to its outline, in place of the translation and the principal point
    counted from the cut's corner; then the unit vector from ball to camera in `table`. frame: (images,) which. times: (frames,) s from the
    middle of the burst. contrast, soft_contrast: variances of the brightness in `marks` and `soft`. stack: (images, n, n) float32 grey
    levels over the background, and normals: (images, n, n, 4), from which marks came by `light`.
    """

    marks: np.ndarray
    soft: np.ndarray
    views: Array
    frame: np.ndarray
    times: Array
    contrast: float
    soft_contrast: float
    stack: np.ndarray
    normals: np.ndarray
    light: Light

    @property
    def soft_views(self) -> Array:
        """(images, 23), `views` of `soft`."""
        views = self.views.copy()
        views[:, 12:15] = 0.5 * views[:, 12:15] - [0.0, 0.25, 0.25]
        return views

    def lit(self, light: Light) -> Surface:
        """Marks and weights under another light; `soft` is left as it is."""
        white, shine = shade(self.normals, self.views, light.harmonics, light.gloss, light.gains, light.lamps)
        return replace(self, marks=_sloped(*_divide(self.stack, self.normals, white, shine)), light=light)

    def at(self, positions: Array, alignment: Array, cameras: Sequence[Camera]) -> Surface:
        """The same marks on a ball that is elsewhere, by a part of a pixel."""
        views = self.views.copy()
        for view, fresh in zip(views, _views(positions, alignment, cameras), strict=True):
            view[9:12], view[20:] = fresh[9:12], fresh[20:]
        return replace(self, views=views)


def unwrap(
    frames: Sequence[Sequence[Image]],
    backgrounds: Array,
    positions: Array,
    alignment: Array,
    times: Array,
    cameras: Sequence[Camera],
    lamps: Lamps | None = None,
) -> Surface:
    """frames: [camera][frame]. backgrounds: (cameras, frames) grey levels. positions: (frames, 3) m. alignment: (cameras, 2) pixels.
    lamps: where they are known; without them the light is fitted to the burst."""
    table, cuts = _views(positions, alignment, cameras), []
    reach = float((table[:, 12] * BALL_RADIUS / table[:, 11]).max())
    size = 2 * (math.ceil(reach) + BORDER)
    count = len(positions)
    for m, view in enumerate(table):
        corner = [round(x) - size // 2 for x in project_point(view, *view[9:12])]
        view[13:15] -= corner
        cuts.append(_cut(frames[m // count][m % count], corner, size) - np.float32(backgrounds[m // count, m % count]))
    stack = np.array(cuts, dtype=np.float32)
    normals = _normals(size, table)
    light = Light.of(stack, normals, table, cameras, lamps)
    white, shine = shade(normals, table, light.harmonics, light.gloss, light.gains, light.lamps)
    marks, weights = _divide(stack, normals, white, shine)
    sums, mass = (cv2.resize(x.reshape(-1, size), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for x in (marks * weights, weights))
    # one ball above the other, far enough apart for the blur
    blurred = cv2.GaussianBlur(sums, (0, 0), SOFT) / np.maximum(cv2.GaussianBlur(mass, (0, 0), SOFT), 1e-3)
    soft, soft_weights = (x.reshape(len(marks), size // 2, size // 2).astype(np.float32, copy=False) for x in (blurred, mass))
    frame, from_middle = np.arange(len(table)) % count, np.asarray(times, dtype=np.float64)
    contrast, soft_contrast = _variance(marks, weights), _variance(soft, soft_weights)
    return Surface(
        _sloped(marks, weights), _sloped(soft, soft_weights), table, frame, from_middle, contrast, soft_contrast, stack, normals, light
    )


def _views(positions: Array, alignment: Array, cameras: Sequence[Camera]) -> Array:
    """(images, 23), Surface.views with the principal point still counted from the image's corner."""
    out = []
    for camera, (du, dv) in zip(cameras, alignment, strict=True):
        centres = positions @ camera.rotation.T + camera.translation
        centres[:, 0] += du * centres[:, 2] / camera.focal_pixels
        centres[:, 1] += dv * centres[:, 2] / camera.focal_pixels
        view = np.tile(camera.vector, (len(centres), 1))
        view[:, 9:12] = centres
        out.append(np.hstack([view, -(centres @ camera.rotation) / np.linalg.norm(centres, axis=1, keepdims=True)]))
    return np.concatenate(out)


def _cut(image: Image, corner: Sequence[int], size: int) -> Image:
    """(size, size) of the image, its edge continued outside."""
    u, v = corner
    height, width = image.shape
    if u >= 0 and v >= 0 and u + size <= width and v + size <= height:
        return image[v : v + size, u : u + size]
    return image[np.clip(np.arange(v, v + size), 0, height - 1)[:, None], np.clip(np.arange(u, u + size), 0, width - 1)]


@njit(cache=True, nogil=True, error_model="numpy")
def _normals(size: int, views: Array) -> np.ndarray:
    """(images, size, size, 4) float32: outward unit normal in the camera's frame and its cosine to the line of sight; 0 off the ball."""
    out, per_radius = np.zeros((len(views), size, size, 4), dtype=np.float32), 1.0 / BALL_RADIUS
    for m in range(len(views)):
        view = views[m]
        cx, cy, cz = view[9], view[10], view[11]
        square = cx * cx + cy * cy + cz * cz - BALL_RADIUS**2
        for j in range(size):
            for i in range(size):
                x, y = ray(view, i, j)
                length2 = x * x + y * y + 1.0
                along = x * cx + y * cy + cz
                gap = along * along - length2 * square
                if gap <= 0.0:
                    continue
                root = math.sqrt(gap)
                reach = (along - root) / length2
                out[m, j, i, 0] = (reach * x - cx) * per_radius
                out[m, j, i, 1] = (reach * y - cy) * per_radius
                out[m, j, i, 2] = (cz - reach) * per_radius
                out[m, j, i, 3] = root / math.sqrt(length2) * per_radius
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _divide(stack: np.ndarray, normals: np.ndarray, white: np.ndarray, shine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(marks, weights), both (images, size, size) float32. white, shine: `shade`."""
    marks, weights = np.ones(stack.shape, dtype=np.float32), np.zeros(stack.shape, dtype=np.float32)
    top = stack.max()
    for m in range(len(stack)):
        for j in range(stack.shape[1]):
            for i in range(stack.shape[2]):
                cosine, light = normals[m, j, i, 3], white[m, j, i] / top
                if cosine <= 0.05 or light < DIM:
                    continue
                marks[m, j, i] = min(1.5, max(-0.3, (stack[m, j, i] - shine[m, j, i]) / white[m, j, i]))
                seen = min(1.0, max(0.0, (cosine - LIMB) / (FULL - LIMB)))
                weights[m, j, i] = seen * seen * (3.0 - 2.0 * seen) * cosine * cosine * min(1.0, (light / 0.5) ** 2)
    return marks, weights


@njit(cache=True, nogil=True, fastmath=True)
def _variance(values: np.ndarray, weights: np.ndarray) -> float:
    total, first, second = 1e-12, 0.0, 0.0
    flat, mass = values.ravel(), weights.ravel()
    for i in range(len(flat)):
        from_white, weight = flat[i] - 1.0, mass[i]
        total, first, second = total + weight, first + weight * from_white, second + weight * from_white * from_white
    return (second - first * first / total) / total


@njit(cache=True, nogil=True)
def _sloped(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(images, size, size, 4), Surface.marks. Central differences: interpolated like the value they are smooth from pixel to pixel."""
    out, size = np.zeros((*values.shape, 4), dtype=np.float32), values.shape[1]
    half = np.float32(0.5)
    for m in range(len(values)):
        for j in range(1, size - 1):
            for i in range(1, size - 1):
                out[m, j, i, 0], out[m, j, i, 1] = values[m, j, i], weights[m, j, i]
                out[m, j, i, 2] = half * (values[m, j, i + 1] - values[m, j, i - 1])
                out[m, j, i, 3] = half * (values[m, j + 1, i] - values[m, j - 1, i])
    return out
