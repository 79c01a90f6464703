"""The ball's surface at half the resolution: what the search for the spin compares.

Marks are wide, so that a quarter of the pixels tells the spin nearly as well, in a quarter of the time. For the refinement of candidates
the marks are blurred, too: the blur widens the range from which a candidate is drawn to the right spin.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.states import Array

from .surface_map import MarkImages, SurfaceMap, mark_variance, with_slopes

SOFT_SIGMA = 1.0  # pixels of half the resolution, sigma of the blur


@dataclass(frozen=True, eq=False)
class SoftSurface:
    """The marks of some frames at half the resolution.

    Attributes:
        brightness: (images, n, n) float32, white is 1, camera by camera.
        weights: (images, n, n) float32, 0 where nothing is known.
        blurred: The same marks, blurred.
        contrast: Variance of `brightness`.
        blurred_contrast: Variance of the blurred brightness.
    """

    brightness: np.ndarray
    weights: np.ndarray
    blurred: MarkImages
    contrast: float
    blurred_contrast: float

    @property
    def images(self) -> MarkImages:
        """The marks as they are."""
        return self.blurred._replace(marks=with_slopes(self.brightness, self.weights))

    def seen_from(self, views: np.ndarray) -> SoftSurface:
        """Return the same marks on a ball that is elsewhere by a part of a pixel. views: (images,) VIEW."""
        moved = self.blurred.views.copy()
        moved["centre"], moved["towards_camera"] = views["centre"], views["towards_camera"]
        return replace(self, blurred=self.blurred._replace(views=moved))


def soft_surface(brightness: np.ndarray, weights: np.ndarray, views: np.ndarray, times: Array) -> SoftSurface:
    """Return the surface with brightness and weights (images, n, n) at half the resolution.

    Args:
        brightness: See SoftSurface.
        weights: See SoftSurface.
        views: (images,) VIEW of half the resolution.
        times: (frames,) s, from the middle of the burst on.
    """
    soft = _blurred(brightness, weights)
    images = MarkImages(with_slopes(soft, weights), views, np.arange(len(views)) % len(times), times)
    return SoftSurface(brightness, weights, images, mark_variance(brightness, weights), mark_variance(soft, weights))


def softened(surface: SurfaceMap) -> SoftSurface:
    """Return a surface at half the resolution."""
    marks, size = surface.images.marks, surface.images.marks.shape[1]
    sums, mass = (
        cv2.resize(x.reshape(-1, size), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).reshape(-1, size // 2, size // 2)
        for x in (marks["brightness"] * marks["weight"], marks["weight"])
    )
    return soft_surface(sums / np.maximum(mass, np.float32(1e-3)), mass, halved_views(surface.images.views), surface.images.times)


def halved_views(views: np.ndarray) -> np.ndarray:
    """Return views (images,) VIEW of images of half the resolution."""
    halved = views.copy()
    halved["focal"] = 0.5 * views["focal"]
    halved["principal_point"] = 0.5 * views["principal_point"] - 0.25
    return halved


@njit(cache=True, nogil=True)
def cut_out_halved(image: np.ndarray, u: int, v: int, background: float, out: np.ndarray) -> None:
    """Fill `out` (n, n) with means of four pixels from the corner (u, v) on, over the background, the image's edge continued outside."""
    height, width = image.shape
    for j in range(out.shape[0]):
        upper, lower = min(height - 1, max(0, v + 2 * j)), min(height - 1, max(0, v + 2 * j + 1))
        for i in range(out.shape[1]):
            left, right = min(width - 1, max(0, u + 2 * i)), min(width - 1, max(0, u + 2 * i + 1))
            total = np.int64(image[upper, left]) + image[upper, right] + image[lower, left] + image[lower, right]
            out[j, i] = 0.25 * total - background


def _blurred(brightness: np.ndarray, weights: np.ndarray) -> npt.NDArray[np.float32]:
    """Return the brightness (images, n, n) blurred, each pixel counted by its weight."""
    count, size = brightness.shape[:2]
    # one ball above the other, far enough apart for the blur
    sums, mass = (cv2.GaussianBlur(x.reshape(-1, size), (0, 0), SOFT_SIGMA) for x in (brightness * weights, weights))
    return (sums / np.maximum(mass, np.float32(1e-3))).reshape(count, size, size)
