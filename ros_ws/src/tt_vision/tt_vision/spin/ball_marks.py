"""The mark at any place of the ball, once its spin is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

from ..projection import Rotation, rotate_back
from .comparison import turned
from .registration import Registration
from .sphere_grid import cube, nearest
from .surface_map import SurfaceMap

CUBE_EDGE = 96  # texels along the edge of the cube that finds the mark at a place
MARK_RANGE = (0.0, 1.1)  # brightness that a mark may have; white is 1


class BallMarks(NamedTuple):
    """The marks of a registration.

    Attributes:
        marks: (n,) POINT_MARK at `fibonacci(n)` on the ball as it is turned in the middle of the burst.
        texels: (6, CUBE_EDGE, CUBE_EDGE) int16, `sphere_grid.cube(n, CUBE_EDGE)`.
        turns: (images, 3, 3), from that ball to the camera's frame at each image.
    """

    marks: np.ndarray
    texels: np.ndarray
    turns: Array


def ball_marks(surface: SurfaceMap, found: Registration) -> BallMarks:
    """Return the marks of a registration on a surface."""
    return BallMarks(found.marks, cube(len(found.marks), CUBE_EDGE), turned(found.spin, surface.images))


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def mark_at(marks: np.ndarray, texels: np.ndarray, turn: Rotation, nx: float, ny: float, nz: float, least_weight: float) -> float:
    """Return the brightness of the mark at a place, white is 1; -1 where it rests on less than `least_weight`.

    Args:
        marks: See BallMarks.
        texels: See BallMarks.
        turn: One of the turns of BallMarks.
        nx: Of the outward unit normal (nx, ny, nz) of the place in the camera's frame; so are `ny` and `nz`.
        ny: See `nx`.
        nz: See `nx`.
        least_weight: Of 1 for a pixel that is seen straight on.
    """
    x, y, z = rotate_back(turn, nx, ny, nz)
    mark = marks[nearest(texels, x, y, z)]
    low, high = MARK_RANGE
    return min(high, max(low, mark.brightness)) if mark.weight > least_weight else -1.0
