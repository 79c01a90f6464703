"""Fit one flight to the measurements in a window of time: Gauss-Newton least squares, with a prior at the start of the window.

All measurements in the window are predicted from the state of the ball at the start of the window, through flight and bounces, with exact
derivatives (`tt_core.tangents`). A Kalman filter uses each measurement once; here, in contrast, the result does not depend on the order in
which measurements arrive, and it is not linearised at a poor first estimate. What the measurements tell that leave the window is kept in
the prior.

The unknowns (n,) are those of `tt_core.tangents`: the state at the start of the window (position m, velocity m/s, spin rad/s), then the
logarithms of factors on drag, lift, restitution, friction and grip (14 numbers in all, PARAMETERS). If the cameras may have moved since
their calibration, a constant error of column u and row v in pixels follows for each camera.

Residuals and derivatives are "whitened": divided by the standard deviation of the measurement.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.arrays import VX, WX, Array, X
from tt_core.interpolate import hermite_weights
from tt_core.physics import physics_coefficients
from tt_core.tangents import PARAMETERS, TangentScratch, advance, bounce_now, fly_through, scratch, start_tangents, with_factors

from ..projection import CameraModel, rotate, unpack_camera
from .history import CAPACITY, MEASURED_POSITION, Measurements

MOST_PASSES = 12  # largest number of Gauss-Newton steps of one fit
STEP_HALVINGS = 5  # how many lengths of a step are tried, each half of the one before, while it makes the fit worse
DONE = 1e-3  # squared length of a step in standard deviations, below which it is the last one
BEHIND_CAMERA = 1e6  # whitened residual that is used for a ball behind a camera
FARTHEST_STEP = 30.0  # longest step, in standard deviations of the prior
MEDIANS = np.array([1.0, 0.4549, 1.3863, 2.3660])  # medians of chi-square with 1, 2 and 3 degrees of freedom; the first number is not used
LEAST_EXCESS = 2.0  # squared ratio of residuals to their standard deviations above which the given standard deviations are enlarged
MOST_EXCESS = 100.0  # the same ratio above which they are not enlarged, because the measurements belong to another flight
MOST_ROUNDS = 4  # largest number of rounds of fitting and of choosing the measurements that are used
VARIANCE_STEPS = 3  # steps of expectation and maximisation in each round


class Prior(NamedTuple):
    """What is known about the unknowns before the measurements in the window: a normal distribution.

    If a ball is found without a measured state to start from, not even the order of magnitude of its spin is known: opponents play 15 to
    900 rad/s. Then the variance of the spin is estimated, too, with an inverse gamma distribution as its prior. So a ball without spin is
    soon known to have none, and a large spin is not drawn to zero.

    Attributes:
        time: s, start of the window, the time of the unknowns.
        mean: (n,) expected unknowns.
        information: (n, n) inverse of their covariance. Its part of the spin changes in place when the variance of the spin is estimated.
        spin_shape: (3, 3) inverse of the covariance of the spin if its variance were 1; zero if the variance is not estimated.
        spin_variance: (rad/s)^2, variance of the spin before any measurement.
        spin_weight: Number of measured spin components that have as much weight as `spin_variance`.
    """

    time: float
    mean: Array
    information: Array
    spin_shape: Array
    spin_variance: float
    spin_weight: float


class Workspace(NamedTuple):
    """Arrays that a fit fills: the results for each measurement, and the normal equations.

    Attributes:
        rows: (CAPACITY, 3, n) derivatives of the predicted measurements by the unknowns, whitened.
        residuals: (CAPACITY, 3) measured minus predicted values, whitened.
        normal: (n, n) normal matrix.
        right: (n,) right side of the normal equations.
        covariance: (n, n) covariance of the unknowns after a fit.
    """

    rows: Array
    residuals: Array
    normal: Array
    right: Array
    covariance: Array


def workspace(unknowns: int) -> Workspace:
    """Create the arrays of a fit with this number of unknowns."""
    return Workspace(
        np.zeros((CAPACITY, 3, unknowns)),
        np.zeros((CAPACITY, 3)),
        np.empty((unknowns, unknowns)),
        np.empty(unknowns),
        np.empty((unknowns, unknowns)),
    )


@njit(cache=True)
def _predict_pixel(camera: CameraModel, place: Array, slopes: Array) -> tuple[float, float]:
    """Return the pixel (u, v) at which a camera sees a point, NaN for a point behind the camera.

    Args:
        camera: The camera.
        place: (3,) m in `table`, the point.
        slopes: (2, 3) pixels/m, filled with the derivatives of u and v by the point.
    """
    turned, lens = camera.rotation, camera.optics
    x, y, z = rotate(turned, place[0], place[1], place[2])
    x, y, z = x + camera.tx, y + camera.ty, z + camera.tz
    if z <= 1e-6:
        return math.nan, math.nan
    a, b = x / z, y / z
    r2 = a * a + b * b
    radial = 1.0 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3))
    bend = 2.0 * (lens.k1 + r2 * (2.0 * lens.k2 + 3.0 * r2 * lens.k3))
    u = a * radial + 2.0 * lens.p1 * a * b + lens.p2 * (r2 + 2.0 * a * a)
    v = b * radial + lens.p1 * (r2 + 2.0 * b * b) + 2.0 * lens.p2 * a * b
    uu = radial + a * a * bend + 2.0 * lens.p1 * b + 6.0 * lens.p2 * a
    uv = a * b * bend + 2.0 * lens.p1 * a + 2.0 * lens.p2 * b
    vv = radial + b * b * bend + 6.0 * lens.p1 * b + 2.0 * lens.p2 * a
    for k in range(3):
        if k == 0:
            dx, dy, dz = turned.xx, turned.yx, turned.zx
        elif k == 1:
            dx, dy, dz = turned.xy, turned.yy, turned.zy
        else:
            dx, dy, dz = turned.xz, turned.yz, turned.zz
        da, db = (dx - a * dz) / z, (dy - b * dz) / z
        slopes[0, k] = lens.focal * (uu * da + uv * db)
        slopes[1, k] = lens.focal * (uv * da + vv * db)
    return lens.focal * u + lens.u0, lens.focal * v + lens.v0


@njit(cache=True)
def _compare(place: Array, tangents: Array, i: int, seen: Measurements, cameras: Array, unknowns: Array, space: Workspace) -> None:
    """Compute the whitened residual of one measurement and its derivatives.

    Args:
        place: (3,) m in `table`, predicted position of the ball.
        tangents: (3, PARAMETERS) derivatives of this position by the unknowns.
        i: Index of the measurement.
        seen: All measurements.
        cameras: (c, 20) `Camera.vector` of each camera.
        unknowns: (n,), of which the errors of the cameras are used.
        space: `residuals[i]` and `rows[i]` are filled.
    """
    rows, residual, root, value = space.rows[i], space.residuals[i], seen.roots[i], seen.values[i]
    if seen.cameras[i] == MEASURED_POSITION:
        for r in range(3):
            residual[r] = 0.0
            for k in range(r + 1):
                residual[r] += root[r, k] * (value[k] - place[k])
            for c in range(PARAMETERS):
                rows[r, c] = 0.0
                for k in range(r + 1):
                    rows[r, c] += root[r, k] * tangents[k, c]
        return
    side, slopes = seen.cameras[i], np.empty((2, 3))
    u, v = _predict_pixel(unpack_camera(cameras[side]), place, slopes)
    if math.isnan(u):
        rows[:] = 0.0
        residual[0], residual[1], residual[2] = BEHIND_CAMERA, 0.0, 0.0
        return
    weight, biased = root[0, 0], len(unknowns) > PARAMETERS
    bias = PARAMETERS + 2 * side
    residual[0] = weight * (value[0] - u - (unknowns[bias] if biased else 0.0))
    residual[1] = weight * (value[1] - v - (unknowns[bias + 1] if biased else 0.0))
    residual[2] = 0.0
    for r in range(2):
        for c in range(PARAMETERS):
            rows[r, c] = weight * (slopes[r, 0] * tangents[0, c] + slopes[r, 1] * tangents[1, c] + slopes[r, 2] * tangents[2, c])
        for c in range(PARAMETERS, len(unknowns)):
            rows[r, c] = 0.0
        if biased:
            rows[r, bias + r] = weight
    rows[2] = 0.0


@njit(cache=True)
def _linearise(
    start: float, unknowns: Array, seen: Measurements, cameras: Array, physics: Array, space: Workspace, air: TangentScratch
) -> bool:
    """Predict all measurements from the unknowns, and compute their residuals and derivatives.

    Args:
        start: s, start of the window; no measurement is earlier.
        unknowns: (n,) at that time.
        seen: All measurements.
        cameras: (c, 20) `Camera.vector` of each camera.
        physics: (19,) `Physics.coefficients`.
        space: `residuals` and `rows` are filled.
        air: Work arrays.

    Returns:
        Whether the flight is finite; if not, the results are incomplete.
    """
    models = with_factors(physics_coefficients(physics), unknowns)
    state, tangents = unknowns[:9].copy(), np.empty((9, PARAMETERS))
    start_tangents(tangents)
    last, last_tangents = np.empty(9), np.empty((6, PARAMETERS))
    place, moved = np.empty(3), np.empty((3, PARAMETERS))
    now, i, n = start, 0, len(seen.times)
    while i < n and seen.times[i] <= start:
        _compare(state[:3], tangents[:3], i, seen, cameras, unknowns, space)
        i += 1
    end = seen.times[n - 1] if n > 0 else start
    while i < n:
        last[:] = state
        last_tangents[:] = tangents[:6]
        h, contact = advance(state, tangents, max(end - now, 1e-9), models, air)
        for k in range(6):
            if not abs(state[k]) < 1e3:
                return False
        while i < n and h > 0.0 and seen.times[i] <= now + h + 1e-12:
            a, b, c, d = hermite_weights(h, min(1.0, (seen.times[i] - now) / h))
            for k in range(3):
                place[k] = a * last[k] + b * last[VX + k] + c * state[k] + d * state[VX + k]
                for p in range(PARAMETERS):
                    moved[k, p] = a * last_tangents[k, p] + b * last_tangents[3 + k, p] + c * tangents[k, p] + d * tangents[3 + k, p]
            _compare(place, moved, i, seen, cameras, unknowns, space)
            i += 1
        now += h
        if contact:
            bounce_now(state, tangents, models, air)
    return True


@njit(cache=True)
def _accumulate(unknowns: Array, prior: Prior, seen: Measurements, excess: float, space: Workspace) -> float:
    """Sum the normal equations over the prior and all measurements that are used.

    Args:
        unknowns: (n,) at which the residuals were computed.
        prior: The prior.
        seen: All measurements.
        excess: Factor by which the variances of the measurements are larger than given.
        space: `normal` and `right` are filled from `residuals` and `rows`.

    Returns:
        The cost: the sum of all squared residuals, those from the prior included.
    """
    n = len(unknowns)
    off = prior.mean - unknowns
    space.normal[:] = prior.information
    space.right[:] = prior.information @ off
    cost = 0.0
    for r in range(n):
        cost += off[r] * space.right[r]
    weight = 1.0 / excess
    for i in range(len(seen.times)):
        if not seen.used[i]:
            continue
        for m in range(3 if seen.cameras[i] == MEASURED_POSITION else 2):
            row, residual = space.rows[i, m], space.residuals[i, m]
            cost += weight * residual * residual
            for r in range(n):
                if row[r] != 0.0:
                    scaled = weight * row[r]
                    space.right[r] += scaled * residual
                    for c in range(r, n):
                        space.normal[r, c] += scaled * row[c]
    for r in range(n):
        for c in range(r):
            space.normal[r, c] = space.normal[c, r]
    return cost


@njit(cache=True)
def invert(matrix: Array) -> Array:
    """Return the inverse of a symmetric positive definite matrix, which is scaled to a unit diagonal before, for accuracy."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.linalg.inv(matrix * scale * scale.reshape(-1, 1))
    inverse = inverse * scale * scale.reshape(-1, 1)
    return 0.5 * (inverse + inverse.T)


@njit(cache=True)
def _distance(i: int, size: int, excess: float, covariance: Array, space: Workspace) -> float:
    """Return the squared Mahalanobis distance of a measurement from its prediction, in standard deviations of their difference.

    Args:
        i: Index of the measurement.
        size: Number of its coordinates: 3 of a position, 2 of a pixel.
        excess: Factor by which its variance is larger than given.
        covariance: (n, n) covariance of the unknowns.
        space: Holds its residual and derivatives.
    """
    rows = space.rows[i, :size].copy()
    expected = rows @ covariance @ rows.T
    for k in range(size):
        expected[k, k] += excess
    residual = space.residuals[i, :size].copy()
    return float(residual @ np.linalg.solve(expected, residual))


@njit(cache=True)
def _admit(seen: Measurements, gates: Array, excess: float, covariance: Array, space: Workspace) -> bool:
    """Mark those unused measurements as used that agree with the prediction; return whether there are any."""
    admitted = False
    for i in range(len(seen.times)):
        if not seen.used[i] and abs(space.residuals[i, 0]) < BEHIND_CAMERA:
            size = 3 if seen.cameras[i] == MEASURED_POSITION else 2
            if _distance(i, size, excess, covariance, space) < gates[size]:
                seen.used[i] = True
                admitted = True
    return admitted


@njit(cache=True)
def _expel(seen: Measurements, gates: Array, excess: float, space: Workspace) -> bool:
    """Mark those used measurements as unused that do not agree with the fit; return whether there are any."""
    expelled = False
    for i in range(len(seen.times)):
        if seen.used[i]:
            r = space.residuals[i]
            if r[0] * r[0] + r[1] * r[1] + r[2] * r[2] > excess * gates[3 if seen.cameras[i] == MEASURED_POSITION else 2]:
                seen.used[i] = False
                expelled = True
    return expelled


@njit(cache=True)
def _excess(seen: Measurements, space: Workspace) -> float:
    """Estimate by which factor the variances of the measurements are larger than given, from the median of the residuals.

    The result is 1 unless the factor is between LEAST_EXCESS and MOST_EXCESS.
    """
    n = len(seen.times)
    if n == 0:
        return 1.0
    ratios = np.empty(n)
    for i in range(n):
        r = space.residuals[i]
        ratios[i] = (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) / MEDIANS[3 if seen.cameras[i] == MEASURED_POSITION else 2]
    found = float(np.median(ratios))
    return found if LEAST_EXCESS < found < MOST_EXCESS else 1.0


@njit(cache=True)
def _learn_spin_variance(unknowns: Array, prior: Prior, seen: Measurements, excess: float, space: Workspace) -> None:
    """Estimate the variance of the spin by expectation and maximisation, and put it into `prior.information`, in place."""
    spin = slice(WX, WX + 3)
    for _ in range(VARIANCE_STEPS):
        _accumulate(unknowns, prior, seen, excess, space)
        w = unknowns[spin] + _newton_step(space)[spin]
        spin_covariance = np.ascontiguousarray(invert(space.normal)[spin, spin])
        total = w @ prior.spin_shape @ w + np.trace(prior.spin_shape @ spin_covariance)
        variance = (total + prior.spin_weight * prior.spin_variance) / (3.0 + prior.spin_weight)
        prior.information[spin, spin] = prior.spin_shape / variance


@njit(cache=True)
def _newton_step(space: Workspace) -> Array:
    """Return the Gauss-Newton step (n,): the solution of the normal equations."""
    step = np.empty_like(space.right)
    step[:] = np.linalg.solve(space.normal, space.right)
    return step


@njit(cache=True)
def _move(unknowns: Array, delta: Array, count: int, space: Workspace) -> None:
    """Add a step `delta` (n,) to the unknowns, and change the residuals of the first `count` measurements by it to first order."""
    unknowns += delta
    for i in range(count):
        for m in range(3):
            space.residuals[i, m] -= space.rows[i, m] @ delta


@njit(cache=True)
def _converge(
    unknowns: Array, prior: Prior, seen: Measurements, cameras: Array, physics: Array, excess: float, space: Workspace, air: TangentScratch
) -> bool:
    """Minimise the cost over the unknowns by Gauss-Newton steps, with the choice of used measurements as it is.

    Args:
        unknowns: (n,) where the fit starts, changed in place.
        prior: The prior.
        seen: All measurements.
        cameras: (c, 20) `Camera.vector` of each camera.
        physics: (19,) `Physics.coefficients`.
        excess: Factor by which the variances of the measurements are larger than given.
        space: Filled; the residuals are those after the last step.
        air: Work arrays.

    Returns:
        False if the flight is not finite, else True.
    """
    n = len(seen.times)
    if not _linearise(prior.time, unknowns, seen, cameras, physics, space, air):
        return False
    cost = _accumulate(unknowns, prior, seen, excess, space)
    for _ in range(MOST_PASSES):
        delta = _newton_step(space)
        size = float(delta @ space.normal @ delta)
        if size < DONE:
            _move(unknowns, delta, n, space)
            return True
        far = float(delta @ prior.information @ delta)
        share = 1.0 if far < FARTHEST_STEP**2 else FARTHEST_STEP / math.sqrt(far)
        here = unknowns.copy()
        for _ in range(STEP_HALVINGS):
            unknowns[:] = here + share * delta
            if _linearise(prior.time, unknowns, seen, cameras, physics, space, air):
                new = _accumulate(unknowns, prior, seen, excess, space)
                if new <= cost + 1e-6:
                    break
            share *= 0.5
        else:
            unknowns[:] = here
            if not _linearise(prior.time, unknowns, seen, cameras, physics, space, air):
                return False
            _accumulate(unknowns, prior, seen, excess, space)
            return True
        small = cost - new < DONE
        cost = new
        if small:
            return True
    return True


@njit(cache=True)
def fit_window(
    unknowns: Array, prior: Prior, seen: Measurements, cameras: Array, physics: Array, gates: Array, space: Workspace, excess: float
) -> float:
    """Fit the unknowns to the measurements in the window, and choose which measurements are used.

    An unused measurement is admitted if it agrees with the prediction from the others (chi-square test of its distance). A used one is
    excluded if the fit does not agree with it. Every fit tests all measurements in the window again, so a wrong decision does not last.

    Args:
        unknowns: (n,) at the start of the window, where the fit starts; changed in place.
        prior: What was known before the measurements in the window.
        seen: The measurements; `used` is changed in place.
        cameras: (c, 20) `Camera.vector` of each camera.
        physics: (19,) `Physics.coefficients`.
        gates: (4,) `TrackerParams.gates`, bounds of the chi-square test.
        space: Filled. Before, its `covariance` must hold the covariance of the unknowns without the unused measurements.
        excess: Factor by which the variances of the measurements were larger than given, as the last fit returned it; 1 for the first fit.

    Returns:
        This factor by the present fit; NaN if the fit has failed.
    """
    air = scratch()
    if not _linearise(prior.time, unknowns, seen, cameras, physics, space, air):
        return math.nan
    _admit(seen, gates, excess, space.covariance, space)
    learns = prior.spin_shape[0, 0] > 0.0
    for k in range(MOST_ROUNDS):
        if learns:
            _learn_spin_variance(unknowns, prior, seen, excess, space)
        if not _converge(unknowns, prior, seen, cameras, physics, excess, space, air):
            return math.nan
        found = _excess(seen, space)
        different = found > 1.25 * excess or found < 0.8 * excess
        excess = found if different else excess
        if learns:  # a spin that cannot be seen yet may still be large: the covariance is that for the first variance
            space.normal[WX : WX + 3, WX : WX + 3] += prior.spin_shape / prior.spin_variance - prior.information[WX : WX + 3, WX : WX + 3]
        space.covariance[:] = invert(space.normal)
        changed = _expel(seen, gates, excess, space)
        if k < MOST_ROUNDS - 1 and not changed:
            changed = _admit(seen, gates, excess, space.covariance, space)
        if not changed and not different:
            break
    return excess if np.isfinite(unknowns).all() and np.isfinite(space.covariance).all() else math.nan


@njit(cache=True)
def shift(
    unknowns: Array, prior: Prior, until: float, gone: Measurements, physics: Array, noise: Array, space: Workspace, excess: float
) -> Prior:
    """Move the start of the window to a later time, and put the information of the measurements before it into the prior (marginalisation).

    Args:
        unknowns: (n,) as fitted, at the time of the prior; changed in place to those at `until`.
        prior: The prior of the fit.
        until: s, new start of the window.
        gone: The measurements before `until`, which were the first ones of the fit.
        physics: (19,) `Physics.coefficients`.
        noise: (2,) or more numbers, of which the first two are power densities of what no model describes: acceleration ((m/s^2)^2/Hz) and
            change of spin ((rad/s^2)^2/Hz).
        space: Results of the fit; its `covariance` is changed to that at `until`.
        excess: Factor that the fit returned.

    Returns:
        The new prior, at `until`. It has a fixed variance of the spin.
    """
    n = len(unknowns)
    _accumulate(unknowns, prior, gone, excess, space)
    before = invert(space.normal)
    pull = before @ space.right
    flow = np.eye(n)
    models, state, tangents = with_factors(physics_coefficients(physics), unknowns), unknowns[:9].copy(), np.empty((9, PARAMETERS))
    start_tangents(tangents)
    fly_through(state, tangents, until - prior.time, models, scratch())
    flow[:9, :PARAMETERS] = tangents
    unknowns[:9] = state
    covariance = flow @ before @ flow.T
    add_noise(covariance, until - prior.time, noise)
    space.covariance[:] = flow @ space.covariance @ flow.T
    add_noise(space.covariance, until - prior.time, noise)
    known = invert(0.5 * (covariance + covariance.T))
    return Prior(until, unknowns + flow @ pull, known, np.zeros((3, 3)), 0.0, 0.0)


@njit(cache=True)
def add_noise(covariance: Array, duration: float, noise: Array) -> None:
    """Increase the covariance of a state by random accelerations and changes of spin that no model describes.

    Args:
        covariance: (n, n) of the state (position m, velocity m/s, spin rad/s) and possibly further unknowns, changed in place.
        duration: s, for which they act.
        noise: (2,) or more numbers, of which the first two are power densities: of the acceleration ((m/s^2)^2/Hz) and of the change of
            spin ((rad/s^2)^2/Hz).
    """
    for k in range(3):
        covariance[X + k, X + k] += noise[0] * duration**3 / 3.0
        covariance[X + k, VX + k] += noise[0] * duration**2 / 2.0
        covariance[VX + k, X + k] += noise[0] * duration**2 / 2.0
        covariance[VX + k, VX + k] += noise[0] * duration
        covariance[WX + k, WX + k] += noise[1] * duration
