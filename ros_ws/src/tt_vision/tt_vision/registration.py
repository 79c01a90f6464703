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
from tt_core.states import Array

from .camera import project_point
from .surface import Surface

CELLS = 900  # of the coarse maps, 0.12 rad apart
WIDEST = 1.15  # rad between two frames that the search covers: 9,900 rpm at 900 frames a second
STEP, DENSE_STEP = 0.135, 0.09  # rad between candidates: 2,600 and 8,700 of them; a mark is 0.4 rad wide
KEPT = 8  # candidates that are refined
APART = 0.2  # rad between kept candidates
COARSE_POINTS, FINE_POINTS = 500, 2500  # points on the sphere in the refinements
GATE = 0.15  # residual above which a registration is not believed


@dataclass(frozen=True, eq=False)
class Registration:
    """spin: (3,) rad/s. information: (3, 3) of the last least squares. residual: 0 for marks that agree, 1 for unrelated ones.
    candidates: how many rotations were tried."""

    spin: Array
    information: Array
    residual: float
    candidates: int


def register(surface: Surface) -> Registration:
    """The spin of the ball; residual above GATE means that none was found."""
    gaps = np.diff(surface.times)
    gap = float(gaps.min())
    pairs = np.flatnonzero(gaps < 1.5 * gap)  # a lost frame leaves a longer gap
    values, weights = _maps(
        surface.marks,
        surface.weights,
        surface.corners,
        surface.centres,
        surface.camera,
        surface.frame,
        surface.vectors,
        _cells(),
        _cube(),
        len(surface.times),
    )
    best = None
    for step in (STEP, DENSE_STEP):
        rotations, table = _candidates(step)
        scores = _search(values, weights, pairs, table, surface.contrast)
        found = _refine(surface, pairs, gap, rotations, scores)
        if best is None or found.residual < best.residual:
            best = Registration(found.spin, found.information, found.residual, len(rotations))
        if best.residual < GATE:
            break
    return best


def _refine(surface: Surface, pairs: np.ndarray, gap: float, rotations: Array, scores: Array) -> Registration:
    chosen: list[Array] = []
    for i in np.argsort(scores)[:200]:
        if all(np.linalg.norm(rotations[i] - other) > APART for other in chosen):
            chosen.append(rotations[i])
        if len(chosen) == KEPT:
            break
    points = _fibonacci(COARSE_POINTS)
    s = surface
    common = (s.weights, s.corners, s.centres, s.camera, s.frame, s.vectors, s.times)
    trials = []
    for rotation in chosen:
        spin = rotation / gap
        for _ in range(4):
            cost, weight, h, g = _pairs(spin, points, pairs, s.soft, *common, s.contrast)
            if weight <= 0.0:
                break
            spin = spin - _limited(np.linalg.solve(h + 1e-9 * np.trace(h) * np.eye(3) + 1e-12 * np.eye(3), g), 0.1 / gap)
        trials.append((cost, spin))
    trials.sort(key=lambda trial: trial[0])
    spin = trials[0][1]
    fine = _fibonacci(FINE_POINTS)
    for i in range(5):
        h, g, error, weight = _all(spin, fine, s.soft if i == 0 else s.marks, *common)
        change = np.linalg.solve(h + 1e-12 * np.eye(3), g)
        spin = spin - _limited(change, 0.05 / gap)
        if i > 1 and np.linalg.norm(change) < 0.01:
            break
    cost, weight, _, _ = _pairs(spin, fine, pairs, s.marks, *common, 0.0)
    residual = cost / max(2.0 * s.contrast * weight, 1e-12) if weight > 0.02 * FINE_POINTS * len(pairs) else 1.0
    return Registration(spin, h / max(error, 1e-12), residual, 0)


def _limited(v: Array, most: float) -> Array:
    length = float(np.linalg.norm(v))
    return v if length <= most else v * (most / length)


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
    angle2 = v @ v
    angle = math.sqrt(angle2)
    if angle < 1e-9:
        a, b = 1.0, 0.5
    else:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.eye(3) + a * k + b * (k @ k)


@njit(cache=True, nogil=True)
def left_jacobian(v: Array) -> Array:
    """(3, 3) J with exp(v + d) = exp(J d) exp(v) to first order."""
    angle2 = v @ v
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
    marks: np.ndarray,
    weights: np.ndarray,
    corners: Array,
    centres: Array,
    camera_of: np.ndarray,
    frame_of: np.ndarray,
    vectors: Array,
    cells: Array,
    cube: np.ndarray,
    frames: int,
) -> tuple[np.ndarray, np.ndarray]:
    """(CELLS, frames) float32 mean of the marks in each cell, both cameras together, and its weight, at most 1."""
    total, mass = np.zeros((len(cells), frames)), np.zeros((len(cells), frames))
    size = marks.shape[1]
    for m in range(len(marks)):
        camera = vectors[camera_of[m]]
        cx, cy, cz = centres[m]
        scale = BALL_RADIUS * camera[12] / cz
        u0, v0 = project_point(camera, cx, cy, cz)
        for j in range(m % 2, size, 2):
            for i in range(m % 2, size, 2):
                w = weights[m, j, i]
                if w <= 0.0:
                    continue
                a, b = (corners[m, 0] + i - u0) / scale, (corners[m, 1] + j - v0) / scale
                towards = -math.sqrt(max(0.0, 1.0 - a * a - b * b))
                # the line of sight is not the optical axis: turn by the small angle between them
                a, b, towards = a + cx / cz * towards, b + cy / cz * towards, towards - cx / cz * a - cy / cz * b
                cell = _lookup(
                    cube,
                    camera[0] * a + camera[3] * b + camera[6] * towards,
                    camera[1] * a + camera[4] * b + camera[7] * towards,
                    camera[2] * a + camera[5] * b + camera[8] * towards,
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
            l = table[c, i]
            for k in range(n):
                d = before[i, k] - after[l, k]
                score += w_before[i, k] * w_after[l, k] * (d * d - unrelated)
        scores[c] = score
    return scores


@njit(cache=True, nogil=True)
def _sample(
    image: np.ndarray,
    weight: np.ndarray,
    corner: Array,
    centre: Array,
    camera: Array,
    n: Array,
    out: Array,
) -> bool:
    """out (5,): value, weight and gradient with respect to the normal n (3,) in `table`. False where the point is not seen."""
    nx = camera[0] * n[0] + camera[1] * n[1] + camera[2] * n[2]
    ny = camera[3] * n[0] + camera[4] * n[1] + camera[5] * n[2]
    nz = camera[6] * n[0] + camera[7] * n[1] + camera[8] * n[2]
    x, y, z = centre[0] + BALL_RADIUS * nx, centre[1] + BALL_RADIUS * ny, centre[2] + BALL_RADIUS * nz
    if nx * x + ny * y + nz * z > -0.2 * z:
        return False
    u, v = project_point(camera, x, y, z)
    u, v = u - corner[0], v - corner[1]
    i, j = int(u), int(v)
    if i < 1 or j < 1 or i >= image.shape[1] - 2 or j >= image.shape[0] - 2:
        return False
    a, b = np.float32(u - i), np.float32(v - j)
    w = (1 - b) * ((1 - a) * weight[j, i] + a * weight[j, i + 1]) + b * ((1 - a) * weight[j + 1, i] + a * weight[j + 1, i + 1])
    if w <= 0.02:
        return False
    out[0] = (1 - b) * ((1 - a) * image[j, i] + a * image[j, i + 1]) + b * ((1 - a) * image[j + 1, i] + a * image[j + 1, i + 1])
    out[1] = w
    # central differences, interpolated like the value: smooth from pixel to pixel
    gu = (1 - b) * ((1 - a) * (image[j, i + 1] - image[j, i - 1]) + a * (image[j, i + 2] - image[j, i])) + b * (
        (1 - a) * (image[j + 1, i + 1] - image[j + 1, i - 1]) + a * (image[j + 1, i + 2] - image[j + 1, i])
    )
    gv = (1 - b) * ((1 - a) * (image[j + 1, i] - image[j - 1, i]) + a * (image[j + 1, i + 1] - image[j - 1, i + 1])) + b * (
        (1 - a) * (image[j + 2, i] - image[j, i]) + a * (image[j + 2, i + 1] - image[j, i + 1])
    )
    scale = 0.5 * camera[12] * BALL_RADIUS / z
    gx, gy = scale * gu, scale * gv
    gz = -(gx * x + gy * y) / z
    out[2] = camera[0] * gx + camera[3] * gy + camera[6] * gz
    out[3] = camera[1] * gx + camera[4] * gy + camera[7] * gz
    out[4] = camera[2] * gx + camera[5] * gy + camera[8] * gz
    return True


@njit(cache=True, nogil=True)
def _best(
    frame: int,
    n: Array,
    images: np.ndarray,
    weights: np.ndarray,
    corners: Array,
    centres: Array,
    camera_of: np.ndarray,
    frame_of: np.ndarray,
    vectors: Array,
    trial: Array,
    out: Array,
) -> bool:
    """The sample of the camera that sees the point best in `frame`."""
    out[1] = 0.0
    for m in range(len(images)):
        if (
            frame_of[m] == frame
            and _sample(images[m], weights[m], corners[m], centres[m], vectors[camera_of[m]], n, trial)
            and trial[1] > out[1]
        ):
            out[:] = trial
    return out[1] > 0.0


@njit(cache=True, nogil=True)
def _pairs(
    spin: Array,
    points: Array,
    pairs: np.ndarray,
    images: np.ndarray,
    weights: np.ndarray,
    corners: Array,
    centres: Array,
    camera_of: np.ndarray,
    frame_of: np.ndarray,
    vectors: Array,
    times: Array,
    contrast: float,
) -> tuple[float, float, Array, Array]:
    """Neighbouring frames compared: cost sum w (d^2 - 2 contrast), sum w, and the normal equations of d with respect to the spin."""
    cost, total, h, g = 0.0, 0.0, np.zeros((3, 3)), np.zeros(3)
    first, second, trial, row = np.empty(5), np.empty(5), np.empty(5), np.empty(3)
    for k in pairs:
        dt = times[k + 1] - times[k]
        turn, left = rotation_matrix(spin * dt), left_jacobian(spin * dt)
        for q in points:
            if not _best(k, q, images, weights, corners, centres, camera_of, frame_of, vectors, trial, first):
                continue
            n = turn @ q
            if not _best(k + 1, n, images, weights, corners, centres, camera_of, frame_of, vectors, trial, second):
                continue
            d = second[0] - first[0]
            w = first[1] * second[1]
            cross = np.array(
                [n[1] * second[4] - n[2] * second[3], n[2] * second[2] - n[0] * second[4], n[0] * second[3] - n[1] * second[2]]
            )
            for a in range(3):
                row[a] = dt * (left[0, a] * cross[0] + left[1, a] * cross[1] + left[2, a] * cross[2])
            cost += w * (d * d - 2.0 * contrast)
            total += w
            for a in range(3):
                g[a] += w * row[a] * d
                for b in range(3):
                    h[a, b] += w * row[a] * row[b]
    return cost, total, h, g


@njit(cache=True, nogil=True)
def _all(
    spin: Array,
    points: Array,
    images: np.ndarray,
    weights: np.ndarray,
    corners: Array,
    centres: Array,
    camera_of: np.ndarray,
    frame_of: np.ndarray,
    vectors: Array,
    times: Array,
) -> tuple[Array, Array, float, float]:
    """All images compared with the marks that fit them best, point by point on the ball: normal equations with respect to the spin, the
    marks eliminated (variable projection), mean squared error and weight."""
    count = len(images)
    turns, lefts = np.empty((count, 3, 3)), np.empty((count, 3, 3))
    for m in range(count):
        t = times[frame_of[m]]
        turns[m], lefts[m] = rotation_matrix(spin * t), t * left_jacobian(spin * t)
    h, g, error, total = np.zeros((3, 3)), np.zeros(3), 0.0, 0.0
    values, mass, rows, sample, n = np.empty(count), np.empty(count), np.empty((count, 3)), np.empty(5), np.empty(3)
    for q in points:
        sw, sv, seen = 0.0, 0.0, 0
        s0, s1, s2 = 0.0, 0.0, 0.0
        for m in range(count):
            r = turns[m]
            for a in range(3):
                n[a] = r[a, 0] * q[0] + r[a, 1] * q[1] + r[a, 2] * q[2]
            if not _sample(images[m], weights[m], corners[m], centres[m], vectors[camera_of[m]], n, sample):
                continue
            c0, c1, c2 = n[1] * sample[4] - n[2] * sample[3], n[2] * sample[2] - n[0] * sample[4], n[0] * sample[3] - n[1] * sample[2]
            left = lefts[m]
            for a in range(3):
                rows[seen, a] = left[0, a] * c0 + left[1, a] * c1 + left[2, a] * c2
            values[seen], mass[seen] = sample[0], sample[1]
            sw += sample[1]
            sv += sample[1] * sample[0]
            s0 += sample[1] * rows[seen, 0]
            s1 += sample[1] * rows[seen, 1]
            s2 += sample[1] * rows[seen, 2]
            seen += 1
        if seen < 2:
            continue
        for i in range(seen):
            e, w = values[i] - sv / sw, mass[i]
            j0, j1, j2 = rows[i, 0] - s0 / sw, rows[i, 1] - s1 / sw, rows[i, 2] - s2 / sw
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
