"""The ball's surface in the images: where each pixel lies on the ball, and its brightness after the effect of the light is divided out.

"Marks" are the printed or drawn dots on the ball, which are dark in this brightness; white is 1.
"""

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

FULL_WEIGHT = 0.55  # cosine between normal and line of sight from which on a pixel has its full weight; below LIMB its weight is 0
LEAST_COSINE = 0.05  # cosine between normal and line of sight below which a pixel is not divided by the light
LEAST_LIGHT = 0.15  # least light in a pixel, relative to the brightest pixel; with less light marks cannot be told from noise
FULL_LIGHT = 0.5  # light, relative to the brightest pixel, from which on a pixel has its full weight
PIXEL_RANGE = (-0.3, 1.5)  # lowest and highest brightness of a pixel; white is 1
BORDER = 4  # pixels, width of the border around the ball that is cut out with it

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
    """The ball's surface in every image of a burst (the images of one ball's passage), as the compiled functions compare it.

    Attributes:
        marks: (images, n, n) MARK, brightness, weight and slopes in each pixel of a square around the ball; all images of the first camera
            come first.
        views: (images,) VIEW, how a camera sees the ball in each image.
        frame_of: (images,) index of the frame of each image.
        times: (frames,) s, times of the frames relative to their mean.
    """

    marks: np.ndarray
    views: np.ndarray
    frame_of: npt.NDArray[np.int64]
    times: Array

    def only(self, chosen: np.ndarray) -> MarkImages:
        """Return the chosen images; `times` keeps those of all frames. chosen: (images,) bool, True for each image to return."""
        return self._replace(marks=self.marks[chosen], views=self.views[chosen], frame_of=self.frame_of[chosen])


@dataclass(frozen=True, eq=False)
class SurfaceMap:
    """The ball's surface in every image of a burst (the images of one ball's passage), with the effect of the light divided out.

    Attributes:
        images: The surface with the views of the cameras; its `marks` are empty before the light is divided out.
        stack: (images, n, n) float32, the images as cut out, grey levels over the background.
        normals: (images, n, n) NORMAL, the ball's normal in each pixel.
        illumination: The light by which the images are divided.
    """

    images: MarkImages
    stack: np.ndarray
    normals: np.ndarray
    illumination: Illumination

    def lit_by(self, light: Illumination) -> SurfaceMap:
        """Return the map in which the images are divided by another light."""
        brightness, weights = divide_light(self.stack, self.normals, self.images.views, light, float(self.stack.max()))
        return replace(self, images=self.images._replace(marks=with_slopes(brightness, weights)), illumination=light)

    def moved_to(self, motion: BallMotion, burst: Burst) -> SurfaceMap:
        """Return the same images for a motion of the ball that is known more accurately and differs by less than a pixel or so.

        Only the ball's centre and the direction to the camera are replaced; the images are not cut out again.

        Args:
            motion: The new motion.
            burst: The burst of this map.
        """
        views, fresh = self.images.views.copy(), motion_views(motion, burst)
        views["centre"], views["towards_camera"] = fresh["centre"], fresh["towards_camera"]
        return replace(self, images=self.images._replace(views=views))


def cut_surface(burst: Burst, motion: BallMotion, light: Illumination) -> SurfaceMap:
    """Cut the ball out of every image of a burst. The light is stored, but the images are not divided by it yet; see `SurfaceMap.lit_by`.

    Args:
        burst: A burst (the images of one ball's passage) with cameras and detections.
        motion: Motion of the ball.
        light: The light on the ball.
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
    """Return how the cameras see the ball in all images of a burst: (images,) VIEW of the whole images.

    Args:
        motion: Motion of the ball, which gives its position in each frame.
        burst: The burst, with cameras.

    Returns:
        (images,) VIEW with all images of the first camera first, and the principal point relative to the corner of the whole image.
    """
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


@njit(cache=True, nogil=True)
def shortest_gap(times: Array) -> float:
    """Return the shortest time between two frames, s, from the times (frames,) of all frames."""
    return np.diff(times).min()


@njit(cache=True, nogil=True, forceinline=True)
def view_optics(view: np.ndarray) -> Optics:
    """Return the intrinsics in one element of dtype VIEW."""
    d = view.distortion  # type: ignore[attr-defined]
    u0, v0 = view.principal_point[0], view.principal_point[1]  # type: ignore[attr-defined]
    return Optics(view.focal, u0, v0, d[0], d[1], d[2], d[3], d[4])  # type: ignore[attr-defined]


@njit(cache=True, nogil=True)
def cut_out(image: np.ndarray, u: int, v: int, background: float, out: np.ndarray) -> None:
    """Cut a square out of an image, with the background subtracted. Outside the image the pixels at its edge are repeated.

    Args:
        image: (h, w) uint8 or uint16.
        u: Column of the square's upper left corner, pixels.
        v: Row of this corner, pixels.
        background: Grey level of the background.
        out: (size, size) filled with the grey levels over the background.
    """
    height, width = image.shape
    for j in range(out.shape[0]):
        row = min(height - 1, max(0, v + j))
        for i in range(out.shape[1]):
            out[j, i] = image[row, min(width - 1, max(0, u + i))] - background


@njit(cache=True, nogil=True)
def view_middles(views: np.ndarray) -> Array:
    """Return the pixel (images, 2) at which the ball's centre is seen in each view; `views`: (images,) VIEW."""
    out = np.empty((len(views), 2))
    for m in range(len(views)):
        x, y, z = views[m].centre
        out[m, 0], out[m, 1] = project_point(view_optics(views[m]), x, y, z)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def pixel_normals(size: int, views: np.ndarray) -> np.ndarray:
    """Compute the ball's outward normal in each pixel of the images.

    Args:
        size: Width and height of the images, pixels.
        views: (images,) VIEW, how a camera sees the ball in each image.

    Returns:
        (images, size, size) NORMAL; 0 in a pixel beside the ball.
    """
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
    """Divide the images by the light, which leaves the brightness of the ball's surface itself.

    Args:
        stack: (images, size, size) float32 grey levels over the background.
        normals: (images, size, size) NORMAL, the ball's normal in each pixel.
        views: (images,) VIEW, how a camera sees the ball in each image.
        light: The light on the ball in these images.
        top: Grey level of the brightest pixel, over the background.

    Returns:
        The brightness (white is 1) and the weight of each pixel (0 where the surface is not known), both (images, size, size) float32.
    """
    return _divide(stack, normals, np.ascontiguousarray(views["centre"]), light, top)


@njit(cache=True, nogil=True, error_model="numpy")
def _divide(stack: np.ndarray, normals: np.ndarray, centres: Array, light: Illumination, top: float) -> tuple[np.ndarray, np.ndarray]:
    """Compiled part of `divide_light`, with the same arguments but `centres`: (images, 3) m, the ball's centre in the camera's frame."""
    brightness, weights = np.ones(stack.shape, dtype=np.float32), np.zeros(stack.shape, dtype=np.float32)
    images, size, cameras = stack.shape[0], stack.shape[1], len(light.harmonics)
    low, high = PIXEL_RANGE
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
    """Return the weighted variance of brightness values; it is accurate for values near 1 (white).

    Args:
        values: Brightness, of any shape.
        weights: Weights, of the same shape.
    """
    total, first, second = 1e-12, 0.0, 0.0
    flat, mass = values.ravel(), weights.ravel()
    for i in range(len(flat)):
        from_white, weight = flat[i] - 1.0, mass[i]
        total, first, second = total + weight, first + weight * from_white, second + weight * from_white * from_white
    return (second - first * first / total) / total


@njit(cache=True, nogil=True)
def with_slopes(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Combine the brightness of the ball's surface, its weights and its slopes in one array (images, size, size) of dtype MARK.

    The slopes are central differences of the brightness, so that they are smooth from pixel to pixel when they are interpolated. The pixels
    at the edge of each image are 0.

    Args:
        values: (images, size, size) float32, brightness.
        weights: (images, size, size) float32, weight of each pixel.
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
