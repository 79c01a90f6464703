"""From grey levels to marks: where each pixel lies on the ball, and the light divided out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.states import Array

from ..capture.burst import Burst
from ..detection.illumination import LIMB, NORMAL, Illumination, camera_light, gloss_level, white_level
from ..motion_fit import BallMotion
from ..projection import Optics, project_point, ray

FULL_WEIGHT = 0.55  # cosine to the line of sight from which on a pixel counts fully; below LIMB it does not count
LEAST_COSINE = 0.05  # to the line of sight, below which nothing is divided by the light
LEAST_LIGHT = 0.15  # of the brightest pixel: below it marks drown in noise
FULL_LIGHT = 0.5  # of the brightest pixel: from there on a pixel counts fully
MARK_RANGE = (-0.3, 1.5)  # brightness that a mark may have; white is 1
BORDER = 4  # pixels around the ball that are cut out with it

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
        images: The marks; of size 0 before the light is divided out.
        stack: (images, n, n) float32 grey levels over the background, from which the marks come.
        normals: (images, n, n) NORMAL.
        illumination: The light that is divided out.
    """

    images: MarkImages
    stack: np.ndarray
    normals: np.ndarray
    illumination: Illumination

    def lit_by(self, light: Illumination) -> SurfaceMap:
        """Return the map under another light."""
        brightness, weights = divide_light(self.stack, self.normals, self.images.views, light, float(self.stack.max()))
        return replace(self, images=self.images._replace(marks=with_slopes(brightness, weights)), illumination=light)

    def moved_to(self, motion: BallMotion, burst: Burst) -> SurfaceMap:
        """Return the same marks on a ball that is elsewhere by a part of a pixel."""
        views, fresh = self.images.views.copy(), motion_views(motion, burst)
        views["centre"], views["towards_camera"] = fresh["centre"], fresh["towards_camera"]
        return replace(self, images=self.images._replace(views=views))


def cut_surface(burst: Burst, motion: BallMotion, light: Illumination) -> SurfaceMap:
    """Cut the ball out of every image of a burst; the light is still to be divided out.

    Args:
        burst: A burst with cameras and detections.
        motion: Where the ball is.
        light: What lights it.
    """
    views = motion_views(motion, burst)
    reach = float((views["focal"] * BALL_RADIUS / views["centre"][:, 2]).max())
    size = 2 * (math.ceil(reach) + BORDER)
    corners = np.rint(view_middles(views)).astype(np.int64) - size // 2
    views["principal_point"] -= corners
    stack = np.empty((len(views), size, size), dtype=np.float32)
    for m, (u, v) in enumerate(corners.tolist()):
        c, k = divmod(m, len(burst))
        cut_out(burst.images[c][k], u, v, burst.detections[c][k].background, stack[m])
    normals = pixel_normals(size, views)
    frame_of = np.arange(len(views)) % len(burst)
    return SurfaceMap(MarkImages(np.empty((len(views), 0, 0), dtype=MARK), views, frame_of, burst.from_middle), stack, normals, light)


def motion_views(motion: BallMotion, burst: Burst) -> np.ndarray:
    """Return (images,) VIEW with the principal point still counted from the image's corner."""
    positions, frames = motion.positions(burst.times), len(burst)
    views = np.zeros(len(burst.cameras) * frames, dtype=VIEW)
    for c, (camera, (du, dv)) in enumerate(zip(burst.cameras, motion.alignment, strict=True)):
        centres = positions @ camera.rotation.T + camera.translation
        centres[:, 0] += du * centres[:, 2] / camera.focal_pixels
        centres[:, 1] += dv * centres[:, 2] / camera.focal_pixels
        row = views[c * frames : (c + 1) * frames]
        row["rotation"], row["centre"], row["focal"] = camera.rotation, centres, camera.focal_pixels
        row["principal_point"], row["distortion"] = camera.principal_point, camera.distortion
        row["towards_camera"] = -(centres @ camera.rotation) / np.linalg.norm(centres, axis=1, keepdims=True)
    return views


@njit(cache=True, nogil=True, forceinline=True)
def view_optics(view: np.ndarray) -> Optics:
    """Return the intrinsics of a VIEW."""
    d = view.distortion  # type: ignore[attr-defined]
    u0, v0 = view.principal_point[0], view.principal_point[1]  # type: ignore[attr-defined]
    return Optics(view.focal, u0, v0, d[0], d[1], d[2], d[3], d[4])  # type: ignore[attr-defined]


@njit(cache=True, nogil=True)
def cut_out(image: np.ndarray, u: int, v: int, background: float, out: np.ndarray) -> None:
    """Fill `out` (size, size) with the grey levels over the background from the corner (u, v) on, the image's edge continued outside."""
    height, width = image.shape
    for j in range(out.shape[0]):
        row = min(height - 1, max(0, v + j))
        for i in range(out.shape[1]):
            out[j, i] = image[row, min(width - 1, max(0, u + i))] - background


@njit(cache=True, nogil=True)
def view_middles(views: np.ndarray) -> Array:
    """Return where the ball's centre is seen in each view, (images, 2) pixels."""
    out = np.empty((len(views), 2))
    for m in range(len(views)):
        x, y, z = views[m].centre
        out[m, 0], out[m, 1] = project_point(view_optics(views[m]), x, y, z)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def pixel_normals(size: int, views: np.ndarray) -> np.ndarray:
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


def divide_light(
    stack: np.ndarray, normals: np.ndarray, views: np.ndarray, light: Illumination, top: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return brightness and weights of the surface, both (images, size, size) float32.

    Args:
        stack: (images, size, size) float32 grey levels over the background.
        normals: (images, size, size) NORMAL.
        views: (images,) VIEW.
        light: Of the images.
        top: Grey level of the brightest pixel.
    """
    return _divide(stack, normals, np.ascontiguousarray(views["centre"]), light, top)


@njit(cache=True, nogil=True, error_model="numpy")
def _divide(stack: np.ndarray, normals: np.ndarray, centres: Array, light: Illumination, top: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the same as `divide_light`. centres: (images, 3) m, the ball's centre in the camera's frame."""
    brightness, weights = np.ones(stack.shape, dtype=np.float32), np.zeros(stack.shape, dtype=np.float32)
    images, size, cameras = stack.shape[0], stack.shape[1], len(light.harmonics)
    low, high = MARK_RANGE
    least, full = LEAST_LIGHT * top, 1.0 / (FULL_LIGHT * top)
    for m in range(images):
        of_camera, gain = camera_light(light, m * cameras // images), light.gains[m]
        cx, cy, cz = centres[m]
        for j in range(size):
            for i in range(size):
                n = normals[m, j, i]
                if n.cosine <= LEAST_COSINE:
                    continue
                white = gain * white_level(n.x, n.y, n.z, cx, cy, cz, of_camera)
                if white < least:
                    continue
                grey = stack[m, j, i] - gain * gloss_level(n.x, n.y, n.z, of_camera)
                brightness[m, j, i] = min(high, max(low, grey / white))
                if n.cosine > LIMB:
                    seen, lit = min(1.0, (n.cosine - LIMB) / (FULL_WEIGHT - LIMB)), min(1.0, white * full)
                    weights[m, j, i] = seen * seen * (3.0 - 2.0 * seen) * n.cosine * n.cosine * lit * lit
    return brightness, weights


@njit(cache=True, nogil=True, fastmath=True)
def mark_variance(values: np.ndarray, weights: np.ndarray) -> float:
    """Return the weighted variance of values near 1."""
    total, first, second = 1e-12, 0.0, 0.0
    flat, mass = values.ravel(), weights.ravel()
    for i in range(len(flat)):
        from_white, weight = flat[i] - 1.0, mass[i]
        total, first, second = total + weight, first + weight * from_white, second + weight * from_white * from_white
    return (second - first * first / total) / total


@njit(cache=True, nogil=True)
def with_slopes(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
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
