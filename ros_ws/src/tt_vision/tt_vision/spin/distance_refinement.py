"""Refine the distance of the ball from a single camera by means of its marks (the printed or drawn dots).

From the outline alone the distance is only as accurate as the position of the edge: 0.4 pixels of blur at the edge are 1 % of the distance.
The marks give more information. A mark turns with the ball, so its motion in the image depends on the size of the ball there, and the marks
of all images agree only if this size is correct.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from tt_core.arrays import Array

from ..capture.burst import Burst
from ..motion_fit import BallMotion
from .comparison import compare_all, refine_on_all
from .estimate import CORRELATED
from .registration import LEAST_SPIN_STEP, SearchParams
from .sphere_grid import fibonacci_single
from .surface_map import SurfaceMap

DISTANCE_STEP = 0.01  # relative difference between the three distances that are compared: a third of a pixel in the ball's radius
DISTANCE_ROUNDS = 2  # number of rounds; each one starts from the result of the one before
TRUST = 1 / 9  # weight of the information in the marks, because errors of the light caused up to three times the errors that noise causes


def refine_distance(burst: Burst, motion: BallMotion, surface: SurfaceMap, spin: Array, search: SearchParams) -> BallMotion:
    """Refine the distance between the ball and the camera, for a burst that a single camera has taken.

    The result is the distance at which the marks (dots on the ball) agree best in all images, weighted with the distance from the outlines.

    Args:
        burst: A burst (the images of one ball's passage) of one camera.
        motion: Motion of the ball, from its outlines.
        surface: The ball's surface in all images, for this motion.
        spin: (3,) rad/s in `table`, the spin so far.
        search: Parameters of the search, of which the number of points is used.

    Returns:
        The motion for the refined distance. It is the same as before if the marks do not determine a distance.
    """
    towards = motion.position - burst.cameras[0].position
    along = np.concatenate([towards, np.zeros(3)]) / (towards @ towards)  # gradient of the relative distance by position and velocity
    prior = float(along @ motion.covariance @ along)
    factor, information = 1.0, 0.0
    for _ in range(DISTANCE_ROUNDS):
        factors = [factor - DISTANCE_STEP, factor, factor + DISTANCE_STEP]
        trials = [_compare_at(burst, motion, surface, spin, search, each) for each in factors]
        low, middle, high = (error for error, _ in trials)
        weight = trials[1][1] * TRUST / (CORRELATED * middle)  # of the squared error in the likelihood
        slope, information = weight * (high - low) / (4.0 * DISTANCE_STEP), weight * (high - 2.0 * middle + low) / (2.0 * DISTANCE_STEP**2)
        if information <= 0.0:
            return motion
        change = -(slope + (factor - 1.0) / prior) / (information + 1.0 / prior)
        factor += math.copysign(min(abs(change), 3.0 * DISTANCE_STEP), change)
    gain = motion.covariance @ along / (prior + 1.0 / information)
    moved = motion.at_distance(burst.cameras[0].position, factor)
    return replace(moved, covariance=motion.covariance - np.outer(gain, along @ motion.covariance))


def _compare_at(
    burst: Burst, motion: BallMotion, surface: SurfaceMap, spin: Array, search: SearchParams, factor: float
) -> tuple[float, float]:
    """Compare the images with the ball at another distance, `factor` times the present one, after refining the spin for it.

    Returns:
        The mean squared error of the brightness, and the sum of the weights in that mean.
    """
    mapped = surface.moved_to(motion.at_distance(burst.cameras[0].position, factor), burst)
    points = fibonacci_single(search.fine_points)
    refined, _ = refine_on_all(spin, points, mapped.images, LEAST_SPIN_STEP)
    compared = compare_all(refined, points, mapped.images)
    return compared.error, compared.weight
