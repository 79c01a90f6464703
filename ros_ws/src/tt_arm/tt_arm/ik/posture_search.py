"""Kernels of the search among all postures of any arm for a stroke.

Face position and normal are five conditions, so an arm with n joints has n - 5 freedoms left. The search knows an arm by its atlas: many
postures within its limits, with the position and normal of the face. It settles those whose face is nearest to the wanted one by Newton's
method, takes the cheapest, and refines them along the freedoms that are left: a step along the null space of the five rows, settled again.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.states import Array

from ..joints import JointBounds
from ..kinematics import Chain, forward_into
from .newton import NewtonScratch, Target, newton_scratch, settle
from .posture_cost import (
    BestPosture,
    PostureQuestion,
    PostureTask,
    Scratch,
    cost_of_joints,
    cost_scratch,
    joint_tasks,
    nearest_turn,
    posture_weights,
    time_to,
)

ATLAS_SIZE = 20_000  # 5 ms to make
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19)
PROBES, WIDER = 200, 2.0  # other postures that tell how far a face in reach may be from the atlas; times the furthest of them
NORMAL_SCALE = 0.5  # m that count in the distance of two faces as much as 1 of their normals' difference
SEED_STEPS, REFINE_STEPS = 20, 6  # of Newton's method
STARTS = 2  # postures that are refined
CLOSE = 3.0  # cost above the best one, up to which a posture may still be refined to a better one
STEEP = 8.0  # per rad of the step: a start that costs more than this above the best is given up
MOST_STEPS = 300  # of one descent, which takes about 30
FIRST_STEP, LAST_STEP = 0.25, 0.01  # rad, of a descent
SAME = 0.05  # rad or m, in every joint, below which two postures are refined to the same
INDEPENDENT = 1e-3  # length of a unit vector's part in the null space, below which it adds no direction


class Atlas(NamedTuple):
    """Postures of an arm.

    Attributes:
        postures: (n, size) rad or m; one row for each joint, for speed.
        faces: (6, size) position (m) and NORMAL_SCALE times the normal of the face.
        bounds: (n, 2) rad or m, that Newton's method keeps; infinite for a joint that may make whole turns.
        widest: m^2, squared distance of a face to the nearest one of the atlas, beyond which it is out of reach.
    """

    postures: Array
    faces: Array
    bounds: Array
    widest: float


@njit(cache=True)
def fill_faces(postures: Array, chain: Chain) -> Array:
    """Return `Atlas.faces` of postures (n, size)."""
    n, size = postures.shape
    faces, q = np.empty((6, size)), np.empty(n)
    point, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, n))
    for m in range(size):
        for i in range(n):
            q[i] = postures[i, m]
        forward_into(q, chain, point, rotation, jacobian)
        for k in range(3):
            faces[k, m], faces[3 + k, m] = point[k], NORMAL_SCALE * rotation[k, 2]
    return faces


@njit(cache=True, fastmath=True)
def _distances(target: Target, faces: Array, distances: Array) -> None:
    """Fill the squared distance (m^2) of each face of the atlas to the wanted one."""
    x, y, z = target.position[0], target.position[1], target.position[2]
    u, v, w = NORMAL_SCALE * target.normal[0], NORMAL_SCALE * target.normal[1], NORMAL_SCALE * target.normal[2]
    for m in range(faces.shape[1]):
        distances[m] = (
            (faces[0, m] - x) ** 2 + (faces[1, m] - y) ** 2 + (faces[2, m] - z) ** 2
            + (faces[3, m] - u) ** 2 + (faces[4, m] - v) ** 2 + (faces[5, m] - w) ** 2
        )  # fmt: skip


@njit(cache=True)
def _nearest(distances: Array, count: int) -> npt.NDArray[np.int64]:
    """Return the indices (count,) of the least distances, in order."""
    found, values = np.zeros(count, np.int64), np.full(count, np.inf)
    for m in range(len(distances)):
        distance = distances[m]
        if distance < values[count - 1]:
            k = count - 1
            while k > 0 and values[k - 1] > distance:
                values[k], found[k] = values[k - 1], found[k - 1]
                k -= 1
            values[k], found[k] = distance, m
    return found


@njit(cache=True)
def _free_directions(rows: Array, directions: Array) -> int:
    """Fill directions (3, n) with an orthonormal basis of the null space of rows (5, n), at most three; return how many there are."""
    n = rows.shape[1]
    basis, count = np.empty((8, n)), 0
    for k in range(5):
        count += _orthonormal(rows[k], basis, count, 1e-6)
    rank = count
    while count < min(n, rank + 3):
        best, longest, vector = -1, INDEPENDENT, np.zeros(n)
        for i in range(n):
            inside = 1.0
            for k in range(count):
                inside -= basis[k, i] ** 2
            if inside > longest:
                best, longest = i, inside
        if best < 0:
            break
        vector[best] = 1.0
        if _orthonormal(vector, basis, count, 0.0) == 0:
            break
        directions[count - rank] = basis[count]
        count += 1
    return count - rank


@njit(cache=True)
def _orthonormal(vector: Array, basis: Array, count: int, least: float) -> int:
    """Append the part of a vector that is square to the first `count` rows of basis; return 1, or 0 if it is not longer than `least`."""
    n = len(vector)
    for i in range(n):
        basis[count, i] = vector[i]
    for _ in range(2):  # twice, for rounding
        for k in range(count):
            along = 0.0
            for i in range(n):
                along += basis[k, i] * basis[count, i]
            for i in range(n):
                basis[count, i] -= along * basis[k, i]
    length = 0.0
    for i in range(n):
        length += basis[count, i] ** 2
    length = math.sqrt(length)
    if length <= least:
        return 0
    for i in range(n):
        basis[count, i] /= length
    return 1


class Search(NamedTuple):
    """What all steps of a search share."""

    target: Target
    task: PostureTask
    atlas: Atlas
    chain: Chain
    newton: NewtonScratch
    scratch: Scratch


@njit(cache=True)
def _settled_cost(search: Search, steps: int, bound: float, q: Array, qdot: Array) -> float:
    """Settle q (n,) in place and return its cost, with the joint speeds filled; see `cost_of_joints`."""
    joints, bounds = search.task.joints, search.atlas.bounds
    if not settle(search.target, bounds, steps, search.chain, q, search.scratch.rows, search.newton):
        return math.inf
    for i in range(len(q)):
        if bounds[i, 1] == np.inf:
            q[i] = nearest_turn(q[i], joints[i].start, joints[i].low, joints[i].high)
    nearest = time_to(q, joints)
    if nearest == math.inf:
        return math.inf
    return cost_of_joints(len(q), q, PostureQuestion(nearest, bound, True), search.task, search.chain, qdot, search.scratch)


@njit(cache=True)
def _descend(search: Search, cost: float, best: float, q: Array, qdot: Array) -> float:
    """Refine a posture in place by a compass search along the free directions, with steps that halve.

    Args:
        search: What is asked.
        cost: Of the posture.
        best: Cost of the best refined posture so far; the search ends when it cannot become better.
        q: (n,) rad or m.
        qdot: (n,) rad/s or m/s.

    Returns:
        The cost.
    """
    n = len(q)
    trial, trial_qdot, directions = np.empty(n), np.empty(n), np.zeros((3, n))
    size, fresh, count = FIRST_STEP, False, 0
    for _ in range(MOST_STEPS):
        if size <= LAST_STEP:
            break
        if not fresh:
            trial[:] = q
            settle(search.target, search.atlas.bounds, REFINE_STEPS, search.chain, trial, search.scratch.rows, search.newton)
            count, fresh = _free_directions(search.scratch.rows, directions), True
            if count == 0:
                break
        moved = False
        for code in range(1, 3**count):  # each direction forwards, not at all, or backwards
            rest, length = code, 0.0
            trial[:] = q
            for d in range(count):
                sign = rest % 3
                rest //= 3
                if sign:
                    along = size if sign == 1 else -size
                    length += 1.0
                    for i in range(n):
                        trial[i] += along * directions[d, i]
            if length > 2.0:  # the corners of a cube are as far as the next step
                continue
            for i in range(n):
                trial[i] = min(search.task.joints[i].high, max(search.task.joints[i].low, trial[i]))
            now = _settled_cost(search, REFINE_STEPS, cost, trial, trial_qdot)
            if now < cost:
                cost, moved, fresh = now, True, False
                q[:], qdot[:] = trial, trial_qdot
                break
        if not moved:
            size *= 0.5
            if cost > best + STEEP * size:
                break
    return cost


@njit(cache=True, nogil=True)
def search(
    target: Target, velocity: Array, start: Array, limits: JointBounds, weights: Array, count: int, atlas: Atlas, chain: Chain
) -> BestPosture:
    """Search the best posture.

    Args:
        target: Where the face is wanted.
        velocity: (3,) m/s, of the face centre.
        start: (3, n) q and qdot where the arm comes from, and q where it waits.
        limits: Of the joints.
        weights: (6,) of `PostureWeights`.
        count: Postures of the atlas that are settled.
        atlas: Of the arm.
        chain: The geometry.
    """
    n = len(limits)
    task = PostureTask(velocity, joint_tasks(start, limits), posture_weights(weights))
    here = Search(target, task, atlas, chain, newton_scratch(n), cost_scratch(n))
    distances = np.empty(atlas.faces.shape[1])
    _distances(here.target, atlas.faces, distances)
    best = BestPosture(math.inf, start[0].copy(), np.zeros(n))
    if distances.min() > atlas.widest:
        return best
    seeds = _nearest(distances, count)
    costs, found, speeds, least = np.full(count + 2, np.inf), np.empty((count + 2, n)), np.empty((count + 2, n)), math.inf
    for m in range(count + 2):
        for i in range(n):
            found[m, i] = start[2 * m, i] if m < 2 else atlas.postures[i, seeds[m - 2]]
        costs[m] = _settled_cost(here, SEED_STEPS, least + CLOSE, found[m], speeds[m])
        least = min(least, costs[m])
    for _ in range(STARTS):
        m = int(np.argmin(costs))
        if costs[m] == math.inf:
            break
        q, qdot = found[m].copy(), speeds[m].copy()
        for k in range(count + 2):
            if np.abs(found[k] - q).max() < SAME:
                costs[k] = math.inf if k != m else costs[k]
        cost = _descend(here, costs[m], best.cost, q, qdot)
        costs[m] = math.inf
        if cost < best.cost:
            best = BestPosture(cost, q, qdot)
    return best


@njit(cache=True, nogil=True)
def any_posture(target: Target, seed: Array, limits: JointBounds, count: int, atlas: Atlas, chain: Chain, q: Array) -> bool:
    """Fill q (n,) with the first posture within the limits that is found: from the seed, then from the nearest faces of the atlas.

    Args:
        target: Where the face is wanted.
        seed: (n,) rad or m, where the arm is.
        limits: Of the joints.
        count: Postures of the atlas that are settled at most.
        atlas: Of the arm.
        chain: The geometry.
        q: (n,) rad or m; filled.

    Returns:
        Whether there is one.
    """
    n, distances = len(seed), np.empty(atlas.faces.shape[1])
    rows, scratch, seeds = np.empty((5, n)), newton_scratch(n), np.zeros(0, np.int64)
    for m in range(count + 1):
        if m == 1:
            _distances(target, atlas.faces, distances)
            seeds = _nearest(distances, count)
            if distances[seeds[0]] > atlas.widest:
                return False
        for i in range(n):
            q[i] = seed[i] if m == 0 else atlas.postures[i, seeds[m - 1]]
        if not settle(target, atlas.bounds, SEED_STEPS, chain, q, rows, scratch):
            continue
        inside = True
        for i in range(n):
            if atlas.bounds[i, 1] == np.inf:
                q[i] = nearest_turn(q[i], seed[i], limits[i].low, limits[i].high)
            inside = inside and limits[i].low <= q[i] <= limits[i].high
        if inside:
            return True
    return False


def make_atlas(chain: Chain, position: Array) -> Atlas:
    """Return the atlas of an arm: ATLAS_SIZE postures spread evenly over the limits by a Halton sequence.

    Args:
        chain: The geometry.
        position: (n, 2) rad or m, limits of the joints.
    """
    low, high = position.T
    whole = ~chain.linear & (high - low >= 2.0 * math.pi)  # these joints are the same after a turn
    middle = 0.5 * (low + high)
    low, high = np.where(whole, middle - math.pi, low), np.where(whole, middle + math.pi, high)
    shares = np.array([_halton(prime, ATLAS_SIZE + PROBES) for prime in PRIMES[: len(low)]])
    postures = low[:, None] + shares * (high - low)[:, None]
    faces = fill_faces(postures, chain)
    atlas, probes = np.ascontiguousarray(faces[:, :ATLAS_SIZE]), faces[:, ATLAS_SIZE:]
    widest = max(float(((atlas - probe[:, None]) ** 2).sum(axis=0).min()) for probe in probes.T)
    bounds = np.where(whole[:, None], [-np.inf, np.inf], position)
    return Atlas(np.ascontiguousarray(postures[:, :ATLAS_SIZE]), atlas, bounds, WIDER**2 * widest)


def _halton(prime: int, size: int) -> Array:
    """Return the Halton sequence (size,) of a prime: the digits of each number, mirrored at the point."""
    numbers, values, share = np.arange(1, size + 1), np.zeros(size), 1.0
    while numbers.any():
        share /= prime
        values += share * (numbers % prime)
        numbers //= prime
    return values
