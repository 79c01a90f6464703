"""Brightness of the ball's surface at any place of the ball, once its spin is known.

"Marks" are the printed or drawn dots on the ball; here they are stored as the brightness of the surface at points all over the ball.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

from ..projection import Rotation, rotate_back
from .comparison import turned
from .registration import Registration
from .sphere_grid import cube, nearest_point
from .surface_map import SurfaceMap

POINT_CUBE_EDGE = 96  # number of cells along the edge of the cube map by which the point nearest to a place is found
MARK_RANGE = (0.0, 1.1)  # lowest and highest brightness of the surface; white is 1


class BallMarks(NamedTuple):
    """The surface of a ball whose spin is known, as `mark_at` needs it.

    Attributes:
        marks: (n,) POINT_MARK, brightness at the points `fibonacci(n)` of the ball, in its orientation at the mean time of the frames.
        texels: (6, POINT_CUBE_EDGE, POINT_CUBE_EDGE) int16, cube map of the nearest point, `sphere_grid.cube(n, POINT_CUBE_EDGE)`.
        turns: (images, 3, 3) rotation from the ball in that orientation to the camera's frame, for the time of each image.
    """

    marks: np.ndarray
    texels: np.ndarray
    turns: Array


def ball_marks(surface: SurfaceMap, found: Registration) -> BallMarks:
    """Return the brightness of the ball's surface as a registration found it, in the form that `mark_at` needs.

    Args:
        surface: The ball's surface in all images, of which the times and the views are used.
        found: The registration: the spin and the marks (dots).
    """
    return BallMarks(found.marks, cube(len(found.marks), POINT_CUBE_EDGE), turned(found.spin, surface.images))


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def mark_at(marks: np.ndarray, texels: np.ndarray, turn: Rotation, nx: float, ny: float, nz: float, least_weight: float) -> float:
    """Return the brightness of the ball's surface at one place, white is 1; -1 if it is not known well enough there.

    Args:
        marks: See `BallMarks.marks`.
        texels: See `BallMarks.texels`.
        turn: One of `BallMarks.turns`, that of the image.
        nx: x component of the outward unit normal of the place in the camera's frame.
        ny: y component of this normal.
        nz: z component of this normal.
        least_weight: Least weight of the brightness; the weight of one pixel that is seen from straight above is 1.
    """
    x, y, z = rotate_back(turn, nx, ny, nz)
    mark = marks[nearest_point(texels, x, y, z)]
    low, high = MARK_RANGE
    return min(high, max(low, mark.brightness)) if mark.weight > least_weight else -1.0
