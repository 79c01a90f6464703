"""The spin that lays the marks of all images over each other, found without an initial guess.

Method 2 of the dissertation (Section 2.4) compares each image with the one before it and walks downhill from 1000 rpm. Here every
rotation that can occur between two frames is tried on coarse maps of the sphere first; the best few are refined on neighbouring frames,
and the last one on all images of both cameras at once, with the unknown marks eliminated.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.params import check, param
from tt_core.so3 import left_jacobian, rotation_matrix
from tt_core.states import Array

from ..camera import distort
from ..detection.illumination import LIMB
from .sphere_grid import cube, fibonacci, nearest
from .surface_map import Surface

CELLS = 900  # of the coarse maps, 0.12 rad apart
EDGE = 48  # texels along the edge of the cube that finds them
WIDEST = 1.15  # rad between two frames that the search covers: 9,900 rpm at 900 frames a second
STEP, DENSE_STEP = 0.135, 0.09  # rad between candidates: 2,600 and 8,700 of them; a mark is 0.4 rad wide
APART = 0.2  # rad between kept candidates
STEPS = 12  # of a refinement at most; few marks seen aslant take 8
NEAR, SETTLED = 6.0, 1.0  # rad/s, last step of the blurred and of the sharp refinement
LEAST_OVERLAP = 0.1  # of what one frame shows that the next one shows too
GATE = 0.05  # residual above which a registration is not believed: right ones reach 0.03, wrong ones start at 0.09


@dataclass(frozen=True)
class SearchParams:
    """How much is spent on the spin."""

    pairs: int = param(9, "", "of neighbouring frames, at most, on which the coarse search is scored", low=1, high=100)
    kept: int = param(5, "", "candidates that are refined; the right one was first in each of 160 bursts at 9,000 rpm", low=1, high=100)
    coarse_points: int = param(500, "", "on the sphere, in the refinement of the candidates", low=100, high=100000)
    fine_points: int = param(2500, "", "on the sphere, in the last refinement", low=100, high=20000)
    second_look: bool = param(True, "", "at light and outline, once the marks are known: `look`")

    @classmethod
    def fast(cls) -> SearchParams:
        """Three fifths of the time."""
        return cls(pairs=3, kept=3, coarse_points=400, fine_points=800, second_look=False)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


DEFAULT = SearchParams()


@dataclass(frozen=True, eq=False)
class Registration:
    """spin: (3,) rad/s. information: (3, 3) of the last least squares. candidates: how many rotations were tried.

    residual: 0 for marks that agree, 1 for unrelated ones, the larger of neighbouring frames and of all images: cameras that see different
    balls agree each with itself. marks: (n, 2) brightness at `fibonacci(n)` on the ball as it is turned in the middle of the burst, white
    is 1, and the weight that it rests on.
    """

    spin: Array
    information: Array
    residual: float
    candidates: int
    marks: Array


def register(surface: Surface, search: SearchParams = DEFAULT) -> Registration:
    """The spin of the ball; residual above GATE means that none was found."""
    gap, pairs = float(np.diff(surface.times).min()), neighbours(surface.times)
    values, weights = _maps(surface.marks, surface.views, surface.frame, fibonacci(CELLS), cube(CELLS, EDGE), len(surface.times))
    found = []
    for step, params in ((STEP, search), (DENSE_STEP, DEFAULT)):
        rotations, table = _candidates(step)
        scored = pairs[np.linspace(0, len(pairs) - 1, min(params.pairs, len(pairs))).round().astype(np.int64)]
        scores = _search(values, weights, scored, table, surface.contrast)
        found.append(_refine(surface, pairs, gap, rotations, scores, params))
        if found[-1].residual < GATE:
            break
    return min(found, key=lambda each: each.residual)


def prepare() -> None:
    """Makes the tables of the search: 0.3 s that no ball should wait for. And teaches glibc, which raises its thresholds by what is freed,
    to keep the memory of one burst for the next: new pages cost up to 2 ms a burst."""
    np.empty(31 << 20, dtype=np.uint8)
    for step in (STEP, DENSE_STEP):
        _candidates(step)


def _refine(surface: Surface, pairs: np.ndarray, gap: float, rotations: Array, scores: Array, params: SearchParams) -> Registration:
    chosen: list[Array] = []
    for i in np.argsort(scores)[:200]:
        if all(np.linalg.norm(rotations[i] - other) > APART for other in chosen):
            chosen.append(rotations[i])
        if len(chosen) == params.kept:
            break
    points, fine = fibonacci(params.coarse_points), fibonacci(params.fine_points)
    s = surface
    before = firsts(points, pairs, s.soft, s.soft_views, len(s.times))
    trials = []
    for rotation in chosen:
        spin = rotation / gap
        for _ in range(4):
            cost, _, h, g = compare_pairs(spin, points, before, pairs, s.soft, s.soft_views, s.times, s.soft_contrast)
            spin = spin - _step(h, g, 0.1 / gap)
        trials.append((cost, spin))
    spin = min(trials, key=lambda trial: trial[0])[1]
    spin, *_ = _settle(s, spin, points, s.soft, s.soft_views, NEAR)
    spin, h, error, drawn = _settle(s, spin, fine, s.marks, s.views, NEAR if params.second_look else SETTLED)
    return Registration(spin, _information(h, error, params), _residual(s, spin, pairs, points, error), len(rotations), drawn)


def _residual(s: Surface, spin: Array, pairs: np.ndarray, points: Array, error: float) -> float:
    """Of a registration; error: mean square of `compare_all`."""
    before = firsts(points, pairs, s.marks, s.views, len(s.times))
    cost, weight, _, _ = compare_pairs(spin, points, before, pairs, s.marks, s.views, s.times, 0.0)
    seen = weight > LEAST_OVERLAP * float((before[..., 1] ** 2).sum())
    return max(cost / (2.0 * weight), error) / s.contrast if seen else 1.0


def again(surface: Surface, found: Registration, search: SearchParams = DEFAULT, enough: float = SETTLED) -> Registration:
    """`found` on a surface that is known better now, until a step is shorter than `enough` rad/s; its residual is left as it is."""
    spin, h, error, drawn = _settle(surface, found.spin, fibonacci(search.fine_points), surface.marks, surface.views, enough)
    return replace(found, spin=spin, information=_information(h, error, search), marks=drawn)


def judged(surface: Surface, found: Registration, search: SearchParams = DEFAULT) -> Registration:
    """`found` with the residual that it has on a surface that is known better now."""
    points, pairs = fibonacci(search.coarse_points), neighbours(surface.times)
    _, _, error, _ = compare_all(found.spin, points, surface.marks, surface.views, surface.frame, surface.times)
    return replace(found, residual=_residual(surface, found.spin, pairs, points, error))


def neighbours(times: Array) -> np.ndarray:
    """The first frames of the pairs that follow each other; a lost frame leaves a longer gap."""
    gaps = np.diff(times)
    return np.flatnonzero(gaps < 1.5 * gaps.min())


def _settle(s: Surface, spin: Array, points: Array, marks: np.ndarray, views: Array, enough: float) -> tuple[Array, Array, float, Array]:
    """Gauss-Newton on all images from `spin` until a step is shorter than `enough` rad/s: the spin, and of
    `compare_all` the normal matrix, the mean square and the marks."""
    most = 0.05 / float(np.diff(s.times).min())
    for _ in range(STEPS):
        h, g, error, drawn = compare_all(spin, points, marks, views, s.frame, s.times)
        change = _step(h, g, most)
        spin = spin - change
        if np.linalg.norm(change) < enough:
            break
    return spin, h, error, drawn


def _information(h: Array, error: float, search: SearchParams) -> Array:
    return DEFAULT.fine_points / search.fine_points * h / max(error, 1e-12)


def _step(h: Array, g: Array, most: float) -> Array:
    """The Gauss-Newton step, at most `most` long."""
    step = np.linalg.solve(h + (1e-9 * np.trace(h) + 1e-30) * np.eye(3), g)
    return step * min(1.0, most / max(float(np.linalg.norm(step)), 1e-12))


@functools.cache
def _candidates(step: float) -> tuple[Array, np.ndarray]:
    """((n, 3) rotation vectors on a body-centred lattice, (CELLS, n) the cell that each cell turns into)."""
    edge = step * 2.0 ** (1 / 3)
    count = math.ceil(WIDEST / edge)
    i = np.arange(-count, count + 1) * edge
    grid = np.stack(np.meshgrid(i, i, i, indexing="ij"), axis=-1).reshape(-1, 3)
    lattice = np.concatenate([grid, grid + edge / 2])
    rotations = np.ascontiguousarray(lattice[np.linalg.norm(lattice, axis=1) <= WIDEST])
    return rotations, _make_table(rotations, fibonacci(CELLS), cube(CELLS, EDGE))


@njit(cache=True, nogil=True)
def _make_table(rotations: Array, cells: Array, cube: np.ndarray) -> np.ndarray:
    table = np.empty((len(cells), len(rotations)), dtype=np.int16)
    for r in range(len(rotations)):
        m = rotation_matrix(rotations[r])
        for i in range(len(cells)):
            x, y, z = cells[i]
            table[i, r] = nearest(
                cube,
                m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
                m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
                m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
            )
    return table


@njit(cache=True, nogil=True, error_model="numpy")
def _maps(
    marks: np.ndarray, views: Array, frame_of: np.ndarray, cells: Array, cube: np.ndarray, frames: int
) -> tuple[np.ndarray, np.ndarray]:
    """(CELLS, frames) float32 mean of the marks in each cell, both cameras together, and its weight, at most 1. Every second pixel."""
    total, mass = np.zeros((len(cells), frames)), np.zeros((len(cells), frames))
    size = marks.shape[1]
    for m in range(len(marks)):
        sx, sy = views[m, 9] / views[m, 11], views[m, 10] / views[m, 11]
        scale = BALL_RADIUS * views[m, 12] / views[m, 11]
        u0, v0 = views[m, 12] * sx + views[m, 13], views[m, 12] * sy + views[m, 14]
        for j in range(m % 2, size, 2):
            for i in range(m % 2, size, 2):
                w = marks[m, j, i, 1]
                if w <= 0.0:
                    continue
                # the ball as a disc, turned by the small angle between its line of sight and the optical axis
                a, b = (i - u0) / scale, (j - v0) / scale
                c = -math.sqrt(max(0.0, 1.0 - a * a - b * b))
                a, b, c = a + sx * c, b + sy * c, c - sx * a - sy * b
                cell = nearest(
                    cube,
                    views[m, 0] * a + views[m, 3] * b + views[m, 6] * c,
                    views[m, 1] * a + views[m, 4] * b + views[m, 7] * c,
                    views[m, 2] * a + views[m, 5] * b + views[m, 8] * c,
                )
                total[cell, frame_of[m]] += w * marks[m, j, i, 0]
                mass[cell, frame_of[m]] += w
    values, weight = np.zeros(total.shape, dtype=np.float32), np.zeros(total.shape, dtype=np.float32)
    for c in range(len(cells)):
        for k in range(frames):
            if mass[c, k] > 0.5:
                values[c, k] = total[c, k] / mass[c, k]
                weight[c, k] = min(1.0, mass[c, k] / 2.0)
    return values, weight


@njit(cache=True, nogil=True, fastmath=True)
def _search(values: np.ndarray, weights: np.ndarray, pairs: np.ndarray, table: np.ndarray, contrast: float) -> np.ndarray:
    """(candidates,) sum of weight (difference^2 - 2 contrast) over cells and pairs of frames: unrelated marks score 0, equal ones less.

    The square is multiplied out, so all cells of the later frames are compared with one of the earlier ones at once, whatever the turn.
    """
    cells, n = len(values), len(pairs)
    after = np.empty((n, 3, cells), dtype=np.float32)
    for k in range(n):
        for j in range(cells):
            value, weight = values[j, pairs[k] + 1], weights[j, pairs[k] + 1]
            after[k, 0, j] = weight
            after[k, 1, j] = weight * value
            after[k, 2, j] = weight * (value * value - 2.0 * contrast)
    scores, row = np.zeros(table.shape[1], dtype=np.float32), np.empty(cells, dtype=np.float32)
    for i in range(cells):
        row[:] = 0.0
        seen = False
        for k in range(n):
            weight, value = weights[i, pairs[k]], values[i, pairs[k]]
            if weight > 0.0:
                seen = True
                first, second = weight * value * value, np.float32(-2.0) * weight * value
                for j in range(cells):
                    row[j] += first * after[k, 0, j] + second * after[k, 1, j] + weight * after[k, 2, j]
        if seen:
            for c in range(len(scores)):
                scores[c] += row[table[i, c]]
    return scores


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _sample(marks: np.ndarray, view: Array, m: int, nx: float, ny: float, nz: float) -> tuple[float, float, float, float, float]:
    """Weight, value and gradient with respect to the normal (nx, ny, nz), all in the camera's frame; weight 0 where image m does not
    show it."""
    cx, cy, cz = view[9], view[10], view[11]
    towards = -(nx * cx + ny * cy + nz * cz)
    if towards < 0.0 or towards * towards < LIMB * LIMB * (cx * cx + cy * cy + cz * cz):
        return 0.0, 0.0, 0.0, 0.0, 0.0
    px, py, pz = cx + BALL_RADIUS * nx, cy + BALL_RADIUS * ny, cz + BALL_RADIUS * nz
    near = 1.0 / pz
    u, v = distort(px * near, py * near, view[15], view[16], view[17], view[18], view[19])
    u, v = view[12] * u + view[13], view[12] * v + view[14]
    i, j = int(u), int(v)
    if i < 0 or j < 0 or i >= marks.shape[2] - 1 or j >= marks.shape[1] - 1:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    a, b = np.float32(u - i), np.float32(v - j)
    one = np.float32(1.0)
    q00, q10, q01, q11 = (one - a) * (one - b), a * (one - b), (one - a) * b, a * b
    p00, p10, p01, p11 = marks[m, j, i], marks[m, j, i + 1], marks[m, j + 1, i], marks[m, j + 1, i + 1]
    weight = q00 * p00[1] + q10 * p10[1] + q01 * p01[1] + q11 * p11[1]
    if weight <= np.float32(0.02):
        return 0.0, 0.0, 0.0, 0.0, 0.0
    value = q00 * p00[0] + q10 * p10[0] + q01 * p01[0] + q11 * p11[0]
    scale = view[12] * BALL_RADIUS * near
    gu = scale * (q00 * p00[2] + q10 * p10[2] + q01 * p01[2] + q11 * p11[2])
    gv = scale * (q00 * p00[3] + q10 * p10[3] + q01 * p01[3] + q11 * p11[3])
    return weight, value, gu, gv, -(gu * px + gv * py) * near


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _best(
    frame: int, frames: int, x: float, y: float, z: float, marks: np.ndarray, views: Array
) -> tuple[float, float, float, float, float]:
    """`_sample` of the camera that sees the point (x, y, z), in `table`, best in `frame`; the gradient is in `table`, too."""
    best, cosine = -1, LIMB
    for m in range(frame, len(views), frames):
        facing = views[m, 20] * x + views[m, 21] * y + views[m, 22] * z
        if facing > cosine:
            best, cosine = m, facing
    if best < 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    v = views[best]
    nx, ny, nz = v[0] * x + v[1] * y + v[2] * z, v[3] * x + v[4] * y + v[5] * z, v[6] * x + v[7] * y + v[8] * z
    weight, value, gx, gy, gz = _sample(marks, v, best, nx, ny, nz)
    return weight, value, v[0] * gx + v[3] * gy + v[6] * gz, v[1] * gx + v[4] * gy + v[7] * gz, v[2] * gx + v[5] * gy + v[8] * gz


@njit(cache=True, nogil=True, error_model="numpy")
def firsts(points: Array, pairs: np.ndarray, marks: np.ndarray, views: Array, frames: int) -> Array:
    """(pairs, points, 2) value and weight of each point in the first frame of each pair; weight 0 where it is not seen."""
    out = np.zeros((len(pairs), len(points), 2))
    for p in range(len(pairs)):
        for q in range(len(points)):
            out[p, q, 1], out[p, q, 0], _, _, _ = _best(pairs[p], frames, points[q, 0], points[q, 1], points[q, 2], marks, views)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def compare_pairs(
    spin: Array, points: Array, before: Array, pairs: np.ndarray, marks: np.ndarray, views: Array, times: Array, contrast: float
) -> tuple[float, float, Array, Array]:
    """Neighbouring frames compared: cost sum w (d^2 - 2 contrast), sum w, and the normal equations of d with respect to the spin.

    points: (n, 3) unit vectors in `table` at the first frame of a pair. before: `firsts` of them.
    """
    cost, total, h, g, row = 0.0, 0.0, np.zeros((3, 3)), np.zeros(3), np.empty(3)
    for p in range(len(pairs)):
        k = pairs[p]
        dt = times[k + 1] - times[k]
        turn, left = rotation_matrix(spin * dt), dt * left_jacobian(spin * dt)
        for q in range(len(points)):
            if before[p, q, 1] <= 0.0:
                continue
            x, y, z = points[q, 0], points[q, 1], points[q, 2]
            x, y, z = (
                turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z,
                turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z,
                turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z,
            )
            weight, value, gx, gy, gz = _best(k + 1, len(times), x, y, z, marks, views)
            if weight <= 0.0:
                continue
            d = value - before[p, q, 0]
            w = weight * before[p, q, 1]
            c0, c1, c2 = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
            for a in range(3):
                row[a] = left[0, a] * c0 + left[1, a] * c1 + left[2, a] * c2
            cost += w * (d * d - 2.0 * contrast)
            total += w
            for a in range(3):
                g[a] += w * row[a] * d
                for b in range(3):
                    h[a, b] += w * row[a] * row[b]
    return cost, total, h, g


@njit(cache=True, nogil=True)
def turned(spin: Array, views: Array, frame_of: np.ndarray, times: Array) -> Array:
    """(images, 3, 3): from the ball as it is turned at time 0 to the camera's frame at each image."""
    out = np.empty((len(views), 3, 3))
    for m in range(len(views)):
        out[m] = views[m, :9].copy().reshape(3, 3) @ rotation_matrix(spin * times[frame_of[m]])
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def compare_all(
    spin: Array, points: Array, marks: np.ndarray, views: Array, frame_of: np.ndarray, times: Array
) -> tuple[Array, Array, float, Array]:
    """All images compared with the marks that fit them best, point by point on the ball: normal equations with respect to the spin, the
    marks eliminated (variable projection), the mean squared error, and (n, 2) those marks and the weight that each rests on.

    points: (n, 3) unit vectors on the ball as it is turned at time 0.
    """
    count = len(views)
    turns, arms = turned(spin, views, frame_of, times), np.empty((count, 3, 3))
    for m in range(count):
        t = times[frame_of[m]]
        arms[m] = t * (views[m, :9].copy().reshape(3, 3) @ left_jacobian(spin * t)).T
    drawn = np.zeros((len(points), 2))
    h00 = h01 = h02 = h11 = h12 = h22 = g0 = g1 = g2 = error = total = 0.0
    for i in range(len(points)):
        p, q, s = points[i, 0], points[i, 1], points[i, 2]
        seen, sw, sv, s0, s1, s2 = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        a00 = a01 = a02 = a11 = a12 = a22 = b0 = b1 = b2 = svv = 0.0
        for m in range(count):
            turn, arm = turns[m], arms[m]
            x = turn[0, 0] * p + turn[0, 1] * q + turn[0, 2] * s
            y = turn[1, 0] * p + turn[1, 1] * q + turn[1, 2] * s
            z = turn[2, 0] * p + turn[2, 1] * q + turn[2, 2] * s
            w, value, gx, gy, gz = _sample(marks, views[m], m, x, y, z)
            if w <= 0.0:
                continue
            c0, c1, c2 = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
            j0 = arm[0, 0] * c0 + arm[0, 1] * c1 + arm[0, 2] * c2
            j1 = arm[1, 0] * c0 + arm[1, 1] * c1 + arm[1, 2] * c2
            j2 = arm[2, 0] * c0 + arm[2, 1] * c1 + arm[2, 2] * c2
            seen += 1
            e = value - 1.0
            sw, sv, svv = sw + w, sv + w * e, svv + w * e * e
            w0, w1, w2 = w * j0, w * j1, w * j2
            s0, s1, s2 = s0 + w0, s1 + w1, s2 + w2
            b0, b1, b2 = b0 + w0 * e, b1 + w1 * e, b2 + w2 * e
            a00, a01, a02, a11, a12, a22 = a00 + w0 * j0, a01 + w0 * j1, a02 + w0 * j2, a11 + w1 * j1, a12 + w1 * j2, a22 + w2 * j2
        if seen == 0:
            continue
        mean = sv / sw
        drawn[i, 0], drawn[i, 1] = 1.0 + mean, sw
        if seen < 2:
            continue
        g0, g1, g2 = g0 + b0 - s0 * mean, g1 + b1 - s1 * mean, g2 + b2 - s2 * mean
        h00, h01, h02 = h00 + a00 - s0 * s0 / sw, h01 + a01 - s0 * s1 / sw, h02 + a02 - s0 * s2 / sw
        h11, h12, h22 = h11 + a11 - s1 * s1 / sw, h12 + a12 - s1 * s2 / sw, h22 + a22 - s2 * s2 / sw
        error += svv - sv * mean
        total += sw
    h = np.array([[h00, h01, h02], [h01, h11, h12], [h02, h12, h22]])
    return h, np.array([g0, g1, g2]), error / max(total, 1e-12), drawn
