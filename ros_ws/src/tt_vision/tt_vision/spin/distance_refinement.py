"""The distance of the ball from a single camera, from its marks.

The outline alone tells the distance only as well as the edge is known: 0.4 pixels of blur at the edge are 1 % of it. Marks tell more. A
mark that turns with the ball moves on a circle in the image whose size is the ball's, and only with the right size do all images agree.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..capture.burst import Burst
from ..motion_fit import BallMotion
from .comparison import compare_all
from .estimate import CORRELATED
from .registration import Registration, SearchParams, register_again
from .sphere_grid import fibonacci_single
from .surface_map import SurfaceMap

STEP = 0.01  # of the distance, between the three that are compared: a third of a pixel in the ball's radius
ROUNDS = 2  # the second one starts where the first one ends
TRUST = 1 / 9  # of the information in the marks: what the light leaves on them made errors of up to three standard deviations by noise


def refine_distance(
    burst: Burst, motion: BallMotion, surface: SurfaceMap, found: Registration, search: SearchParams
) -> tuple[BallMotion, SurfaceMap, Registration]:
    """Refine the distance of the ball from the only camera, and the spin with it.

    Args:
        burst: A burst of one camera.
        motion: The motion by the outlines.
        surface: The marks on a ball that moves like that.
        found: The registration so far.
        search: How many points are compared.

    Returns:
        Motion, marks and registration at the distance at which the marks of all images agree best.
    """
    towards = motion.position - burst.cameras[0].position
    along = np.concatenate([towards, np.zeros(3)]) / (towards @ towards)  # gradient of the relative distance by position and velocity
    prior = float(along @ motion.covariance @ along)
    factor, information = 1.0, 0.0
    for _ in range(ROUNDS):
        factors = [factor - STEP, factor, factor + STEP]
        trials = [_at(burst, motion, surface, found, search, each) for each in factors]
        low, middle, high = (error for error, _ in trials)
        weight = trials[1][1] * TRUST / (CORRELATED * middle)  # of the squared error in the likelihood
        slope, information = weight * (high - low) / (4.0 * STEP), weight * (high - 2.0 * middle + low) / (2.0 * STEP**2)
        if information <= 0.0:
            return motion, surface, found
        change = -(slope + (factor - 1.0) / prior) / (information + 1.0 / prior)
        factor += math.copysign(min(abs(change), 3.0 * STEP), change)
    gain = motion.covariance @ along / (prior + 1.0 / information)
    moved = motion.at_distance(burst.cameras[0].position, factor)
    moved = replace(moved, covariance=motion.covariance - np.outer(gain, along @ motion.covariance))
    mapped = surface.moved_to(moved, burst)
    return moved, mapped, register_again(mapped, found, search)


def _at(
    burst: Burst, motion: BallMotion, surface: SurfaceMap, found: Registration, search: SearchParams, factor: float
) -> tuple[float, float]:
    """Return the mean squared error of the marks with the ball at another distance, and the sum of their weights."""
    mapped = surface.moved_to(motion.at_distance(burst.cameras[0].position, factor), burst)
    spin = register_again(mapped, found, search).spin
    compared = compare_all(spin, fibonacci_single(search.fine_points), mapped.images)
    return compared.error, compared.weight
