"""Conversion of fisheye lenses to OpenCV's rational lens model, so that the rest of the code needs this model only."""

from __future__ import annotations

import math
from enum import Enum

import numpy as np

from .errors import TtError, check_array
from .states import Array

WIDEST_ANGLE = math.radians(80.0)  # rad, largest angle between a ray and the optical axis; a pinhole projects nothing at 90 degrees
RATIONAL_TOLERANCE = 0.01  # pixels, largest error of the rational model; a ball is located to 0.02 pixels
_SAMPLES = 400  # angles at which the models are compared
_PASSES = 6  # of the linear fit, each weighted with the denominator of the one before (Sanathanan and Koerner 1963)


class LensFailure(Enum):
    """Why a fisheye lens has no rational model."""

    TOO_WIDE = "fisheye lens {lens} does not image {reach:g} focal lengths within {widest:g} deg of its axis"
    NO_FIT = "fisheye lens {lens}: the rational model is {off:.3g} pixels off, at most {bound:g} allowed"


def rational_from_fisheye(fisheye: Array, reach: float, focal_length: float) -> Array:
    """Fit the rational model to a fisheye (equidistant) lens.

    The fisheye model of OpenCV images a ray at the angle t to the optical axis at the radius t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8). The
    rational model images it at r (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) with r = tan t. Both radii are multiples
    of the focal length.

    Args:
        fisheye: (4,) k1 to k4 of the fisheye model.
        reach: Distance of the image's farthest pixel from the principal point, over the focal length.
        focal_length: Pixels.

    Returns:
        (8,) k1, k2, p1, p2, k3, k4, k5, k6 of the rational model in the order of OpenCV. Its error is below RATIONAL_TOLERANCE within
        `reach`.

    Raises:
        BadShape: `fisheye` has another shape.
        NotFinite: A coefficient is NaN or infinite.
        TtError: The lens sees more than WIDEST_ANGLE to the side, its radius does not rise with the angle, or the fit is worse than
            RATIONAL_TOLERANCE.
    """
    k1, k2, k3, k4 = check_array("fisheye", fisheye, (4,))

    def image(angle: Array) -> Array:
        """Return the radii at which the fisheye lens images rays, over the focal length."""
        square = angle**2
        return angle * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4))))

    coarse = np.linspace(0.0, WIDEST_ANGLE, _SAMPLES + 1)
    beyond = np.flatnonzero(image(coarse) >= reach)
    angle = np.linspace(0.0, coarse[beyond[0]] if len(beyond) else WIDEST_ANGLE, _SAMPLES + 1)[1:]
    radius = image(angle)
    if len(beyond) == 0 or (np.diff(radius) <= 0.0).any():
        raise TtError(LensFailure.TOO_WIDE, lens=fisheye, reach=reach, widest=math.degrees(WIDEST_ANGLE))
    straight = np.tan(angle)
    widest, share = straight[-1] ** 2, radius / straight
    s = straight**2 / widest
    columns = np.stack([s, s**2, s**3, -share * s, -share * s**2, -share * s**3], axis=1)
    weight = straight
    for _ in range(_PASSES):
        x = np.linalg.lstsq(columns * weight[:, None], (share - 1.0) * weight, rcond=None)[0]
        below = 1.0 + s * (x[3] + s * (x[4] + s * x[5]))
        weight = straight / np.maximum(np.abs(below), 1e-9)
    error = focal_length * np.abs((1.0 + s * (x[0] + s * (x[1] + s * x[2]))) / below - share) * straight
    if not (below > 0.0).all() or not error.max() < RATIONAL_TOLERANCE:
        raise TtError(LensFailure.NO_FIT, lens=fisheye, off=error.max(), bound=RATIONAL_TOLERANCE)
    a, b = x[:3] / widest ** np.arange(1, 4), x[3:] / widest ** np.arange(1, 4)
    return np.array([a[0], a[1], 0.0, 0.0, a[2], *b])
