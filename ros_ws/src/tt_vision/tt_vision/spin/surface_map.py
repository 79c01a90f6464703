"""From grey levels to marks: where each pixel lies on the ball, and the light divided out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.states import Array

from ..capture.burst import Burst, Image
from ..detection.illumination import LIMB, NORMAL, CalibratedLamps, Illumination, fit_illumination, lamp_illumination, shade
from ..motion_fit import BallMotion
from ..projection import Optics, project_point, ray

FULL_WEIGHT = 0.55  # cosine to the line of sight from which on a pixel counts fully; below LIMB it does not count
LEAST_COSINE = 0.05  # to the line of sight, below which nothing is divided by the light
LEAST_LIGHT = 0.15  # of the brightest pixel: below it marks drown in noise
FULL_LIGHT = 0.5  # of the brightest pixel: from there on a pixel counts fully
MARK_RANGE = (-0.3, 1.5)  # brightness that a mark may have; white is 1
BORDER = 4  # pixels around the ball that are cut out with it
SOFT_SIGMA = 1.0  # pixels of half the resolution, sigma of the blur for the coarse search
LEAST_CONTRAST = (
    0.004  # variance of the marks, of white squared, below which the ball is taken as bare: bare balls reach 0.0005, 2 % of marks 0.006
)

VIEW = np.dtype(
    [
        ("rotation", "f8", (3, 3)),
        ("centre", "f8", (3,)),
        ("focal", "f8"),
        ("principal_point", "f8", (2,)),
        ("distortion", "f8", (5,)),
        ("towards_camera", "f8", (3,)),
    ]
)
"""How a camera sees the ball in one image.

rotation: from `table` to the camera's frame. centre: of the ball in the camera's frame, m, aligned to its outline. focal, principal_point:
pixels, counted from the corner of what is cut out. distortion: k1, k2, p1, p2, k3. towards_camera: unit vector from the ball to the camera
in `table`.
"""

MARK = np.dtype([("brightness", "f4"), ("weight", "f4"), ("slope_u", "f4"), ("slope_v", "f4")])
"""The surface in one pixel. brightness: white is 1, marks are near 0. weight: 0 where nothing is known. slopes: of the brightness, by pixel
along the row and along the column."""


class MarkImages(NamedTuple):
    """The marks in every image of a burst, as the kernels compare them.

    Attributes:
        marks: (images, n, n) MARK, cut out around the ball, camera by camera.
        views: (images,) VIEW.
        frame_of: (images,) which frame an image is of.
        times: (frames,) s, from the middle of the burst on.
    """

    marks: np.ndarray
    views: np.ndarray
    frame_of: npt.NDArray[np.int64]
    times: Array


@dataclass(frozen=True, eq=False)
class SurfaceMap:
    """The ball's surface in every image of a burst, the light divided out.

    Attributes:
        sharp: The marks as they are.
        soft: The marks blurred, at half the resolution, for the coarse search.
        contrast: Variance of the brightness in `sharp`.
        soft_contrast: Variance of the brightness in `soft`.
        stack: (images, n, n) float32 grey levels over the background, from which the marks come.
        normals: (images, n, n) NORMAL.
        illumination: The light that is divided out.
    """

    sharp: MarkImages
    soft: MarkImages
    contrast: float
    soft_contrast: float
    stack: np.ndarray
    normals: np.ndarray
    illumination: Illumination

    def lit_by(self, light: Illumination) -> SurfaceMap:
        """Return the map under another light; `soft` is left as it is."""
        white, gloss = shade(self.normals, self.sharp.views["centre"], light)
        marks = _with_slopes(*_divide(self.stack, self.normals, white, gloss))
        return replace(self, sharp=self.sharp._replace(marks=marks), illumination=light)

    def softened(self) -> SurfaceMap:
        """Return the map with the blurred marks made anew from the sharp ones."""
        marks = self.sharp.marks
        soft, weights = _halved(marks["brightness"], marks["weight"])
        return replace(self, soft=self.soft._replace(marks=_with_slopes(soft, weights)), soft_contrast=_variance(soft, weights))

    def moved_to(self, motion: BallMotion, burst: Burst) -> SurfaceMap:
        """Return the same marks on a ball that is elsewhere by a part of a pixel."""
        moved = []
        for images in (self.sharp, self.soft):
            views, fresh = images.views.copy(), _views(motion, burst)
            views["centre"], views["towards_camera"] = fresh["centre"], fresh["towards_camera"]
            moved.append(images._replace(views=views))
        return replace(self, sharp=moved[0], soft=moved[1])


def map_surface(burst: Burst, motion: BallMotion, lamps: CalibratedLamps | None = None) -> SurfaceMap:
    """Cut the ball out of every image of a burst, and divide the light out.

    Args:
        burst: A burst with cameras and detections.
        motion: Where the ball is.
        lamps: Calibrated lamps; None: the light is fitted to the burst.
    """
    views, cuts = _views(motion, burst), []
    reach = float((views["focal"] * BALL_RADIUS / views["centre"][:, 2]).max())
    size = 2 * (math.ceil(reach) + BORDER)
    corners = np.rint(_middles(views)).astype(np.int64) - size // 2
    views["principal_point"] -= corners
    for m, corner in enumerate(corners.tolist()):
        c, k = divmod(m, len(burst))
        cuts.append(_cut(burst.images[c][k], corner, size) - np.float32(burst.detections[c][k].background))
    stack = np.array(cuts, dtype=np.float32)
    normals = _normals(size, views)
    centres = np.ascontiguousarray(views["centre"])
    if lamps is None:
        light = fit_illumination(stack, normals, len(burst.cameras))
    else:
        light = lamp_illumination(stack, normals, centres, burst.cameras, lamps)
    white, gloss = shade(normals, centres, light)
    brightness, weights = _divide(stack, normals, white, gloss)
    soft, soft_weights = _halved(brightness, weights)
    frame_of = np.arange(len(views)) % len(burst)
    return SurfaceMap(
        sharp=MarkImages(_with_slopes(brightness, weights), views, frame_of, burst.from_middle),
        soft=MarkImages(_with_slopes(soft, soft_weights), _halved_views(views), frame_of, burst.from_middle),
        contrast=_variance(brightness, weights),
        soft_contrast=_variance(soft, soft_weights),
        stack=stack,
        normals=normals,
        illumination=light,
    )


def _views(motion: BallMotion, burst: Burst) -> np.ndarray:
    """Return (images,) VIEW with the principal point still counted from the image's corner."""
    positions, rows = motion.positions(burst.times), []
    for camera, (du, dv) in zip(burst.cameras, motion.alignment, strict=True):
        centres = positions @ camera.rotation.T + camera.translation
        centres[:, 0] += du * centres[:, 2] / camera.focal_pixels
        centres[:, 1] += dv * centres[:, 2] / camera.focal_pixels
        row = np.zeros(len(centres), dtype=VIEW)
        row["rotation"], row["centre"], row["focal"] = camera.rotation, centres, camera.focal_pixels
        row["principal_point"], row["distortion"] = camera.principal_point, camera.distortion
        row["towards_camera"] = -(centres @ camera.rotation) / np.linalg.norm(centres, axis=1, keepdims=True)
        rows.append(row)
    return np.concatenate(rows)


def _halved_views(views: np.ndarray) -> np.ndarray:
    """Return views of images of half the resolution."""
    halved = views.copy()
    halved["focal"] = 0.5 * views["focal"]
    halved["principal_point"] = 0.5 * views["principal_point"] - 0.25
    return halved


def _halved(brightness: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return brightness and weights (images, n / 2, n / 2) float32, blurred and of half the resolution."""
    count, size = brightness.shape[:2]
    sums, mass = (
        cv2.resize(x.reshape(-1, size), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for x in (brightness * weights, weights)
    )
    # one ball above the other, far enough apart for the blur
    blurred = cv2.GaussianBlur(sums, (0, 0), SOFT_SIGMA) / np.maximum(cv2.GaussianBlur(mass, (0, 0), SOFT_SIGMA), 1e-3)
    shape = count, size // 2, size // 2
    return blurred.reshape(shape).astype(np.float32, copy=False), mass.reshape(shape).astype(np.float32, copy=False)


def _cut(image: Image, corner: Sequence[int], size: int) -> Image:
    """Return a square (size, size) of the image from a corner (u, v) on, its edge continued outside."""
    u, v = corner
    height, width = image.shape
    if u >= 0 and v >= 0 and u + size <= width and v + size <= height:
        return image[v : v + size, u : u + size]
    return image[np.clip(np.arange(v, v + size), 0, height - 1)[:, None], np.clip(np.arange(u, u + size), 0, width - 1)]


@njit(cache=True, nogil=True, forceinline=True)
def view_optics(view: np.ndarray) -> Optics:
    """Return the intrinsics of a VIEW."""
    d = view.distortion  # type: ignore[attr-defined]
    u0, v0 = view.principal_point[0], view.principal_point[1]  # type: ignore[attr-defined]
    return Optics(view.focal, u0, v0, d[0], d[1], d[2], d[3], d[4])  # type: ignore[attr-defined]


@njit(cache=True, nogil=True)
def _middles(views: np.ndarray) -> Array:
    """Return where the ball's centre is seen in each view, (images, 2) pixels."""
    out = np.empty((len(views), 2))
    for m in range(len(views)):
        x, y, z = views[m].centre
        out[m, 0], out[m, 1] = project_point(view_optics(views[m]), x, y, z)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _normals(size: int, views: np.ndarray) -> np.ndarray:
    """Return the normal of the ball in each pixel, (images, size, size) NORMAL."""
    out, per_radius = np.zeros((len(views), size, size), dtype=NORMAL), 1.0 / BALL_RADIUS
    for m in range(len(views)):
        optics = view_optics(views[m])
        cx, cy, cz = views[m].centre
        square = cx * cx + cy * cy + cz * cz - BALL_RADIUS**2
        for j in range(size):
            for i in range(size):
                x, y = ray(optics, i, j)
                length2 = x * x + y * y + 1.0
                along = x * cx + y * cy + cz
                gap = along * along - length2 * square
                if gap <= 0.0:
                    continue
                root = math.sqrt(gap)
                reach = (along - root) / length2
                normal = out[m, j, i]
                normal.x = (reach * x - cx) * per_radius
                normal.y = (reach * y - cy) * per_radius
                normal.z = (cz - reach) * per_radius
                normal.cosine = root / math.sqrt(length2) * per_radius
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _divide(stack: np.ndarray, normals: np.ndarray, white: np.ndarray, gloss: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return brightness and weights of the surface, both (images, size, size) float32. white, gloss: from `shade`."""
    brightness, weights = np.ones(stack.shape, dtype=np.float32), np.zeros(stack.shape, dtype=np.float32)
    low, high = MARK_RANGE
    top = stack.max()
    for m in range(len(stack)):
        for j in range(stack.shape[1]):
            for i in range(stack.shape[2]):
                cosine, light = normals[m, j, i].cosine, white[m, j, i] / top
                if cosine <= LEAST_COSINE or light < LEAST_LIGHT:
                    continue
                brightness[m, j, i] = min(high, max(low, (stack[m, j, i] - gloss[m, j, i]) / white[m, j, i]))
                seen = min(1.0, max(0.0, (cosine - LIMB) / (FULL_WEIGHT - LIMB)))
                weights[m, j, i] = seen * seen * (3.0 - 2.0 * seen) * cosine * cosine * min(1.0, (light / FULL_LIGHT) ** 2)
    return brightness, weights


@njit(cache=True, nogil=True, fastmath=True)
def _variance(values: np.ndarray, weights: np.ndarray) -> float:
    """Return the weighted variance of values near 1."""
    total, first, second = 1e-12, 0.0, 0.0
    flat, mass = values.ravel(), weights.ravel()
    for i in range(len(flat)):
        from_white, weight = flat[i] - 1.0, mass[i]
        total, first, second = total + weight, first + weight * from_white, second + weight * from_white * from_white
    return (second - first * first / total) / total


@njit(cache=True, nogil=True)
def _with_slopes(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return (images, size, size) MARK.

    The slopes are central differences: interpolated like the brightness, they are smooth from pixel to pixel.
    """
    out, size = np.zeros(values.shape, dtype=MARK), values.shape[1]
    half = np.float32(0.5)
    for m in range(len(values)):
        for j in range(1, size - 1):
            for i in range(1, size - 1):
                mark = out[m, j, i]
                mark.brightness, mark.weight = values[m, j, i], weights[m, j, i]
                mark.slope_u = half * (values[m, j, i + 1] - values[m, j, i - 1])
                mark.slope_v = half * (values[m, j + 1, i] - values[m, j - 1, i])
    return out
