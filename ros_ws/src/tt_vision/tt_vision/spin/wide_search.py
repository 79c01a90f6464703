"""The score of spins that turn the ball by any angle between two frames, from pairs of frames at several distances in time."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

from .coarse_search import CoarseMaps, candidate_rotations, lattice, score_candidates

GRID_STEP = 0.14  # rad between the rotations whose scores are looked up
SPIN_STEP = 0.06  # rad that neighbouring spins turn the ball apart from each other, in the shortest time between frames
DISTANCES = 5  # of pairs in time: a ball that turns by 72 to 180 deg a frame comes back within 50 deg of a place after 2 to 5 frames
SAME_DISTANCE = 0.02  # of the shortest time between frames, within which distances count as the same


class ScoredSpins(NamedTuple):
    """Spins and how well they fit.

    Attributes:
        spins: (n, 3) rad/s in `table`.
        scores: (n,) 0 for unrelated marks, less for marks that agree.
        pairs: (p, 2) the frames that were compared, the earlier one first.
    """

    spins: Array
    scores: np.ndarray
    pairs: np.ndarray


def score_spins(maps: CoarseMaps, times: Array, max_spin: float) -> ScoredSpins:
    """Return the scores of all spins up to `max_spin` that images at these times can tell apart.

    Frames at equal distances do not tell a spin from one with a whole turn more between two frames. Only the slowest of such spins is
    listed; `aliases` tells the others.

    Args:
        maps: From `coarse_maps`.
        times: (frames,) s, rising.
        max_spin: rad/s.
    """
    gap, groups = float(np.diff(times).min()), _pairs_by_distance(times)
    grid = candidate_rotations(GRID_STEP, math.pi + GRID_STEP)
    scores = np.stack([score_candidates(maps, grid, pairs) for pairs in groups])
    spins = lattice(SPIN_STEP, min(max_spin * gap, math.pi)) / gap
    distances = np.array([float((times[pairs[:, 1]] - times[pairs[:, 0]]).mean()) for pairs in groups])
    return ScoredSpins(spins, _look_up(spins, distances, scores, _index(grid.rotations), GRID_STEP), np.concatenate(groups))


def aliases(spin: Array, gap: float, max_spin: float) -> Array:
    """Return the other spins (n, 3), rad/s, up to `max_spin`, that differ from `spin` by whole turns in the time `gap`, s."""
    speed = float(np.linalg.norm(spin))
    axis = spin / speed if speed > 0.0 else np.array([0.0, 0.0, 1.0])
    turn = 2.0 * math.pi / gap
    counts = range(math.ceil((-max_spin - speed) / turn), math.floor((max_spin - speed) / turn) + 1)
    return np.array([(speed + count * turn) * axis for count in counts if count]).reshape(-1, 3)


def _pairs_by_distance(times: Array) -> list[np.ndarray]:
    """Return the pairs (p, 2) of frames of each of the shortest distances in time."""
    first, second = np.triu_indices(len(times), 1)
    distances = times[second] - times[first]
    order = np.argsort(distances, kind="stable")
    tolerance = SAME_DISTANCE * float(np.diff(times).min())
    starts = np.flatnonzero(np.diff(distances[order], prepend=-np.inf) > tolerance)
    pairs = np.stack([first, second], axis=1)[order]
    return [np.ascontiguousarray(group) for group in np.split(pairs, starts[1:])[:DISTANCES]]


def _index(rotations: Array) -> np.ndarray:
    """Return the number of each rotation of a body-centred lattice by its place, (2, n, n, n) int32; -1 where there is none."""
    edge = GRID_STEP * 2.0 ** (1 / 3)
    half = math.ceil(float(np.abs(rotations).max()) / edge) + 1
    index = np.full((2, 2 * half + 1, 2 * half + 1, 2 * half + 1), -1, dtype=np.int32)
    steps = rotations / edge
    centred = np.abs(steps - np.rint(steps)).max(axis=1) > 0.25
    places = np.rint(steps - 0.5 * centred[:, None]).astype(np.int64) + half
    index[centred.astype(np.int64), places[:, 0], places[:, 1], places[:, 2]] = np.arange(len(rotations))
    return index


@njit(cache=True, nogil=True, error_model="numpy")
def _look_up(spins: Array, distances: Array, scores: np.ndarray, index: np.ndarray, step: float) -> np.ndarray:
    """Return the sum (spins,) of the scores of the rotations by which each spin turns the ball in each distance in time."""
    edge, half = step * 2.0 ** (1 / 3), index.shape[1] // 2
    out = np.zeros(len(spins), dtype=np.float32)
    for s in range(len(spins)):
        for d in range(len(distances)):
            x, y, z = spins[s, 0] * distances[d], spins[s, 1] * distances[d], spins[s, 2] * distances[d]
            angle = math.sqrt(x * x + y * y + z * z)
            if angle > math.pi:
                shrink = 1.0 - 2.0 * math.pi * round(angle / (2.0 * math.pi)) / angle
                x, y, z = x * shrink, y * shrink, z * shrink
            best, least = -1, np.inf
            for centred in range(2):
                shift = 0.5 * centred
                i, j, k = round(x / edge - shift), round(y / edge - shift), round(z / edge - shift)
                square = (x / edge - i - shift) ** 2 + (y / edge - j - shift) ** 2 + (z / edge - k - shift) ** 2
                number = index[centred, i + half, j + half, k + half]
                if square < least and number >= 0:
                    best, least = number, square
            out[s] += scores[d, best]
    return out
