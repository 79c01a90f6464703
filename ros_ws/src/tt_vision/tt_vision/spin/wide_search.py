"""The wide search: scores of spins that may turn the ball by any angle between two frames, from pairs of frames several frames apart."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

from .coarse_search import CoarseMaps, candidate_rotations, lattice, score_candidates
from .surface_map import shortest_gap

GRID_STEP = 0.14  # rad between neighbouring rotations for which scores are computed
SPIN_STEP = 0.06  # rad per frame between neighbouring spins that are tried
DISTANCES = 5  # number of time differences of pairs: a ball that turns by 72 to 180 deg per frame is back within 50 deg after 2 to 5 frames
SAME_DISTANCE = 0.02  # of the shortest time between frames; time differences that agree within it count as the same


class ScoredSpins(NamedTuple):
    """Spins with their scores, which tell how well the ball's marks (dots) agree with each spin.

    Attributes:
        spins: (n, 3) rad/s in `table`.
        scores: (n,) score of each spin: about 0 if the marks are unrelated, the lower the better they agree.
        pairs: (p, 2) indices of the pairs of frames for the refinement of the spins, the earlier one first.
    """

    spins: Array
    scores: np.ndarray
    pairs: np.ndarray


def score_spins(maps: CoarseMaps, times: Array, max_spin: float) -> ScoredSpins:
    """Score all spins up to a largest one that can be distinguished by images at the given times.

    With equal times between the frames, a spin cannot be told from one that turns the ball by a whole turn more between two frames. Only
    the slowest of such spins is scored; `aliases` returns the others.

    Args:
        maps: Coarse maps of the ball's surface in each frame, from `coarse_maps`.
        times: (frames,) s, rising.
        max_spin: rad/s, largest spin.
    """
    gap, groups = shortest_gap(times), _pairs_by_distance(times)
    grid = candidate_rotations(GRID_STEP, math.pi + GRID_STEP)
    scores = np.stack([score_candidates(maps, grid, pairs) for pairs in groups])
    spins = lattice(SPIN_STEP, min(max_spin * gap, math.pi)) / gap
    distances = np.array([float((times[pairs[:, 1]] - times[pairs[:, 0]]).mean()) for pairs in groups])
    return ScoredSpins(spins, _look_up(spins, distances, scores, _index(grid.rotations), GRID_STEP), np.concatenate(groups))


def aliases(spin: Array, gap: float, max_spin: float) -> Array:
    """Return the other spins about the same axis that turn the ball by whole turns more or less between two frames.

    Args:
        spin: (3,) rad/s.
        gap: s, time between two frames.
        max_spin: rad/s, largest spin that is returned.

    Returns:
        (n, 3) rad/s; n = 0 if there are none.
    """
    speed = float(np.linalg.norm(spin))
    axis = spin / speed if speed > 0.0 else np.array([0.0, 0.0, 1.0])
    turn = 2.0 * math.pi / gap
    counts = range(math.ceil((-max_spin - speed) / turn), math.floor((max_spin - speed) / turn) + 1)
    return np.array([(speed + count * turn) * axis for count in counts if count]).reshape(-1, 3)


def _pairs_by_distance(times: Array) -> list[np.ndarray]:
    """Return the pairs (p, 2) of frames, one array for each of the DISTANCES shortest time differences."""
    first, second = np.triu_indices(len(times), 1)
    distances = times[second] - times[first]
    order = np.argsort(distances, kind="stable")
    tolerance = SAME_DISTANCE * shortest_gap(times)
    starts = np.flatnonzero(np.diff(distances[order], prepend=-np.inf) > tolerance)
    pairs = np.stack([first, second], axis=1)[order]
    return [np.ascontiguousarray(group) for group in np.split(pairs, starts[1:])[:DISTANCES]]


def _index(rotations: Array) -> np.ndarray:
    """Return a table (2, n, n, n) int32 of the index of each rotation by its place in the body-centred lattice; -1 where there is none."""
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
    """Return the score of each spin: the sum over the time differences of the score of the rotation by which it turns the ball.

    Args:
        spins: (n, 3) rad/s.
        distances: (d,) s, time differences.
        scores: (d, rotations) scores of the rotations for each time difference.
        index: Index of the rotation at each place of the lattice, from `_index`.
        step: rad between neighbouring rotations.
    """
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
