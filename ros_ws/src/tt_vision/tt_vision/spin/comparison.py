"""Compare the ball's marks (the printed or drawn dots) between the images for a given spin, and refine the spin by Gauss-Newton steps."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.so3 import left_jacobian, rotation_matrix
from tt_core.states import Array

from ..detection.illumination import LIMB
from ..projection import distort, rotate, rotate_back, unpack_rotation
from .mark_sampling import LEAST_WEIGHT, POINT_MARK, sample_best
from .surface_map import MarkImages, shortest_gap, view_optics

PAIR_STEPS = 4  # number of steps of the refinement on pairs of frames
MOST_STEP = 0.05  # rad per frame, largest step of the refinement on all images
MOST_REFINEMENT_STEPS = 12  # largest number of these steps; few marks that are seen at a flat angle take 8

SIGHT = np.dtype([("facing", "f4", (3,)), ("turn", "f4", (3, 3)), ("arm", "f4", (3, 3)), ("centre", "f4", (3,))])
"""How an image sees a ball that turns.

facing: unit vector to the camera in the frame of the ball as it is turned at time 0. turn: from that frame to the camera's. arm: from the
cross product of a place's normal and a gradient, both in the camera's frame, to the derivative by the spin, s. centre: of the ball in the
camera's frame, m.
"""


class PairComparison(NamedTuple):
    """Comparison of the ball's surface in pairs of frames, for a given spin.

    At each point of the surface, d is the difference of its brightness in the two frames (white is 1), and w the weight of the point. The
    sums are over all points and pairs.

    Attributes:
        cost: Sum of w (d^2 - 2 contrast), which is about 0 if the frames are unrelated, and negative if they agree.
        weight: Sum of w.
        normal_matrix: (3, 3) (rad/s)^-2, weighted sum of the products of the derivatives of d by the spin.
        gradient: (3,) s/rad, derivative of half the sum of w d^2 by the spin.
    """

    cost: float
    weight: float
    normal_matrix: Array
    gradient: Array


class Comparison(NamedTuple):
    """Comparison of all images, for a given spin, with that brightness of the ball's surface which fits them best.

    Attributes:
        normal_matrix: (3, 3) (rad/s)^-2, normal matrix for the spin, from which the unknown brightness of each point is eliminated.
        gradient: (3,) s/rad, derivative of half the weighted sum of squared errors by the spin.
        error: Weighted mean of the squared errors of the brightness (white is 1).
        weight: Sum of the weights in that mean.
        marks: (n,) POINT_MARK, the brightness of the surface at each point that fits the images best.
    """

    normal_matrix: Array
    gradient: Array
    error: float
    weight: float
    marks: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def compare_pairs(spin: Array, points: Array, before: np.ndarray, pairs: np.ndarray, images: MarkImages, contrast: float) -> PairComparison:
    """Compare the ball's surface in pairs of frames: the points seen in the first frame are rotated by the spin into the second one.

    Args:
        spin: (3,) rad/s in `table`.
        points: (n, 3) unit vectors in `table`, points of the ball's surface at the time of the first frame of a pair.
        before: (p, n) POINT_MARK, the surface at these points in the first frame of each pair, from `first_samples`.
        pairs: (p, 2) indices of frames, the earlier one first.
        images: The ball's surface in all images.
        contrast: Variance of the brightness; it makes the cost of unrelated marks 0.
    """
    marks, views, times = images.marks, images.views, images.times
    cost, total, h, g, row = 0.0, 0.0, np.zeros((3, 3)), np.zeros(3), np.empty(3)
    for p in range(len(pairs)):
        dt = times[pairs[p, 1]] - times[pairs[p, 0]]
        turn, left = unpack_rotation(rotation_matrix(spin * dt)), unpack_rotation(dt * left_jacobian(spin * dt))
        for q in range(len(points)):
            if before[p, q].weight <= 0.0:
                continue
            x, y, z = rotate(turn, points[q, 0], points[q, 1], points[q, 2])
            seen = sample_best(marks, views, pairs[p, 1], len(times), x, y, z)
            if seen.weight <= 0.0:
                continue
            d = seen.brightness - before[p, q].brightness
            w = seen.weight * before[p, q].weight
            c0, c1, c2 = y * seen.gz - z * seen.gy, z * seen.gx - x * seen.gz, x * seen.gy - y * seen.gx
            row[0], row[1], row[2] = rotate_back(left, c0, c1, c2)
            cost += w * (d * d - 2.0 * contrast)
            total += w
            for a in range(3):
                g[a] += w * row[a] * d
                for b in range(3):
                    h[a, b] += w * row[a] * row[b]
    return PairComparison(cost, total, h, g)


@njit(cache=True, nogil=True)
def turned(spin: Array, images: MarkImages) -> Array:
    """Return for each image the rotation (images, 3, 3) from the ball, in its orientation at time 0, to the camera's frame.

    Args:
        spin: (3,) rad/s in `table`.
        images: Views and times of the images; time 0 is the mean time of the frames.
    """
    out = np.empty((len(images.views), 3, 3))
    for m in range(len(images.views)):
        out[m] = images.views[m].rotation.copy() @ rotation_matrix(spin * images.times[images.frame_of[m]])
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _sights(spin: Array, images: MarkImages) -> np.ndarray:
    """Return for each image how the camera sees the ball that is rotated by a spin, (images,) SIGHT."""
    views, turns, out = images.views, turned(spin, images), np.empty(len(images.views), dtype=SIGHT)
    for m in range(len(views)):
        t, centre, sight = images.times[images.frame_of[m]], views[m].centre, out[m]
        arm = t * (views[m].rotation.copy() @ left_jacobian(spin * t)).T
        distance = math.sqrt(centre[0] ** 2 + centre[1] ** 2 + centre[2] ** 2)
        for a in range(3):
            sight.centre[a] = centre[a]
            sight.facing[a] = -(turns[m, 0, a] * centre[0] + turns[m, 1, a] * centre[1] + turns[m, 2, a] * centre[2]) / distance
            for b in range(3):
                sight.turn[a, b], sight.arm[a, b] = turns[m, a, b], arm[a, b]
    return out


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def compare_all(spin: Array, points: np.ndarray, images: MarkImages) -> Comparison:
    """Compare the brightness of each point of the ball in all images that show it, with the ball rotated by a spin.

    At each point the images are compared with the brightness that fits them best. This unknown brightness is eliminated from the normal
    equations (variable projection, Golub and Pereyra 1973). The values of one point are computed in single precision, which is accurate to
    1e-5 pixels in the image; the sums over all points are computed in double precision.

    Args:
        spin: (3,) rad/s in `table`.
        points: (n, 3) float32 unit vectors, points of the ball in its orientation at time 0, the mean time of the frames.
        images: The ball's surface in all images.
    """
    marks, views, sights = images.marks, images.views, _sights(spin, images)
    limb, least, zero, one = np.float32(LIMB), np.float32(LEAST_WEIGHT), np.float32(0.0), np.float32(1.0)
    radius_of_ball, last_u, last_v = np.float32(BALL_RADIUS), marks.shape[2] - 1, marks.shape[1] - 1
    drawn = np.zeros(len(points), dtype=POINT_MARK)
    h00 = h01 = h02 = h11 = h12 = h22 = g0 = g1 = g2 = error = total = 0.0
    for i in range(len(points)):
        p, q, s = points[i, 0], points[i, 1], points[i, 2]
        seen, sw, sv, svv, s0, s1, s2, b0, b1, b2 = 0, zero, zero, zero, zero, zero, zero, zero, zero, zero
        a00 = a01 = a02 = a11 = a12 = a22 = zero
        for m in range(len(views)):
            sight = sights[m]
            facing, turn, arm, centre = sight.facing, sight.turn, sight.arm, sight.centre
            if facing[0] * p + facing[1] * q + facing[2] * s < limb:
                continue
            x = turn[0, 0] * p + turn[0, 1] * q + turn[0, 2] * s
            y = turn[1, 0] * p + turn[1, 1] * q + turn[1, 2] * s
            z = turn[2, 0] * p + turn[2, 1] * q + turn[2, 2] * s
            near = one / (centre[2] + radius_of_ball * z)
            u, v = (centre[0] + radius_of_ball * x) * near, (centre[1] + radius_of_ball * y) * near
            optics = view_optics(views[m])
            focal, across, down = np.float32(optics.focal), u, v
            if optics.k1 != 0.0 or optics.k2 != 0.0 or optics.p1 != 0.0 or optics.p2 != 0.0 or optics.k3 != 0.0:
                bent = distort(optics, np.float64(u), np.float64(v))
                across, down = np.float32(bent[0]), np.float32(bent[1])
            column, row = focal * across + np.float32(optics.u0), focal * down + np.float32(optics.v0)
            k, j = int(column), int(row)
            if k < 0 or j < 0 or k >= last_u or j >= last_v:
                continue
            a, b = column - np.float32(k), row - np.float32(j)
            q11 = a * b
            q10, q01 = a - q11, b - q11
            q00 = one - a - q01
            p00, p10, p01, p11 = marks[m, j, k], marks[m, j, k + 1], marks[m, j + 1, k], marks[m, j + 1, k + 1]
            w = q00 * p00.weight + q10 * p10.weight + q01 * p01.weight + q11 * p11.weight
            if w <= least:
                continue
            e = q00 * p00.brightness + q10 * p10.brightness + q01 * p01.brightness + q11 * p11.brightness - one
            scale = focal * radius_of_ball * near
            gx = scale * (q00 * p00.slope_u + q10 * p10.slope_u + q01 * p01.slope_u + q11 * p11.slope_u)
            gy = scale * (q00 * p00.slope_v + q10 * p10.slope_v + q01 * p01.slope_v + q11 * p11.slope_v)
            gz = -(gx * u + gy * v)
            t0, t1, t2 = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
            j0 = arm[0, 0] * t0 + arm[0, 1] * t1 + arm[0, 2] * t2
            j1 = arm[1, 0] * t0 + arm[1, 1] * t1 + arm[1, 2] * t2
            j2 = arm[2, 0] * t0 + arm[2, 1] * t1 + arm[2, 2] * t2
            seen += 1
            we, w0, w1, w2 = w * e, w * j0, w * j1, w * j2
            sw, sv, svv = sw + w, sv + we, svv + we * e
            s0, s1, s2 = s0 + w0, s1 + w1, s2 + w2
            b0, b1, b2 = b0 + w0 * e, b1 + w1 * e, b2 + w2 * e
            a00, a01, a02, a11, a12, a22 = a00 + w0 * j0, a01 + w0 * j1, a02 + w0 * j2, a11 + w1 * j1, a12 + w1 * j2, a22 + w2 * j2
        if seen == 0:
            continue
        mean = sv / sw
        drawn[i].brightness, drawn[i].weight = one + mean, sw
        if seen < 2:
            continue
        g0, g1, g2 = g0 + (b0 - s0 * mean), g1 + (b1 - s1 * mean), g2 + (b2 - s2 * mean)
        h00, h01, h02 = h00 + (a00 - s0 * s0 / sw), h01 + (a01 - s0 * s1 / sw), h02 + (a02 - s0 * s2 / sw)
        h11, h12, h22 = h11 + (a11 - s1 * s1 / sw), h12 + (a12 - s1 * s2 / sw), h22 + (a22 - s2 * s2 / sw)
        error += svv - sv * mean
        total += sw
    h = np.array([[h00, h01, h02], [h01, h11, h12], [h02, h12, h22]])
    return Comparison(h, np.array([g0, g1, g2]), error / max(total, 1e-12), total, drawn)


@njit(cache=True, nogil=True, error_model="numpy")
def gauss_newton_step(h: Array, g: Array, most: float) -> Array:
    """Return the Gauss-Newton step of the spin, shortened to a largest length; it is to be subtracted from the spin.

    Args:
        h: (3, 3) (rad/s)^-2, normal matrix.
        g: (3,) s/rad, gradient.
        most: rad/s, largest length of the step.

    Returns:
        (3,) rad/s.
    """
    damped = h + (1e-9 * np.trace(h) + 1e-30) * np.eye(3)
    step = np.linalg.solve(damped, g)
    return step * min(1.0, most / max(math.sqrt(step @ step), 1e-12))


@njit(cache=True, nogil=True, error_model="numpy")
def refine_on_pairs(
    spin: Array, points: Array, before: np.ndarray, pairs: np.ndarray, images: MarkImages, contrast: float, most: float
) -> tuple[Array, float]:
    """Refine a spin on pairs of frames by PAIR_STEPS Gauss-Newton steps.

    Args:
        spin: (3,) rad/s in `table`, where the refinement starts.
        points: (n, 3) unit vectors, see `compare_pairs`.
        before: (p, n) POINT_MARK, see `compare_pairs`.
        pairs: (p, 2) indices of frames, see `compare_pairs`.
        images: The ball's surface in all images.
        contrast: Variance of the brightness.
        most: rad/s, largest length of a step.

    Returns:
        The spin (3,) rad/s, and the residual of the spin before the last step: 0 if the marks agree, 1 if they are unrelated.
    """
    residual = 1.0
    for _ in range(PAIR_STEPS):
        pair = compare_pairs(spin, points, before, pairs, images, contrast)
        residual = 1.0 + pair.cost / (2.0 * max(pair.weight, 1e-12) * contrast)
        spin = spin - gauss_newton_step(pair.normal_matrix, pair.gradient, most)
    return spin, residual


@njit(cache=True, nogil=True, error_model="numpy")
def refine_on_all(spin: Array, points: Array, images: MarkImages, least_step: float) -> tuple[Array, Comparison]:
    """Refine a spin on all images by at most MOST_REFINEMENT_STEPS Gauss-Newton steps.

    Args:
        spin: (3,) rad/s in `table`, where the refinement starts.
        points: (n, 3) float32 unit vectors, see `compare_all`.
        images: The ball's surface in all images.
        least_step: rad/s; the refinement ends after a shorter step.

    Returns:
        The spin (3,) rad/s, and the comparison of the images for the spin before the last step.
    """
    most = MOST_STEP / shortest_gap(images.times)
    compared = compare_all(spin, points, images)
    for step in range(MOST_REFINEMENT_STEPS):
        if step > 0:
            compared = compare_all(spin, points, images)
        change = gauss_newton_step(compared.normal_matrix, compared.gradient, most)
        spin = spin - change
        if math.sqrt(change @ change) < least_step:
            break
    return spin, compared
