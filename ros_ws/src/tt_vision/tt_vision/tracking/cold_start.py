"""Find a ball that nothing announced, from a few positions or pixels, some of which may be wrong.

Over a short time a flight is nearly a parabola under gravity, and positions as well as rays through pixels are linear in its place and
velocity. Parabolas through three measurements each are tried, and the one that most others agree with is kept (consensus, Fischler and
Bolles 1981), all triples in turn, so that equal input gives equal output.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from tt_core.arrays import Array
from tt_core.constants import GRAVITY

from ..projection import project_from_table, ray, unpack_camera
from .history import POSITION, Measurements, select

MOST = 12  # measurements that are looked at: 220 triples
SPAN = 0.15  # s, from the first to the last of these
FAST_SPAN = 0.05  # s: MOST measurements are spread over this time, if more arrive within it
EQUATIONS = 12  # least number of coordinates that must agree; six determine a parabola
SHARE = 0.6  # of the coordinates that must agree
UNKNOWN_ACCELERATION = 12.0  # m/s^2, of drag and lift, which the parabola does not know
SIGMAS = 4.0  # standard deviations at which a measurement agrees
WIDENINGS = 4  # doublings of the standard deviations, if they were told too small
RIDGE = 1e-9  # of the normal equations
WIDEST = 100.0  # m, of a place, and m/s of a velocity, that makes sense


def count_within(times: Array) -> int:
    """Return how many of the measurements at `times` (n,), from the first on, are looked at together."""
    if len(times) == 0:
        return 0
    within, fast = np.searchsorted(times, [times[0] + SPAN, times[0] + FAST_SPAN], side="right")
    return int(min(within, max(MOST, fast)))


def find(seen: Measurements, cameras: Array) -> Array | None:
    """Find place and velocity of a ball.

    Args:
        seen: Measurements; `used` is set for those that agree, of at most MOST that are looked at.
        cameras: (c, 20) `Camera.vector`.

    Returns:
        (6,) place (m) and velocity (m/s) at the first measurement that agrees, or None if too few agree.
    """
    chosen = np.unique(np.linspace(0, len(seen.times) - 1, min(MOST, len(seen.times))).astype(np.int64))
    few, parabola = select(seen, chosen), np.empty(6)
    found = len(chosen) > 0 and find_parabola(few, cameras, parabola)
    seen.used[:] = False
    seen.used[chosen] = few.used & found
    return parabola if found else None


@njit(cache=True)
def _add(normal: Array, right: Array, a: Array, time: float, b: float) -> None:
    """Add the equation a (p + v t) = b for place p and velocity v, each (3,)."""
    row = np.empty(6)
    row[:3] = a
    row[3:] = a * time
    for r in range(6):
        right[r] += row[r] * b
        for c in range(6):
            normal[r, c] += row[r] * row[c]


@njit(cache=True)
def _sum(i: int, middle: float, seen: Measurements, cameras: Array, normal: Array, right: Array) -> None:
    """Add the equations of measurement i for place and velocity at the time `middle`, in standard deviations."""
    time, a = seen.times[i] - middle, np.empty(3)
    fall = 0.5 * GRAVITY * time * time
    if seen.cameras[i] == POSITION:
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
    """Tell whether measurement i lies near a parabola (6,); wide: factor on its standard deviations."""
    time, place = seen.times[i] - middle, np.empty(3)
    for k in range(3):
        place[k] = parabola[k] + time * parabola[3 + k]
    place[2] -= 0.5 * GRAVITY * time * time
    slack = 0.5 * UNKNOWN_ACCELERATION * time * time
    value, root = seen.values[i], seen.roots[i]
    if seen.cameras[i] == POSITION:
        off = value - place
        distance = np.sqrt(off[0] ** 2 + off[1] ** 2 + off[2] ** 2)
        beyond = max(0.0, 1.0 - slack / distance) if distance > 0.0 else 0.0
        total = 0.0
        for r in range(3):
            part = beyond * (root[r, 0] * off[0] + root[r, 1] * off[1] + root[r, 2] * off[2])
            total += part * part
        return total < (SIGMAS * wide) ** 2
    camera = unpack_camera(cameras[seen.cameras[i]])
    u, v, depth = project_from_table(camera, place[0], place[1], place[2])
    if not depth > 0.0:
        return False
    distance = np.sqrt((value[0] - u) ** 2 + (value[1] - v) ** 2)
    return distance < SIGMAS * wide / root[0, 0] + slack * camera.optics.focal / depth


@njit(cache=True)
def _solve(chosen: Array, middle: float, seen: Measurements, cameras: Array, parabola: Array) -> bool:
    """Fill the parabola (6,) that fits the measurements i with chosen[i] > 0; False if they do not determine one that makes sense."""
    normal, right = np.zeros((6, 6)), np.zeros(6)
    for i in range(len(seen.times)):
        if chosen[i] > 0.0:
            _sum(i, middle, seen, cameras, normal, right)
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    normal = normal / scale / scale.reshape(-1, 1)
    for k in range(6):
        normal[k, k] += RIDGE
    parabola[:] = np.linalg.solve(normal, right / scale) / scale
    return bool(np.abs(parabola).max() < WIDEST)


@njit(cache=True)
def _count(middle: float, parabola: Array, wide: float, seen: Measurements, cameras: Array, agree: Array) -> int:
    """Fill agree (n,) with 1 for each measurement that lies near the parabola, else 0; return the number of their coordinates."""
    total = 0
    for i in range(len(seen.times)):
        agree[i] = 1.0 if _agrees(i, middle, parabola, wide, seen, cameras) else 0.0
        if agree[i] > 0.0:
            total += 3 if seen.cameras[i] == POSITION else 2
    return total


@njit(cache=True)
def find_parabola(seen: Measurements, cameras: Array, parabola: Array) -> bool:
    """Find place and velocity of a ball.

    Args:
        seen: A few measurements; `used` is set for those that agree.
        cameras: (c, 20) `Camera.vector`.
        parabola: (6,) filled with place (m) and velocity (m/s) at the first measurement that agrees.

    Returns:
        Whether enough measurements agree.
    """
    n = len(seen.times)
    coordinates = 0
    for i in range(n):
        coordinates += 3 if seen.cameras[i] == POSITION else 2
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
    parabola[2] -= 0.5 * GRAVITY * time * time
    parabola[5] -= GRAVITY * time
    return True
