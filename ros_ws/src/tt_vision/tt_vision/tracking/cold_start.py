"""Find a ball without a known state to start from, in a few measured positions or pixels, some of which may be wrong.

Over a short time a flight is nearly a parabola under gravity, and the equations of measured positions and of rays through pixels are linear
in its position and velocity. A parabola is fitted to each triple of measurements, and the one that agrees with most other measurements is
kept (consensus, Fischler and Bolles 1981). All triples are tried in turn, so that equal input gives equal output.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from tt_core.arrays import VZ, Array, Z
from tt_core.constants import GRAVITY

from ..projection import project_from_table, ray, unpack_camera
from .history import MEASURED_POSITION, Measurements, select

MOST = 12  # largest number of measurements that are compared: 220 triples
SPAN = 0.15  # s, longest time between the first and the last of these measurements
FAST_SPAN = 0.05  # s; if more than MOST measurements arrive within this time, MOST of them are chosen, evenly spread
EQUATIONS = 12  # least number of coordinates that must agree; six determine a parabola
SHARE = 0.6  # least share of the coordinates that must agree
UNKNOWN_ACCELERATION = 12.0  # m/s^2, by drag and lift, which the parabola leaves out
AGREEMENT_SIGMAS = 4.0  # largest distance, in standard deviations, at which a measurement agrees
WIDENINGS = 4  # how many standard deviations are tried: those given, then each time twice as large, in case they were too small
RIDGE = 1e-9  # added to the diagonal of the scaled normal equations
LARGEST_PLAUSIBLE = 100.0  # m and m/s, largest coordinate of a position and of a velocity that is plausible


def count_within(times: Array) -> int:
    """Return how many measurements, from the first on, are searched together for a ball.

    Args:
        times: (n,) s, stamps of the measurements, not decreasing.
    """
    if len(times) == 0:
        return 0
    within, fast = np.searchsorted(times, [times[0] + SPAN, times[0] + FAST_SPAN], side="right")
    return int(min(within, max(MOST, fast)))


def find_ball_motion(seen: Measurements, cameras: Array) -> Array | None:
    """Find the position and the velocity of a ball in measurements, some of which may be wrong.

    At most MOST of the measurements, evenly spread, are compared.

    Args:
        seen: Measurements in a short time, see `count_within`. `used` is set to True for those that were compared and agree with the ball,
            to False for all others.
        cameras: (c, 20) `Camera.vector` of each camera.

    Returns:
        (6,) position (m) and velocity (m/s) in `table` at the time of the first measurement that agrees; None if too few agree.
    """
    chosen = np.unique(np.linspace(0, len(seen.times) - 1, min(MOST, len(seen.times))).astype(np.int64))
    few, parabola = select(seen, chosen), np.empty(6)
    found = len(chosen) > 0 and find_parabola(few, cameras, parabola)
    seen.used[:] = False
    seen.used[chosen] = few.used & found
    return parabola if found else None


@njit(cache=True)
def _add(normal: Array, right: Array, a: Array, time: float, b: float) -> None:
    """Add one equation to the normal equations: a . (p + v time) = b, for position p and velocity v, each (3,)."""
    row = np.empty(6)
    row[:3] = a
    row[3:] = a * time
    for r in range(6):
        right[r] += row[r] * b
        for c in range(6):
            normal[r, c] += row[r] * row[c]


@njit(cache=True)
def _sum(i: int, middle: float, seen: Measurements, cameras: Array, normal: Array, right: Array) -> None:
    """Add the equations of one measurement, divided by its standard deviation, to the normal equations of a parabola.

    Args:
        i: Index of the measurement.
        middle: s, time at which position and velocity of the parabola are the unknowns.
        seen: All measurements.
        cameras: (c, 20) `Camera.vector` of each camera.
        normal: (6, 6) normal matrix, increased in place.
        right: (6,) right side, increased in place.
    """
    time, a = seen.times[i] - middle, np.empty(3)
    fall = 0.5 * GRAVITY * time * time
    if seen.cameras[i] == MEASURED_POSITION:
        for k in range(3):
            a[:] = seen.roots[i, k]
            value = seen.values[i]
            _add(normal, right, a, time, a[0] * value[0] + a[1] * value[1] + a[2] * (value[2] + fall))
        return
    camera = unpack_camera(cameras[seen.cameras[i]])
    x, y = ray(camera.optics, seen.values[i, 0], seen.values[i, 1])
    r = camera.rotation
    depth = max(0.1, np.sqrt(camera.tx**2 + camera.ty**2 + camera.tz**2))  # of the table's origin: weights need no better one
    weight = camera.optics.focal * seen.roots[i, 0, 0] / depth
    a[0], a[1], a[2] = weight * (r.xx - x * r.zx), weight * (r.xy - x * r.zy), weight * (r.xz - x * r.zz)
    _add(normal, right, a, time, weight * (x * camera.tz - camera.tx) + a[2] * fall)
    a[0], a[1], a[2] = weight * (r.yx - y * r.zx), weight * (r.yy - y * r.zy), weight * (r.yz - y * r.zz)
    _add(normal, right, a, time, weight * (y * camera.tz - camera.ty) + a[2] * fall)


@njit(cache=True)
def _agrees(i: int, middle: float, parabola: Array, wide: float, seen: Measurements, cameras: Array) -> bool:
    """Return whether a measurement agrees with a parabola.

    Args:
        i: Index of the measurement.
        middle: s, time at which the parabola has its position and velocity.
        parabola: (6,) position (m) and velocity (m/s) at that time.
        wide: Factor on the standard deviation of the measurement.
        seen: All measurements.
        cameras: (c, 20) `Camera.vector` of each camera.
    """
    time, place = seen.times[i] - middle, np.empty(3)
    for k in range(3):
        place[k] = parabola[k] + time * parabola[3 + k]
    place[2] -= 0.5 * GRAVITY * time * time
    slack = 0.5 * UNKNOWN_ACCELERATION * time * time
    value, root = seen.values[i], seen.roots[i]
    if seen.cameras[i] == MEASURED_POSITION:
        off = value - place
        distance = np.sqrt(off[0] ** 2 + off[1] ** 2 + off[2] ** 2)
        beyond = max(0.0, 1.0 - slack / distance) if distance > 0.0 else 0.0
        total = 0.0
        for r in range(3):
            part = beyond * (root[r, 0] * off[0] + root[r, 1] * off[1] + root[r, 2] * off[2])
            total += part * part
        return total < (AGREEMENT_SIGMAS * wide) ** 2
    camera = unpack_camera(cameras[seen.cameras[i]])
    u, v, depth = project_from_table(camera, place[0], place[1], place[2])
    if not depth > 0.0:
        return False
    distance = np.sqrt((value[0] - u) ** 2 + (value[1] - v) ** 2)
    return distance < AGREEMENT_SIGMAS * wide / root[0, 0] + slack * camera.optics.focal / depth


@njit(cache=True)
def _solve(chosen: Array, middle: float, seen: Measurements, cameras: Array, parabola: Array) -> bool:
    """Fit a parabola to the measurements i with chosen[i] > 0 by least squares.

    Args:
        chosen: (n,) which measurements are fitted.
        middle: s, time of the parabola's position and velocity.
        seen: All measurements.
        cameras: (c, 20) `Camera.vector` of each camera.
        parabola: (6,) filled with position (m) and velocity (m/s).

    Returns:
        Whether the result is plausible: no coordinate exceeds LARGEST_PLAUSIBLE.
    """
    normal, right = np.zeros((6, 6)), np.zeros(6)
    for i in range(len(seen.times)):
        if chosen[i] > 0.0:
            _sum(i, middle, seen, cameras, normal, right)
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    normal = normal / scale / scale.reshape(-1, 1)
    for k in range(6):
        normal[k, k] += RIDGE
    parabola[:] = np.linalg.solve(normal, right / scale) / scale
    return bool(np.abs(parabola).max() < LARGEST_PLAUSIBLE)


@njit(cache=True)
def _count(middle: float, parabola: Array, wide: float, seen: Measurements, cameras: Array, agree: Array) -> int:
    """Find the measurements that agree with a parabola; see `_agrees` for the arguments.

    Returns:
        The number of coordinates of these measurements. `agree` (n,) is filled with 1 for each of them, with 0 for the others.
    """
    total = 0
    for i in range(len(seen.times)):
        agree[i] = 1.0 if _agrees(i, middle, parabola, wide, seen, cameras) else 0.0
        if agree[i] > 0.0:
            total += 3 if seen.cameras[i] == MEASURED_POSITION else 2
    return total


@njit(cache=True)
def find_parabola(seen: Measurements, cameras: Array, parabola: Array) -> bool:
    """Find the parabola under gravity that agrees with most of a few measurements; all triples of them are tried.

    Args:
        seen: At most about MOST measurements. If a parabola is found, `used` is set for each of them: whether it agrees.
        cameras: (c, 20) `Camera.vector` of each camera.
        parabola: (6,) filled with position (m) and velocity (m/s) in `table` at the time of the first measurement that agrees.

    Returns:
        Whether a parabola with which enough measurements agree was found.
    """
    n = len(seen.times)
    coordinates = 0
    for i in range(n):
        coordinates += 3 if seen.cameras[i] == MEASURED_POSITION else 2
    if coordinates < EQUATIONS:
        return False
    middle = 0.5 * (seen.times[0] + seen.times[n - 1])
    wanted = max(float(EQUATIONS), SHARE * coordinates)
    trial, chosen, agree, best_agree, wide = np.empty(6), np.zeros(n), np.zeros(n), np.zeros(n), 1.0
    for _ in range(WIDENINGS):
        best = 0
        for a in range(n):
            for b in range(a + 1, n):
                for c in range(b + 1, n):
                    chosen[:] = 0.0
                    chosen[a], chosen[b], chosen[c] = 1.0, 1.0, 1.0
                    if not _solve(chosen, middle, seen, cameras, trial):
                        continue
                    count = _count(middle, trial, wide, seen, cameras, agree)
                    if count > best:
                        best = count
                        best_agree[:] = agree
        if best < EQUATIONS:
            wide *= 2.0
            continue
        for _ in range(3):
            if not _solve(best_agree, middle, seen, cameras, trial):
                return False
            best = _count(middle, trial, wide, seen, cameras, best_agree)
        if best >= wanted:
            break
        wide *= 2.0
    else:
        return False
    if not _solve(best_agree, middle, seen, cameras, trial):
        return False
    first = -1
    for i in range(n):
        seen.used[i] = best_agree[i] > 0.0
        if seen.used[i] and first < 0:
            first = i
    time = seen.times[first] - middle
    for k in range(3):
        parabola[k] = trial[k] + time * trial[3 + k]
        parabola[3 + k] = trial[3 + k]
    parabola[Z] -= 0.5 * GRAVITY * time * time
    parabola[VZ] -= GRAVITY * time
    return True
