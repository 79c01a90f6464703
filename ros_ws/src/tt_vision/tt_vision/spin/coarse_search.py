"""Coarse maps of the sphere in each frame, and the score of every rotation that can occur between two frames."""

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
from .sphere_grid import cube, fibonacci, nearest
from .surface_map import MarkImages, SurfaceMap

CELLS = 900  # of a coarse map, 0.12 rad apart
CUBE_EDGE = 48  # texels along the edge of the cube that finds them
LARGEST_TURN = 1.15  # rad between two frames that the search covers: 9,900 rpm at 900 frames a second
COARSE_STEP, DENSE_STEP = 0.135, 0.09  # rad between candidates: 2,600 and 8,700 of them; a mark is 0.4 rad wide
LEAST_MASS = 0.5  # pixels, weighted, on which a cell must rest
FULL_MASS = 2.0  # pixels, weighted, from which on a cell counts fully


class Candidates(NamedTuple):
    """Rotations between two frames.

    Attributes:
        rotations: (n, 3) rotation vectors, rad.
        table: (CELLS, n) int16, the cell that each cell turns into.
    """

    rotations: Array
    table: np.ndarray


class CoarseMaps(NamedTuple):
    """The marks of each frame in cells, both cameras together.

    Attributes:
        brightness: (CELLS, frames) float32.
        weights: (CELLS, frames) float32, at most 1, 0 where nothing is seen.
    """

    brightness: np.ndarray
    weights: np.ndarray


def coarse_maps(surface: SurfaceMap) -> CoarseMaps:
    """Return the coarse map of each frame."""
    return _maps(surface.sharp, cube(CELLS, CUBE_EDGE))


def score_candidates(maps: CoarseMaps, candidates: Candidates, pairs: np.ndarray, contrast: float) -> np.ndarray:
    """Return the score (n,) of each candidate over pairs of frames: 0 for unrelated marks, less for marks that agree.

    Args:
        maps: From `coarse_maps`.
        candidates: From `candidate_rotations`.
        pairs: (p,) first frames of the pairs.
        contrast: Variance of the brightness.
    """
    return _score(maps.brightness, maps.weights, pairs, candidates.table, contrast)


@functools.cache
def candidate_rotations(step: float) -> Candidates:
    """Return rotations up to LARGEST_TURN, `step` rad apart, on a body-centred lattice."""
    edge = step * 2.0 ** (1 / 3)
    count = math.ceil(LARGEST_TURN / edge)
    i = np.arange(-count, count + 1) * edge
    grid = np.stack(np.meshgrid(i, i, i, indexing="ij"), axis=-1).reshape(-1, 3)
    lattice = np.concatenate([grid, grid + edge / 2])
    rotations = np.ascontiguousarray(lattice[np.linalg.norm(lattice, axis=1) <= LARGEST_TURN])
    return Candidates(rotations, _make_table(rotations, fibonacci(CELLS), cube(CELLS, CUBE_EDGE)))


def prepare_search() -> None:
    """Make the tables of the search, which takes 0.3 s that no ball should wait for.

    It also makes glibc, which raises its thresholds by what is freed, keep the memory of one burst for the next: new pages cost up to 2 ms
    a burst.
    """
    np.empty(31 << 20, dtype=np.uint8)
    for step in (COARSE_STEP, DENSE_STEP):
        candidate_rotations(step)


@njit(cache=True, nogil=True)
def _make_table(rotations: Array, cells: Array, cube: np.ndarray) -> np.ndarray:
    """Return the cell (cells, rotations) int16 that each cell turns into."""
    table = np.empty((len(cells), len(rotations)), dtype=np.int16)
    for r in range(len(rotations)):
        turn = unpack_rotation(rotation_matrix(rotations[r]))
        for i in range(len(cells)):
            x, y, z = rotate(turn, cells[i, 0], cells[i, 1], cells[i, 2])
            table[i, r] = nearest(cube, x, y, z)
    return table


@njit(cache=True, nogil=True, error_model="numpy")
def _maps(images: MarkImages, cube: np.ndarray) -> CoarseMaps:
    """Return the mean of the marks in each cell; every second pixel is used."""
    marks, views, frames = images.marks, images.views, len(images.times)
    total, mass = np.zeros((CELLS, frames)), np.zeros((CELLS, frames))
    size = marks.shape[1]
    for m in range(len(marks)):
        view, k = views[m], images.frame_of[m]
        rotation, centre, middle = unpack_rotation(view.rotation), view.centre, view.principal_point
        sx, sy = centre[0] / centre[2], centre[1] / centre[2]
        scale = BALL_RADIUS * view.focal / centre[2]
        u0, v0 = view.focal * sx + middle[0], view.focal * sy + middle[1]
        for j in range(m % 2, size, 2):
            for i in range(m % 2, size, 2):
                w = marks[m, j, i].weight
                if w <= 0.0:
                    continue
                # (a, b, c): the point of the unit sphere at this pixel, with c along the line of sight to the ball's centre;
                # the small angle between that line and the optical axis then turns it into the camera's frame
                a, b = (i - u0) / scale, (j - v0) / scale
                c = -math.sqrt(max(0.0, 1.0 - a * a - b * b))
                x, y, z = rotate_back(rotation, a + sx * c, b + sy * c, c - sx * a - sy * b)
                cell = nearest(cube, x, y, z)
                total[cell, k] += w * marks[m, j, i].brightness
                mass[cell, k] += w
    values, weights = np.zeros(total.shape, dtype=np.float32), np.zeros(total.shape, dtype=np.float32)
    for c in range(CELLS):
        for k in range(frames):
            if mass[c, k] > LEAST_MASS:
                values[c, k] = total[c, k] / mass[c, k]
                weights[c, k] = min(1.0, mass[c, k] / FULL_MASS)
    return CoarseMaps(values, weights)


@njit(cache=True, nogil=True, fastmath=True)
def _score(values: np.ndarray, weights: np.ndarray, pairs: np.ndarray, table: np.ndarray, contrast: float) -> np.ndarray:
    """Return the sum (candidates,) of weight (difference^2 - 2 contrast) over cells and pairs of frames.

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
