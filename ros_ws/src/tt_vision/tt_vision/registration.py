"""The spin that lays the marks of all images over each other, found without an initial guess.

Method 2 of the dissertation (Section 2.4) compares each image with the one before it and walks downhill from 1000 rpm. Here every
rotation that can occur between two frames is tried on coarse maps of the sphere first; the best few are refined on neighbouring frames,
and the last one on all images of both cameras at once, with the unknown marks eliminated.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.errors import check_range
from tt_core.states import Array

from .camera import distort
from .light import LIMB
from .surface import Surface

CELLS = 900  # of the coarse maps, 0.12 rad apart
WIDEST = 1.15  # rad between two frames that the search covers: 9,900 rpm at 900 frames a second
STEP, DENSE_STEP = 0.135, 0.09  # rad between candidates: 2,600 and 8,700 of them; a mark is 0.4 rad wide
APART = 0.2  # rad between kept candidates
STEPS = 12  # of a refinement at most; few marks seen aslant take 8
NEAR, SETTLED = 6.0, 0.3  # rad/s, last step of the blurred and of the sharp refinement
LEAST_OVERLAP = 0.1  # of what one frame shows that the next one shows too
GATE = 0.05  # residual above which a registration is not believed: right ones reach 0.03, wrong ones start at 0.09


@dataclass(frozen=True)
class SearchParams:
    """How much is spent on the spin."""

    pairs: int = 9  # of neighbouring frames, at most, on which the coarse search is scored
    kept: int = 5  # candidates that are refined; the right one was first in each of 160 bursts at 9,000 rpm
    coarse_points: int = 500  # on the sphere, in the refinement of the candidates
    fine_points: int = 2500  # on the sphere, in the last refinement

    @classmethod
    def fast(cls) -> SearchParams:
        """Two thirds of the time."""
        return cls(pairs=3, kept=3, coarse_points=400, fine_points=800)

    def __post_init__(self) -> None:
        check_range("pairs", self.pairs, 1, 100)
        check_range("kept", self.kept, 1, 100)
        check_range("coarse_points", self.coarse_points, 100, 100000)
        check_range("fine_points", self.fine_points, 100, 100000)


DEFAULT = SearchParams()


@dataclass(frozen=True, eq=False)
class Registration:
    """spin: (3,) rad/s. information: (3, 3) of the last least squares. candidates: how many rotations were tried.

    residual: 0 for marks that agree, 1 for unrelated ones, the larger of neighbouring frames and of all images: cameras that see different
    balls agree each with itself.
    """

    spin: Array
    information: Array
    residual: float
    candidates: int


def register(surface: Surface, search: SearchParams = DEFAULT) -> Registration:
    """The spin of the ball; residual above GATE means that none was found."""
    gaps = np.diff(surface.times)
    gap = float(gaps.min())
    pairs = np.flatnonzero(gaps < 1.5 * gap)  # a lost frame leaves a longer gap
    values, weights = _maps(surface.marks, surface.weights, surface.views, surface.frame, _cells(), _cube(), len(surface.times))
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
    """Makes the tables of the search: 0.3 s that no ball should wait for."""
    for step in (STEP, DENSE_STEP):
        _candidates(step)


def _refine(surface: Surface, pairs: np.ndarray, gap: float, rotations: Array, scores: Array, params: SearchParams) -> Registration:
    chosen: list[Array] = []
    for i in np.argsort(scores)[:200]:
        if all(np.linalg.norm(rotations[i] - other) > APART for other in chosen):
            chosen.append(rotations[i])
        if len(chosen) == params.kept:
            break
    points, fine = _fibonacci(params.coarse_points), _fibonacci(params.fine_points)
    s = surface
    where = (s.weights, s.views, s.frame)
    before = firsts(points, pairs, s.soft, *where)
    trials = []
    for rotation in chosen:
        spin = rotation / gap
        for _ in range(4):
            cost, _, h, g = compare_pairs(spin, points, before, pairs, s.soft, *where, s.times, s.soft_contrast)
            spin = spin - _step(h, g, 0.1 / gap)
        trials.append((cost, spin))
    spin = min(trials, key=lambda trial: trial[0])[1]
    for at, marks, enough in ((points, s.soft, NEAR), (fine, s.marks, SETTLED)):
        for _ in range(STEPS):
            h, g, error, _ = compare_all(spin, at, marks, *where, s.times)
            change = _step(h, g, 0.05 / gap)
            spin = spin - change
            if np.linalg.norm(change) < enough:
                break
    before = firsts(points, pairs, s.marks, *where)
    cost, weight, _, _ = compare_pairs(spin, points, before, pairs, s.marks, *where, s.times, 0.0)
    seen = weight > LEAST_OVERLAP * float((before[..., 1] ** 2).sum())
    residual = max(cost / (2.0 * weight), error) / s.contrast if seen else 1.0
    return Registration(spin, DEFAULT.fine_points / params.fine_points * h / max(error, 1e-12), residual, len(rotations))


def _step(h: Array, g: Array, most: float) -> Array:
    """The Gauss-Newton step, at most `most` long."""
    step = np.linalg.solve(h + (1e-9 * np.trace(h) + 1e-30) * np.eye(3), g)
    return step * min(1.0, most / max(float(np.linalg.norm(step)), 1e-12))


@functools.cache
def _fibonacci(n: int) -> Array:
    """(n, 3) unit vectors, evenly spread."""
    i = np.arange(n) + 0.5
    z = 1.0 - 2.0 * i / n
    angle = math.pi * (3.0 - math.sqrt(5.0)) * i
    return np.stack([np.sqrt(1.0 - z * z) * np.cos(angle), np.sqrt(1.0 - z * z) * np.sin(angle), z], axis=1)


@functools.cache
def _cells() -> Array:
    return _fibonacci(CELLS)


@functools.cache
def _cube() -> np.ndarray:
    """(6, 48, 48) nearest cell for each direction on a cube."""
    return _make_cube(_cells(), 48)


@functools.cache
def _candidates(step: float) -> tuple[Array, np.ndarray]:
    """((n, 3) rotation vectors on a body-centred lattice, (n, CELLS) the cell that each cell turns into)."""
    edge = step * 2.0 ** (1 / 3)
    count = math.ceil(WIDEST / edge)
    i = np.arange(-count, count + 1) * edge
    grid = np.stack(np.meshgrid(i, i, i, indexing="ij"), axis=-1).reshape(-1, 3)
    lattice = np.concatenate([grid, grid + edge / 2])
    rotations = np.ascontiguousarray(lattice[np.linalg.norm(lattice, axis=1) <= WIDEST])
    return rotations, _make_table(rotations, _cells(), _cube())


@njit(cache=True, nogil=True)
def _lookup(cube: np.ndarray, x: float, y: float, z: float) -> int:
    n = cube.shape[1]
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face, u, v, w = 0, y, z, x
    elif ay >= az:
        face, u, v, w = 2, z, x, y
    else:
        face, u, v, w = 4, x, y, z
    if w < 0.0:
        face, w = face + 1, -w
    return cube[face, min(n - 1, int((u / w + 1.0) * 0.5 * n)), min(n - 1, int((v / w + 1.0) * 0.5 * n))]


@njit(cache=True, nogil=True)
def _make_cube(cells: Array, n: int) -> np.ndarray:
    cube = np.empty((6, n, n), dtype=np.int16)
    for face in range(6):
        sign = 1.0 if face % 2 == 0 else -1.0
        for i in range(n):
            for j in range(n):
                u, v = (2.0 * i + 1.0) / n - 1.0, (2.0 * j + 1.0) / n - 1.0
                d = np.empty(3)
                d[face // 2], d[(face // 2 + 1) % 3], d[(face // 2 + 2) % 3] = sign, u, v
                cube[face, i, j] = np.argmax(cells @ d)
    return cube


@njit(cache=True, nogil=True)
def rotation_matrix(v: Array) -> Array:
    """(3, 3), exp of the cross product matrix of v (3,) rad: (2.25) with the time step inside the exponent."""
    angle2 = float(v @ v)
    angle = math.sqrt(angle2)
    a, b = 1.0, 0.5
    if angle > 1e-9:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.eye(3) + a * k + b * (k @ k)


@njit(cache=True, nogil=True)
def left_jacobian(v: Array) -> Array:
    """(3, 3) J with exp(v + d) = exp(J d) exp(v) to first order."""
    angle2 = float(v @ v)
    angle = math.sqrt(angle2)
    if angle < 1e-4:
        a, b = 0.5, 1.0 / 6.0
    else:
        a, b = (1.0 - math.cos(angle)) / angle2, (angle - math.sin(angle)) / (angle2 * angle)
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.eye(3) + a * k + b * (k @ k)


@njit(cache=True, nogil=True)
def _make_table(rotations: Array, cells: Array, cube: np.ndarray) -> np.ndarray:
    table = np.empty((len(rotations), len(cells)), dtype=np.int16)
    for r in range(len(rotations)):
        m = rotation_matrix(rotations[r])
        for i in range(len(cells)):
            x, y, z = cells[i]
            table[r, i] = _lookup(
                cube,
                m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
                m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
                m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
            )
    return table


@njit(cache=True, nogil=True)
def _maps(
    marks: np.ndarray, weights: np.ndarray, views: Array, frame_of: np.ndarray, cells: Array, cube: np.ndarray, frames: int
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
                w = weights[m, j, i]
                if w <= 0.0:
                    continue
                # the ball as a disc, turned by the small angle between its line of sight and the optical axis
                a, b = (i - u0) / scale, (j - v0) / scale
                c = -math.sqrt(max(0.0, 1.0 - a * a - b * b))
                a, b, c = a + sx * c, b + sy * c, c - sx * a - sy * b
                cell = _lookup(
                    cube,
                    views[m, 0] * a + views[m, 3] * b + views[m, 6] * c,
                    views[m, 1] * a + views[m, 4] * b + views[m, 7] * c,
                    views[m, 2] * a + views[m, 5] * b + views[m, 8] * c,
                )
                total[cell, frame_of[m]] += w * marks[m, j, i]
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
    """(candidates,) sum of weight (difference^2 - 2 contrast) over cells and pairs of frames: unrelated marks score 0, equal ones less."""
    scores = np.zeros(len(table), dtype=np.float32)
    used = np.flatnonzero(weights.sum(axis=1) > 0.0)
    n = len(pairs)
    before, w_before = np.ascontiguousarray(values[:, pairs]), np.ascontiguousarray(weights[:, pairs])
    after, w_after = np.ascontiguousarray(values[:, pairs + 1]), np.ascontiguousarray(weights[:, pairs + 1])
    unrelated = np.float32(2.0 * contrast)
    for c in range(len(table)):
        score = np.float32(0.0)
        for i in used:
            to = table[c, i]
            for k in range(n):
                d = before[i, k] - after[to, k]
                score += w_before[i, k] * w_after[to, k] * (d * d - unrelated)
        scores[c] = score
    return scores


@njit(cache=True, nogil=True)
def _facing(views: Array, m: int, x: float, y: float, z: float) -> float:
    """Cosine between the normal (x, y, z) in `table` and the way to the camera of image m."""
    return views[m, 20] * x + views[m, 21] * y + views[m, 22] * z


@njit(cache=True, nogil=True)
def _sample(images: np.ndarray, weights: np.ndarray, views: Array, m: int, x: float, y: float, z: float, out: Array) -> bool:
    """out (5,): value, weight and gradient with respect to the normal (x, y, z) in `table`. False where image m does not show it."""
    if _facing(views, m, x, y, z) < LIMB:
        return False
    px = views[m, 9] + BALL_RADIUS * (views[m, 0] * x + views[m, 1] * y + views[m, 2] * z)
    py = views[m, 10] + BALL_RADIUS * (views[m, 3] * x + views[m, 4] * y + views[m, 5] * z)
    pz = views[m, 11] + BALL_RADIUS * (views[m, 6] * x + views[m, 7] * y + views[m, 8] * z)
    u, v = distort(px / pz, py / pz, views[m, 15], views[m, 16], views[m, 17], views[m, 18], views[m, 19])
    u, v = views[m, 12] * u + views[m, 13], views[m, 12] * v + views[m, 14]
    i, j = int(u), int(v)
    if i < 1 or j < 1 or i >= images.shape[2] - 2 or j >= images.shape[1] - 2:
        return False
    a, b = np.float32(u - i), np.float32(v - j)
    one = np.float32(1.0)
    q00, q10, q01, q11 = (one - a) * (one - b), a * (one - b), (one - a) * b, a * b
    w = q00 * weights[m, j, i] + q10 * weights[m, j, i + 1] + q01 * weights[m, j + 1, i] + q11 * weights[m, j + 1, i + 1]
    if w <= np.float32(0.02):
        return False
    i00, i10, i01, i11 = images[m, j, i], images[m, j, i + 1], images[m, j + 1, i], images[m, j + 1, i + 1]
    out[0] = q00 * i00 + q10 * i10 + q01 * i01 + q11 * i11
    out[1] = w
    # central differences, interpolated like the value: smooth from pixel to pixel
    gu = (
        q00 * (i10 - images[m, j, i - 1])
        + q10 * (images[m, j, i + 2] - i00)
        + q01 * (i11 - images[m, j + 1, i - 1])
        + q11 * (images[m, j + 1, i + 2] - i01)
    )
    gv = (
        q00 * (i01 - images[m, j - 1, i])
        + q10 * (i11 - images[m, j - 1, i + 1])
        + q01 * (images[m, j + 2, i] - i00)
        + q11 * (images[m, j + 2, i + 1] - i10)
    )
    scale = 0.5 * views[m, 12] * BALL_RADIUS / pz
    gx, gy = scale * gu, scale * gv
    gz = -(gx * px + gy * py) / pz
    out[2] = views[m, 0] * gx + views[m, 3] * gy + views[m, 6] * gz
    out[3] = views[m, 1] * gx + views[m, 4] * gy + views[m, 7] * gz
    out[4] = views[m, 2] * gx + views[m, 5] * gy + views[m, 8] * gz
    return True


@njit(cache=True, nogil=True)
def _best(
    frame: int, x: float, y: float, z: float, images: np.ndarray, weights: np.ndarray, views: Array, frame_of: np.ndarray, out: Array
) -> bool:
    """The sample of the camera that sees the point best in `frame`."""
    best, cosine = -1, LIMB
    for m in range(len(images)):
        if frame_of[m] == frame:
            facing = _facing(views, m, x, y, z)
            if facing > cosine:
                best, cosine = m, facing
    return best >= 0 and _sample(images, weights, views, best, x, y, z, out)


@njit(cache=True, nogil=True)
def firsts(points: Array, pairs: np.ndarray, images: np.ndarray, weights: np.ndarray, views: Array, frame_of: np.ndarray) -> Array:
    """(pairs, points, 2) value and weight of each point in the first frame of each pair; weight 0 where it is not seen."""
    out, sample = np.zeros((len(pairs), len(points), 2)), np.empty(5)
    for p in range(len(pairs)):
        for q in range(len(points)):
            if _best(pairs[p], points[q, 0], points[q, 1], points[q, 2], images, weights, views, frame_of, sample):
                out[p, q, 0], out[p, q, 1] = sample[0], sample[1]
    return out


@njit(cache=True, nogil=True)
def compare_pairs(
    spin: Array,
    points: Array,
    before: Array,
    pairs: np.ndarray,
    images: np.ndarray,
    weights: np.ndarray,
    views: Array,
    frame_of: np.ndarray,
    times: Array,
    contrast: float,
) -> tuple[float, float, Array, Array]:
    """Neighbouring frames compared: cost sum w (d^2 - 2 contrast), sum w, and the normal equations of d with respect to the spin.

    points: (n, 3) unit vectors in `table` at the first frame of a pair. before: `firsts` of them.
    """
    cost, total, h, g = 0.0, 0.0, np.zeros((3, 3)), np.zeros(3)
    sample, row = np.empty(5), np.empty(3)
    for p in range(len(pairs)):
        k = pairs[p]
        dt = times[k + 1] - times[k]
        turn, left = rotation_matrix(spin * dt), left_jacobian(spin * dt)
        for q in range(len(points)):
            if before[p, q, 1] <= 0.0:
                continue
            x, y, z = points[q, 0], points[q, 1], points[q, 2]
            x, y, z = (
                turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z,
                turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z,
                turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z,
            )
            if not _best(k + 1, x, y, z, images, weights, views, frame_of, sample):
                continue
            d = sample[0] - before[p, q, 0]
            w = sample[1] * before[p, q, 1]
            c0, c1, c2 = y * sample[4] - z * sample[3], z * sample[2] - x * sample[4], x * sample[3] - y * sample[2]
            for a in range(3):
                row[a] = dt * (left[0, a] * c0 + left[1, a] * c1 + left[2, a] * c2)
            cost += w * (d * d - 2.0 * contrast)
            total += w
            for a in range(3):
                g[a] += w * row[a] * d
                for b in range(3):
                    h[a, b] += w * row[a] * row[b]
    return cost, total, h, g


@njit(cache=True, nogil=True)
def compare_all(
    spin: Array, points: Array, images: np.ndarray, weights: np.ndarray, views: Array, frame_of: np.ndarray, times: Array
) -> tuple[Array, Array, float, float]:
    """All images compared with the marks that fit them best, point by point on the ball: normal equations with respect to the spin, the
    marks eliminated (variable projection), mean squared error and weight.

    points: (n, 3) unit vectors on the ball as it is turned at time 0.
    """
    count = len(images)
    turns, lefts = np.empty((count, 3, 3)), np.empty((count, 3, 3))
    for m in range(count):
        t = times[frame_of[m]]
        turns[m], lefts[m] = rotation_matrix(spin * t), t * left_jacobian(spin * t)
    h, g, error, total = np.zeros((3, 3)), np.zeros(3), 0.0, 0.0
    values, mass, rows, sample = np.empty(count), np.empty(count), np.empty((count, 3)), np.empty(5)
    for i in range(len(points)):
        p, q, s = points[i, 0], points[i, 1], points[i, 2]
        seen, sw, sv, s0, s1, s2 = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for m in range(count):
            x = turns[m, 0, 0] * p + turns[m, 0, 1] * q + turns[m, 0, 2] * s
            y = turns[m, 1, 0] * p + turns[m, 1, 1] * q + turns[m, 1, 2] * s
            z = turns[m, 2, 0] * p + turns[m, 2, 1] * q + turns[m, 2, 2] * s
            if not _sample(images, weights, views, m, x, y, z, sample):
                continue
            c0, c1, c2 = y * sample[4] - z * sample[3], z * sample[2] - x * sample[4], x * sample[3] - y * sample[2]
            for a in range(3):
                rows[seen, a] = lefts[m, 0, a] * c0 + lefts[m, 1, a] * c1 + lefts[m, 2, a] * c2
            values[seen], mass[seen] = sample[0], sample[1]
            sw += sample[1]
            sv += sample[1] * sample[0]
            s0 += sample[1] * rows[seen, 0]
            s1 += sample[1] * rows[seen, 1]
            s2 += sample[1] * rows[seen, 2]
            seen += 1
        if seen < 2:
            continue
        for m in range(seen):
            e, w = values[m] - sv / sw, mass[m]
            j0, j1, j2 = rows[m, 0] - s0 / sw, rows[m, 1] - s1 / sw, rows[m, 2] - s2 / sw
            g[0] += w * j0 * e
            g[1] += w * j1 * e
            g[2] += w * j2 * e
            h[0, 0] += w * j0 * j0
            h[0, 1] += w * j0 * j1
            h[0, 2] += w * j0 * j2
            h[1, 1] += w * j1 * j1
            h[1, 2] += w * j1 * j2
            h[2, 2] += w * j2 * j2
            error += w * e * e
            total += w
    h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
    return h, g, error / max(total, 1e-12), total
