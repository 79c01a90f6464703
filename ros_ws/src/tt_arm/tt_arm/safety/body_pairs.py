"""Select the pairs of an arm's bodies that must be checked for contact with each other.

Not checked are: bodies of the same link; bodies with one joint between them, which the limits of this joint keep apart (a joint about whose
axis a body lies does not count, because it does not move the body); bodies that overlap in most postures or are near each other in nearly
all, because the joints between them are at the same place, as in a wrist, and capsules are too coarse to tell whether they touch; and
bodies that stay apart in all postures.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from tt_core.states import Array

from ..arm_urdf.geometry import ABOUT, lever
from ..kinematics import Bodies, place_bodies
from .clearance import Pairs, Places, between_segments, from_segment, places

POSTURES = 500  # number of random postures in which the distances are computed
MOSTLY = 0.5  # share of the postures; bodies that overlap in at least this share are neighbours and are not checked
NEIGHBOUR_DISTANCE = 0.05  # m; bodies within this distance in NEIGHBOUR_SHARE of the postures are neighbours, too
NEIGHBOUR_SHARE = 0.95
APART = 0.05  # m, least distance in all postures of bodies that need not be checked
MOST_RANGES = 2000  # number of ranges of postures after which bodies are checked, because it is not proved that they stay apart


@njit(cache=True)
def _between(m: int, other: int, at: Places, bodies: Bodies) -> float:
    """Return the distance (m) between two capsules, or between a capsule and a sphere around the racket if `other` is -1."""
    if other >= 0:
        return between_segments(at.starts, at.ends, m, other) - bodies.radii[m] - bodies.radii[other]
    return from_segment(at.face[0], at.face[1], at.face[2], at.starts, at.ends, m) - bodies.radii[m] - bodies.rim


@njit(cache=True)
def pair_distances(postures: Array, pairs: Pairs, bodies: Bodies) -> Array:
    """Compute the distance of each pair of bodies in each of several postures.

    Args:
        postures: (k, n) rad or m, joint positions.
        pairs: (p, 2) indices of capsules; the second is -1 for the racket, which is replaced by a sphere around it.
        bodies: Capsules and racket of the arm.

    Returns:
        (k, p) m; negative if the bodies overlap.
    """
    distances, at = np.empty((len(postures), len(pairs))), places(len(bodies.owners))
    for k in range(len(postures)):
        place_bodies(postures[k], bodies, at.starts, at.ends, at.face, at.rotation)
        for p in range(len(pairs)):
            distances[k, p] = _between(pairs[p, 0], pairs[p, 1], at, bodies)
    return distances


@njit(cache=True)
def _stays_apart(m: int, other: int, position: Array, levers: Array, bodies: Bodies) -> bool:
    """Return whether two bodies are proved to stay APART in all postures, by halving the ranges of the joints until the answer is sure.

    Args:
        m: Index of a capsule.
        other: Index of one further out, or -1 for the racket.
        position: (n, 2) rad or m, limits of the joints.
        levers: (n,) m, how far a point of the outer body moves by 1 rad or m of each joint at most; 0 for joints that move both.
        bodies: Of the arm.
    """
    n, at = len(levers), places(len(bodies.owners))
    stack, middle, top = np.empty((MOST_RANGES + 1, n, 2)), np.empty(n), 1
    stack[0] = position
    for _ in range(MOST_RANGES):
        top -= 1
        low, high = stack[top, :, 0].copy(), stack[top, :, 1].copy()
        moves, widest = 0.0, 0
        for i in range(n):
            middle[i] = 0.5 * (low[i] + high[i])
            moves += 0.5 * (high[i] - low[i]) * levers[i]
            widest = i if (high[i] - low[i]) * levers[i] > (high[widest] - low[widest]) * levers[widest] else widest
        place_bodies(middle, bodies, at.starts, at.ends, at.face, at.rotation)
        left = _between(m, other, at, bodies)
        if left < APART:
            return False
        if left - moves < APART:
            for half in range(2):
                stack[top, :, 0], stack[top, :, 1] = low, high
                stack[top, widest, 1 - half] = middle[widest]
                top += 1
        if top == 0:
            return True
    return False


def find_pairs(bodies: Bodies, position: Array) -> Pairs:
    """Return the pairs of an arm's bodies that must be checked for contact, for `Bodies.pairs`.

    The pairs with the smallest median distance come first, so that fewer exact distances have to be computed for the others.

    Args:
        bodies: Capsules and racket of the arm; `pairs` is not used.
        position: (n, 2) rad or m, position limits of the joints.

    Returns:
        (p, 2) indices of capsules; the second is -1 for the racket.
    """
    count, n = len(bodies.owners), len(bodies.chain.linear)
    last = [int(bodies.owners[m]) + _is_about(bodies, m) for m in range(count)]
    pairs = [(m, k) for k in range(count) for m in range(k) if bodies.owners[k] - last[m] > 1]
    pairs += [(m, -1) for m in range(count) if n - 1 - last[m] > 1]
    candidates = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    postures = np.random.default_rng(0).uniform(position[:, 0], position[:, 1], (POSTURES, n))
    distances = pair_distances(postures, candidates, bodies)
    order = np.argsort(np.median(distances, axis=0))
    neighbours = ((distances <= 0.0).mean(axis=0) >= MOSTLY) | ((distances <= NEIGHBOUR_DISTANCE).mean(axis=0) >= NEIGHBOUR_SHARE)
    candidates = candidates[[p for p in order if not neighbours[p]]]
    ranges = np.abs(position).max(axis=1)
    kept = []
    for m, k in candidates:
        end = n if k < 0 else int(bodies.owners[k]) + 1
        levers = np.array([lever(bodies, ranges, i, int(k)) if bodies.owners[m] < i < end else 0.0 for i in range(n)])
        kept.append(not _stays_apart(int(m), int(k), position, levers, bodies))
    return candidates[np.array(kept, dtype=bool)]


def _is_about(bodies: Bodies, m: int) -> bool:
    """Return whether capsule m lies along the axis of the next joint."""
    joint, chain = int(bodies.owners[m]) + 1, bodies.chain
    if joint == len(chain.linear) or chain.linear[joint]:
        return False
    ends = (np.array([bodies.starts[m], bodies.ends[m]]) - chain.positions[joint]) @ chain.rotations[joint]
    return bool(np.hypot(ends[:, 0], ends[:, 1]).max() < ABOUT)
