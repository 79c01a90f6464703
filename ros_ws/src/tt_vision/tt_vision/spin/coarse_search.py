"""The coarse search: coarse maps of the ball's surface in each frame, and the score of every rotation that can occur between two frames."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.so3 import rotation_matrix
from tt_core.states import Array

from ..projection import rotate, rotate_back, unpack_rotation
from .soft_surface import SoftSurface
from .sphere_grid import cube, fibonacci, nearest_point

CELLS = 900  # number of cells of a coarse map, 0.12 rad apart
CELL_CUBE_EDGE = 48  # number of cells along the edge of the cube map by which the cell at a direction is found
COARSE_TURN, DENSE_TURN = 1.15, 1.40  # rad between two frames, largest of the coarse and the dense search: 9,900 and 12,000 rpm at 900 Hz
COARSE_STEP, DENSE_STEP = 0.135, 0.09  # rad between candidates of the two searches: 2,600 and 15,700 candidates; a mark is 0.4 rad wide
LEAST_MASS = 0.25  # least sum of the weights of the pixels in a cell, at half the resolution; a cell with less is not used
FULL_MASS = 1.0  # the same sum from which on a cell has its full weight


class RotationCandidates(NamedTuple):
    """Rotations of the ball between two frames that the search tries.

    Attributes:
        rotations: (n, 3) rotation vectors, rad, in `table`.
        table: (CELLS, n) int16, index of the cell to which each rotation moves each cell.
    """

    rotations: Array
    table: np.ndarray


class CoarseMaps(NamedTuple):
    """Coarse maps of the ball's surface: its brightness in CELLS cells, for each frame, from all cameras together.

    Attributes:
        brightness: (CELLS, frames) float32, white is 1.
        weights: (CELLS, frames) float32, weight of each cell, at most 1; 0 where the surface is not seen.
    """

    brightness: np.ndarray
    weights: np.ndarray


def coarse_maps(surface: SoftSurface) -> CoarseMaps:
    """Compute the coarse map of the ball's surface in each frame, from its images at half the resolution."""
    images = surface.blurred
    return _maps(surface.brightness, surface.weights, images.views, images.frame_of, len(images.times), cube(CELLS, CELL_CUBE_EDGE))


def score_candidates(maps: CoarseMaps, candidates: RotationCandidates, pairs: np.ndarray) -> np.ndarray:
    """Score rotations of the ball: compare pairs of frames, with the ball in the first one rotated.

    Args:
        maps: Coarse maps of the ball's surface, from `coarse_maps`.
        candidates: The n rotations, from `candidate_rotations`.
        pairs: (p, 2) indices of frames, the earlier one first, all pairs with the same time difference.

    Returns:
        (n,) scores: about 0 if the marks (dots on the ball) are unrelated, the lower the better they agree.
    """
    return _score(maps.brightness, maps.weights, pairs, candidates.table)


@functools.cache
def candidate_rotations(step: float, largest: float) -> RotationCandidates:
    """Return rotations about all axes up to the angle `largest` (rad), about `step` (rad) apart. Results are cached."""
    rotations = lattice(step, largest)
    return RotationCandidates(rotations, _make_table(rotations, fibonacci(CELLS), cube(CELLS, CELL_CUBE_EDGE)))


def lattice(step: float, largest: float) -> Array:
    """Return the vectors (n, 3) of a body-centred cubic lattice that are no longer than `largest`; neighbours are about `step` apart."""
    edge = step * 2.0 ** (1 / 3)
    count = math.ceil(largest / edge)
    i = np.arange(-count, count + 1) * edge
    grid = np.stack(np.meshgrid(i, i, i, indexing="ij"), axis=-1).reshape(-1, 3)
    points = np.concatenate([grid, grid + edge / 2])
    return np.ascontiguousarray(points[np.linalg.norm(points, axis=1) <= largest])


def prepare_search() -> None:
    """Compute the tables of the search in advance, which takes 0.3 s, so that the first ball need not wait for them.

    It also allocates and frees a large array. After that the memory allocator of glibc keeps the memory of one burst for the next, because
    it adapts its thresholds to what is freed. New memory pages would cost up to 2 ms per burst.
    """
    np.empty(31 << 20, dtype=np.uint8)
    candidate_rotations(COARSE_STEP, COARSE_TURN)
    candidate_rotations(DENSE_STEP, DENSE_TURN)


@njit(cache=True, nogil=True)
def _make_table(rotations: Array, cells: Array, cube: np.ndarray) -> np.ndarray:
    """Return the index of the cell to which each rotation moves each cell, (cells, rotations) int16."""
    table = np.empty((len(cells), len(rotations)), dtype=np.int16)
    for r in range(len(rotations)):
        turn = unpack_rotation(rotation_matrix(rotations[r]))
        for i in range(len(cells)):
            x, y, z = rotate(turn, cells[i, 0], cells[i, 1], cells[i, 2])
            table[i, r] = nearest_point(cube, x, y, z)
    return table


@njit(cache=True, nogil=True, error_model="numpy")
def _maps(brightness: np.ndarray, shown: np.ndarray, views: np.ndarray, frame_of: np.ndarray, frames: int, cube: np.ndarray) -> CoarseMaps:
    """Return the weighted mean of the brightness in each cell, for each frame.

    Args:
        brightness: (images, n, n), `SoftSurface.brightness`.
        shown: (images, n, n), `SoftSurface.weights`.
        views: (images,) VIEW.
        frame_of: (images,) index of the frame of each image.
        frames: Number of frames.
        cube: Cube map of the cells, from `sphere_grid.cube`.
    """
    total, mass = np.zeros((CELLS, frames)), np.zeros((CELLS, frames))
    size = brightness.shape[1]
    for m in range(len(brightness)):
        view, k = views[m], frame_of[m]
        rotation, centre, middle = unpack_rotation(view.rotation), view.centre, view.principal_point
        sx, sy = centre[0] / centre[2], centre[1] / centre[2]
        scale = BALL_RADIUS * view.focal / centre[2]
        u0, v0 = view.focal * sx + middle[0], view.focal * sy + middle[1]
        for j in range(size):
            for i in range(size):
                w = shown[m, j, i]
                if w <= 0.0:
                    continue
                # (a, b, c): the point of the unit sphere at this pixel, with c along the line of sight to the ball's centre;
                # the small angle between that line and the optical axis then turns it into the camera's frame
                a, b = (i - u0) / scale, (j - v0) / scale
                c = -math.sqrt(max(0.0, 1.0 - a * a - b * b))
                x, y, z = rotate_back(rotation, a + sx * c, b + sy * c, c - sx * a - sy * b)
                cell = nearest_point(cube, x, y, z)
                total[cell, k] += w * brightness[m, j, i]
                mass[cell, k] += w
    values, weights = np.zeros(total.shape, dtype=np.float32), np.zeros(total.shape, dtype=np.float32)
    for c in range(CELLS):
        for k in range(frames):
            if mass[c, k] > LEAST_MASS:
                values[c, k] = total[c, k] / mass[c, k]
                weights[c, k] = min(1.0, mass[c, k] / FULL_MASS)
    return CoarseMaps(values, weights)


@njit(cache=True, nogil=True, fastmath=True)
def _score(values: np.ndarray, weights: np.ndarray, pairs: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Return the negative covariance (candidates,) of the brightness in two frames, summed over cells and pairs of frames.

    A mark that falls on a mark counts far more than white on white. So a rotation does not get a better score only because more of the ball
    stays in view. For each cell of the earlier frame the products with all cells of the later frame are computed first; the candidates then
    only look up theirs.

    Args:
        values: (cells, frames) brightness.
        weights: (cells, frames).
        pairs: (p, 2) indices of frames, the earlier one first.
        table: (cells, candidates) index of the cell to which each candidate moves each cell.
    """
    cells, n = len(values), len(pairs)
    mean = np.float32((values * weights).sum() / max(weights.sum(), np.float32(1e-6)))
    after = np.empty((n, cells), dtype=np.float32)
    for k in range(n):
        for j in range(cells):
            after[k, j] = weights[j, pairs[k, 1]] * (values[j, pairs[k, 1]] - mean)
    scores, row = np.zeros(table.shape[1], dtype=np.float32), np.empty(cells, dtype=np.float32)
    for i in range(cells):
        row[:] = 0.0
        seen = False
        for k in range(n):
            before = weights[i, pairs[k, 0]] * (mean - values[i, pairs[k, 0]])
            if before != 0.0:
                seen = True
                for j in range(cells):
                    row[j] += before * after[k, j]
        if seen:
            for c in range(len(scores)):
                scores[c] += row[table[i, c]]
    return scores
