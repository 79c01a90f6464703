"""The ball's surface at half the resolution, in which the search for the spin compares the marks (the printed or drawn dots on the ball).

Marks are several pixels wide. So with a quarter of the pixels the spin is nearly as accurate, and it is found in a quarter of the time. For
the refinement of candidates the images are also blurred: from blurred images a candidate converges to the correct spin from farther away.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.states import Array

from .surface_map import MarkImages, SurfaceMap, mark_variance, with_slopes

SOFT_SIGMA = 1.0  # pixels of half the resolution, standard deviation of the blur


@dataclass(frozen=True, eq=False)
class SoftSurface:
    """The ball's surface in the images of some frames, cut out at half the resolution, with the effect of the light divided out.

    Attributes:
        brightness: (images, n, n) float32, white is 1; all images of the first camera come first.
        weights: (images, n, n) float32, weight of each pixel; 0 where the surface is not known.
        blurred: The same images, blurred, with the views of the cameras and the times.
        contrast: Weighted variance of `brightness`.
        blurred_contrast: Weighted variance of the blurred brightness.
    """

    brightness: np.ndarray
    weights: np.ndarray
    blurred: MarkImages
    contrast: float
    blurred_contrast: float

    @property
    def images(self) -> MarkImages:
        """The images without blur, with the views of the cameras and the times."""
        return self.blurred._replace(marks=with_slopes(self.brightness, self.weights))

    def seen_from(self, views: np.ndarray) -> SoftSurface:
        """Return the same images for a position of the ball that is known more accurately and differs by less than a pixel or so.

        Only the ball's centre and the direction to the camera are replaced; the images are not cut out again.

        Args:
            views: (images,) VIEW (how a camera sees the ball in each image), which gives the new positions.
        """
        moved = self.blurred.views.copy()
        moved["centre"], moved["towards_camera"] = views["centre"], views["towards_camera"]
        return replace(self, blurred=self.blurred._replace(views=moved))


def soft_surface(brightness: np.ndarray, weights: np.ndarray, views: np.ndarray, times: Array) -> SoftSurface:
    """Create a `SoftSurface` from brightness and weights at half the resolution; the images are blurred here.

    Args:
        brightness: (images, n, n) float32, white is 1; all images of the first camera come first.
        weights: (images, n, n) float32, weight of each pixel.
        views: (images,) VIEW (how a camera sees the ball in each image), in pixels of half the resolution.
        times: (frames,) s, relative to their mean.
    """
    soft = _blurred(brightness, weights)
    images = MarkImages(with_slopes(soft, weights), views, np.arange(len(views)) % len(times), times)
    return SoftSurface(brightness, weights, images, mark_variance(brightness, weights), mark_variance(soft, weights))


def softened(surface: SurfaceMap) -> SoftSurface:
    """Reduce a map of the ball's surface to half the resolution."""
    marks, size = surface.images.marks, surface.images.marks.shape[1]
    sums, mass = (
        cv2.resize(x.reshape(-1, size), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).reshape(-1, size // 2, size // 2)
        for x in (marks["brightness"] * marks["weight"], marks["weight"])
    )
    return soft_surface(sums / np.maximum(mass, np.float32(1e-3)), mass, halved_views(surface.images.views), surface.images.times)


def halved_views(views: np.ndarray) -> np.ndarray:
    """Convert views (images,) VIEW (how a camera sees the ball in each image) to those of images with half the resolution."""
    halved = views.copy()
    halved["focal"] = 0.5 * views["focal"]
    halved["principal_point"] = 0.5 * views["principal_point"] - 0.25
    return halved


@njit(cache=True, nogil=True)
def cut_out_halved(image: np.ndarray, u: int, v: int, background: float, out: np.ndarray) -> None:
    """Cut a square out of an image at half the resolution: each result is the mean of four pixels, over the background.

    Outside the image the pixels at its edge are repeated.

    Args:
        image: (h, w) uint8 or uint16.
        u: Column of the square's upper left corner, pixels.
        v: Row of this corner, pixels.
        background: Grey level of the background, which is subtracted.
        out: (n, n) filled with the result; the square in the image is 2 n pixels wide and high.
    """
    height, width = image.shape
    for j in range(out.shape[0]):
        upper, lower = min(height - 1, max(0, v + 2 * j)), min(height - 1, max(0, v + 2 * j + 1))
        for i in range(out.shape[1]):
            left, right = min(width - 1, max(0, u + 2 * i)), min(width - 1, max(0, u + 2 * i + 1))
            total = np.int64(image[upper, left]) + image[upper, right] + image[lower, left] + image[lower, right]
            out[j, i] = 0.25 * total - background


def _blurred(brightness: np.ndarray, weights: np.ndarray) -> npt.NDArray[np.float32]:
    """Return the blurred brightness (images, n, n), in which each pixel counts by its weight."""
    count, size = brightness.shape[:2]
    # all images as one, one below the other; the balls are far enough apart for the blur
    sums, mass = (cv2.GaussianBlur(x.reshape(-1, size), (0, 0), SOFT_SIGMA) for x in (brightness * weights, weights))
    return (sums / np.maximum(mass, np.float32(1e-3))).reshape(count, size, size)
