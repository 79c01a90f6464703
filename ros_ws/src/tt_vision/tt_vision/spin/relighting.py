"""The light on the ball fitted again, once the marks are known: it shines from marks and white alike."""

from __future__ import annotations

import numpy as np
from numba import njit
from tt_core.states import Array

from ..detection.illumination import refit_illumination
from ..projection import unpack_rotation
from .ball_marks import BallMarks, ball_marks, mark_at
from .registration import Registration
from .surface_map import SurfaceMap

LEAST_MARK_WEIGHT = 0.3  # of 1 for a pixel seen straight on, on which a mark must rest
LEAST_KEPT = 0.8  # of what a camera shows, that it must show under the new light: 0.94 and more is usual, 0 with marks of another ball


def relight(surface: SurfaceMap, found: Registration, shown: Array) -> SurfaceMap:
    """Return the surface under light that is fitted with the marks of a registration.

    The light stays the same if the lamps are calibrated, or if a camera would show much less of the ball under the new light.

    Args:
        surface: The ball under the light so far.
        found: The registration.
        shown: (cameras,) pixels, weighted, of the ball that each camera shows well enough under the light so far.
    """
    if surface.illumination.is_calibrated:
        return surface.lit_by(surface.illumination)
    albedo = _albedo(surface.normals, ball_marks(surface, found))
    relit = surface.lit_by(refit_illumination(surface.illumination, surface.stack, surface.normals, albedo))
    is_kept = _shown(relit, len(shown)) > LEAST_KEPT * shown
    return relit if is_kept.all() else surface.lit_by(surface.illumination)


def _shown(surface: SurfaceMap, cameras: int) -> Array:
    """Return how much of the ball each camera shows well enough, (cameras,) pixels, weighted."""
    return np.asarray(surface.images.marks["weight"].reshape(cameras, -1).sum(axis=1, dtype=np.float64))


@njit(cache=True, nogil=True)
def _albedo(normals: np.ndarray, known: BallMarks) -> np.ndarray:
    """Return the marks in every third pixel of every third row, (images, size, size) float32, 0 where they are not known."""
    out, size = np.zeros(normals.shape, dtype=np.float32), normals.shape[1]
    marks, texels = known.marks, known.texels
    for m in range(len(normals)):
        turn = unpack_rotation(known.turns[m])
        for j in range(m % 3, size, 3):
            for i in range(m % 3, size, 3):
                normal = normals[m, j, i]
                if normal.cosine > 0.0:
                    out[m, j, i] = max(0.0, mark_at(marks, texels, turn, normal.x, normal.y, -normal.z, LEAST_MARK_WEIGHT))
    return out
