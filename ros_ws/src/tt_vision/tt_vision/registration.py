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
from tt_core.errors import check_range
from tt_core.states import Array

from .camera import distort
from .light import LIMB
from .sphere import cube, fibonacci, nearest
from .surface import Surface

CELLS = 900  # of the coarse maps, 0.12 rad apart
EDGE = 48  # texels along the edge of the cube that finds them
WIDEST = 1.15  # rad between two frames that the search covers: 9,900 rpm at 900 frames a second
STEP, DENSE_STEP = 0.135, 0.09  # rad between candidates: 2,600 and 8,700 of them; a mark is 0.4 rad wide
SIFTING, SIFTED = 2, 400  # pairs of frames on which all candidates are scored, and how many are scored on more
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
    second_look: bool = True  # at light and outline, once the marks are known: `look`

    @classmethod
    def fast(cls) -> SearchParams:
        """Three fifths of the time."""
        return cls(pairs=3, kept=3, coarse_points=400, fine_points=800, second_look=False)

    def __post_init__(self) -> None:
        check_range("pairs", self.pairs, 1, 100)
        check_range("kept", self.kept, 1, 100)
        check_range("coarse_points", self.coarse_points, 100, 100000)
        check_range("fine_points", self.fine_points, 100, 20000)


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
    values, weights = _maps(
        surface.marks, surface.weights, surface.views, surface.frame, fibonacci(CELLS), cube(CELLS, EDGE), len(surface.times)
    )
    found = []
    for step, params in ((STEP, search), (DENSE_STEP, DEFAULT)):
        rotations, table = _candidates(step)
        scored = pairs[np.linspace(0, len(pairs) - 1, min(params.pairs, len(pairs))).round().astype(np.int64)]
        scores = _search(values, weights, scored[:SIFTING], table, surface.contrast, 2)
        best = np.argpartition(scores, SIFTED)[:SIFTED]
        scores[:] = np.inf
        scores[best] = _search(values, weights, scored, table[best], surface.contrast, 1)
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
    points, fine = fibonacci(params.coarse_points), fibonacci(params.fine_points)
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
    spin, *_ = _settle(s, spin, points, s.soft, NEAR)
    spin, h, error, drawn = _settle(s, spin, fine, s.marks, NEAR if params.second_look else SETTLED)
    return Registration(spin, _information(h, error, params), _residual(s, spin, pairs, points, error), len(rotations), drawn)


def _residual(s: Surface, spin: Array, pairs: np.ndarray, points: Array, error: float) -> float:
    """Of a registration; error: mean square of `compare_all`."""
    before = firsts(points, pairs, s.marks, s.weights, s.views, s.frame)
    cost, weight, _, _ = compare_pairs(spin, points, before, pairs, s.marks, s.weights, s.views, s.frame, s.times, 0.0)
    seen = weight > LEAST_OVERLAP * float((before[..., 1] ** 2).sum())
    return max(cost / (2.0 * weight), error) / s.contrast if seen else 1.0


def again(surface: Surface, found: Registration, search: SearchParams = DEFAULT, enough: float = SETTLED) -> Registration:
    """`found` on a surface that is known better now, until a step is shorter than `enough` rad/s; its residual is left as it is."""
    spin, h, error, drawn = _settle(surface, found.spin, fibonacci(search.fine_points), surface.marks, enough)
    return replace(found, spin=spin, information=_information(h, error, search), marks=drawn)


def judged(surface: Surface, found: Registration, search: SearchParams = DEFAULT) -> Registration:
    """`found` with the residual that it has on a surface that is known better now."""
    points, pairs = fibonacci(search.coarse_points), neighbours(surface.times)
    _, _, error, _ = compare_all(found.spin, points, surface.marks, surface.weights, surface.views, surface.frame, surface.times)
    return replace(found, residual=_residual(surface, found.spin, pairs, points, error))


def neighbours(times: Array) -> np.ndarray:
    """The first frames of the pairs that follow each other; a lost frame leaves a longer gap."""
    gaps = np.diff(times)
    return np.flatnonzero(gaps < 1.5 * gaps.min())


def _settle(s: Surface, spin: Array, points: Array, marks: np.ndarray, enough: float) -> tuple[Array, Array, float, Array]:
    """Gauss-Newton on all images from `spin` until a step is shorter than `enough` rad/s: the spin, and of
    `compare_all` the normal matrix, the mean square and the marks."""
    most = 0.05 / float(np.diff(s.times).min())
    for _ in range(STEPS):
        h, g, error, drawn = compare_all(spin, points, marks, s.weights, s.views, s.frame, s.times)
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
    """((n, 3) rotation vectors on a body-centred lattice, (n, CELLS) the cell that each cell turns into)."""
    edge = step * 2.0 ** (1 / 3)
    count = math.ceil(WIDEST / edge)
    i = np.arange(-count, count + 1) * edge
    grid = np.stack(np.meshgrid(i, i, i, indexing="ij"), axis=-1).reshape(-1, 3)
    lattice = np.concatenate([grid, grid + edge / 2])
    rotations = np.ascontiguousarray(lattice[np.linalg.norm(lattice, axis=1) <= WIDEST])
    return rotations, _make_table(rotations, fibonacci(CELLS), cube(CELLS, EDGE))


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
            table[r, i] = nearest(
                cube,
                m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
                m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
                m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
            )
    return table


@njit(cache=True, nogil=True, error_model="numpy")
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
                cell = nearest(
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
def _search(values: np.ndarray, weights: np.ndarray, pairs: np.ndarray, table: np.ndarray, contrast: float, every: int) -> np.ndarray:
    """(candidates,) sum of weight (difference^2 - 2 contrast) over cells and pairs of frames: unrelated marks score 0, equal ones less."""
    scores = np.zeros(len(table), dtype=np.float32)
    used = np.flatnonzero(weights.sum(axis=1) > 0.0)[::every]
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


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _sample(images: np.ndarray, weights: np.ndarray, views: Array, m: int, nx: float, ny: float, nz: float, out: Array) -> bool:
    """out (5,): value, weight and gradient with respect to the normal (nx, ny, nz), all in the camera's frame. False where image m does not
    show it."""
    cx, cy, cz = views[m, 9], views[m, 10], views[m, 11]
    towards = -(nx * cx + ny * cy + nz * cz)
    if towards < 0.0 or towards * towards < LIMB * LIMB * (cx * cx + cy * cy + cz * cz):
        return False
    px, py, pz = cx + BALL_RADIUS * nx, cy + BALL_RADIUS * ny, cz + BALL_RADIUS * nz
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
    out[2], out[3] = scale * gu, scale * gv
    out[4] = -(out[2] * px + out[3] * py) / pz
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _best(
    frame: int, x: float, y: float, z: float, images: np.ndarray, weights: np.ndarray, views: Array, frame_of: np.ndarray, out: Array
) -> bool:
    """The sample (5,) of the camera that sees the point (x, y, z), in `table`, best in `frame`; its gradient is in `table`, too."""
    best, cosine = -1, LIMB
    for m in range(len(images)):
        if frame_of[m] == frame:
            facing = views[m, 20] * x + views[m, 21] * y + views[m, 22] * z
            if facing > cosine:
                best, cosine = m, facing
    if best < 0:
        return False
    v = views[best]
    nx, ny, nz = v[0] * x + v[1] * y + v[2] * z, v[3] * x + v[4] * y + v[5] * z, v[6] * x + v[7] * y + v[8] * z
    if not _sample(images, weights, views, best, nx, ny, nz, out):
        return False
    gx, gy, gz = out[2], out[3], out[4]
    out[2], out[3], out[4] = v[0] * gx + v[3] * gy + v[6] * gz, v[1] * gx + v[4] * gy + v[7] * gz, v[2] * gx + v[5] * gy + v[8] * gz
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def firsts(points: Array, pairs: np.ndarray, images: np.ndarray, weights: np.ndarray, views: Array, frame_of: np.ndarray) -> Array:
    """(pairs, points, 2) value and weight of each point in the first frame of each pair; weight 0 where it is not seen."""
    out, sample = np.zeros((len(pairs), len(points), 2)), np.empty(5)
    for p in range(len(pairs)):
        for q in range(len(points)):
            if _best(pairs[p], points[q, 0], points[q, 1], points[q, 2], images, weights, views, frame_of, sample):
                out[p, q, 0], out[p, q, 1] = sample[0], sample[1]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
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
def turned(spin: Array, views: Array, frame_of: np.ndarray, times: Array) -> Array:
    """(images, 3, 3): from the ball as it is turned at time 0 to the camera's frame at each image."""
    out = np.empty((len(views), 3, 3))
    for m in range(len(views)):
        out[m] = views[m, :9].copy().reshape(3, 3) @ rotation_matrix(spin * times[frame_of[m]])
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def compare_all(
    spin: Array, points: Array, images: np.ndarray, weights: np.ndarray, views: Array, frame_of: np.ndarray, times: Array
) -> tuple[Array, Array, float, Array]:
    """All images compared with the marks that fit them best, point by point on the ball: normal equations with respect to the spin, the
    marks eliminated (variable projection), the mean squared error, and (n, 2) those marks and the weight that each rests on.

    points: (n, 3) unit vectors on the ball as it is turned at time 0.
    """
    count = len(images)
    turns, arms = turned(spin, views, frame_of, times), np.empty((count, 3, 3))
    for m in range(count):
        t = times[frame_of[m]]
        arms[m] = t * (views[m, :9].copy().reshape(3, 3) @ left_jacobian(spin * t)).T
    h, g, error, total, marks = np.zeros((3, 3)), np.zeros(3), 0.0, 0.0, np.zeros((len(points), 2))
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
                rows[seen, a] = arms[m, a, 0] * c0 + arms[m, a, 1] * c1 + arms[m, a, 2] * c2
            values[seen], mass[seen] = sample[0], sample[1]
            sw += sample[1]
            sv += sample[1] * sample[0]
            s0 += sample[1] * rows[seen, 0]
            s1 += sample[1] * rows[seen, 1]
            s2 += sample[1] * rows[seen, 2]
            seen += 1
        if seen > 0:
            marks[i, 0], marks[i, 1] = sv / sw, sw
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
    return h, g, error / max(total, 1e-12), marks
