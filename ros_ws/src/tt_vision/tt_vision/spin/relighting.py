"""Fit the light on the ball again, once its marks (the printed or drawn dots) are known; then pixels on marks can be used, too."""

from __future__ import annotations

import numpy as np
from numba import njit
from tt_core.states import Array

from ..detection.illumination import refit_illumination
from ..projection import unpack_rotation
from .ball_marks import BallMarks, ball_marks, mark_at
from .registration import Registration
from .surface_map import SurfaceMap

LEAST_RELIT_WEIGHT = 0.3  # least weight of the known brightness of a place; one pixel that is seen from straight above has the weight 1
LEAST_KEPT = 0.8  # least share of what a camera shows of the ball that it must show with the new light: 0.94 and more is usual, 0 with
# marks of another ball


def relight(surface: SurfaceMap, found: Registration, shown: Array) -> SurfaceMap:
    """Fit the light again with the marks of a registration, and divide the images by the new light.

    The light so far is used if the lamps are calibrated, or if a camera would show much less of the ball with the new light.

    Args:
        surface: The ball in all images, with the light so far.
        found: The registration: the spin and the marks (dots on the ball).
        shown: (cameras,) how much of the ball each camera shows well with the light so far: the sum of the weights of its pixels.

    Returns:
        The ball's surface in all images, with the effect of the light divided out.
    """
    if surface.illumination.is_calibrated:
        return surface.lit_by(surface.illumination)
    albedo = _albedo(surface.normals, ball_marks(surface, found))
    relit = surface.lit_by(refit_illumination(surface.illumination, surface.stack, surface.normals, albedo))
    is_kept = _shown(relit, len(shown)) > LEAST_KEPT * shown
    return relit if is_kept.all() else surface.lit_by(surface.illumination)


def _shown(surface: SurfaceMap, cameras: int) -> Array:
    """Return how much of the ball each camera shows well: the sum (cameras,) of the weights of its pixels."""
    return np.asarray(surface.images.marks["weight"].reshape(cameras, -1).sum(axis=1, dtype=np.float64))


@njit(cache=True, nogil=True)
def _albedo(normals: np.ndarray, known: BallMarks) -> np.ndarray:
    """Return the brightness of the ball's surface in every third pixel of every third row, (images, size, size) float32.

    White is 1. It is 0 in all other pixels, and where the brightness is not known.
    """
    out, size = np.zeros(normals.shape, dtype=np.float32), normals.shape[1]
    marks, texels = known.marks, known.texels
    for m in range(len(normals)):
        turn = unpack_rotation(known.turns[m])
        for j in range(m % 3, size, 3):
            for i in range(m % 3, size, 3):
                normal = normals[m, j, i]
                if normal.cosine > 0.0:
                    out[m, j, i] = max(0.0, mark_at(marks, texels, turn, normal.x, normal.y, -normal.z, LEAST_RELIT_WEIGHT))
    return out
