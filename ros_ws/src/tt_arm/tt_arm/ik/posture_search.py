"""Search for the best posture (joint positions) of any arm for a stroke.

Position and normal of the racket's face are five conditions, so an arm with n joints has n - 5 freedoms. The search uses the atlas of the
arm: many precomputed postures within its limits, with the position and normal of the face in each. Newton's method changes those postures
whose face is nearest to the wanted one until they have the wanted face. The search then takes the postures with the lowest
cost and refines them along the freedoms: it makes a step in the null space of the five conditions and applies the method again.
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
from .newton import NewtonScratch, Target, converge_within_limits, newton_scratch
from .posture_cost import (
    REFINED_EXCESS,
    REFINED_POSTURES,
    STEEPEST_COST,
    BestPosture,
    CostScratch,
    PostureQuestion,
    PostureTask,
    cost_of_joints,
    cost_scratch,
    joint_tasks,
    nearest_turn,
    posture_weights,
    time_to,
)

ATLAS_SIZE = 20_000  # number of postures; it takes 5 ms to compute them
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19)  # bases of the Halton sequences of the joints
PROBES, WIDER = 200, 2.0  # test postures for the distance of a reachable face from the atlas; factor on the largest one
NORMAL_SCALE = 0.5  # m; a difference of 1 between two unit normals counts as this distance
SEED_STEPS, REFINE_STEPS = 20, 6  # largest numbers of Newton steps for a posture of the atlas, and in the refinement
MOST_POSTURE_STEPS = 300  # largest number of steps of one refinement, which takes about 30
FIRST_STEP, LAST_STEP = 0.25, 0.01  # rad, first and last step size of a refinement
SAME_POSTURE = 0.05  # rad or m; two postures that differ by less than this in every joint are refined to the same one
INDEPENDENT = 1e-3  # least squared length of a unit vector's part in the null space with which it gives another direction


class Atlas(NamedTuple):
    """Precomputed postures all over the joint limits of an arm, with the position and normal of the racket's face in each.

    Attributes:
        postures: (n, size) rad or m, joint positions; one row for each joint, for speed.
        faces: (6, size) position (m) of the face centre, and NORMAL_SCALE times the unit normal of the face, in each posture, in `table`.
        bounds: (n, 2) rad or m, position limits for Newton's method; infinite for a joint that can make whole turns.
        widest: m^2; a face whose squared distance to the nearest one of the atlas is larger than this is out of reach.
    """

    postures: Array
    faces: Array
    bounds: Array
    widest: float


@njit(cache=True)
def fill_faces(postures: Array, chain: Chain) -> Array:
    """Compute positions and normals of the racket's face in many postures.

    Args:
        postures: (n, size) rad or m, joint positions.
        chain: Geometry of the arm.

    Returns:
        (6, size) position (m) of the face centre and NORMAL_SCALE times the unit normal, as in `Atlas.faces`.
    """
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
    """Fill `distances` with the squared distance (m^2) of each face of the atlas to the wanted face."""
    x, y, z = target.position[0], target.position[1], target.position[2]
    u, v, w = NORMAL_SCALE * target.normal[0], NORMAL_SCALE * target.normal[1], NORMAL_SCALE * target.normal[2]
    for m in range(faces.shape[1]):
        distances[m] = (
            (faces[0, m] - x) ** 2 + (faces[1, m] - y) ** 2 + (faces[2, m] - z) ** 2
            + (faces[3, m] - u) ** 2 + (faces[4, m] - v) ** 2 + (faces[5, m] - w) ** 2
        )  # fmt: skip


@njit(cache=True)
def _nearest(distances: Array, count: int) -> npt.NDArray[np.int64]:
    """Return the indices (count,) of the smallest distances, in increasing order."""
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
    """Fill directions (3, n) with an orthonormal basis of the null space of rows (5, n); return the number of vectors, at most three."""
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
    """Append the normalised part of a vector that is orthogonal to the first `count` rows of basis.

    Returns:
        1; or 0 if this part is not longer than `least`, so that nothing is appended.
    """
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
    """Data that all steps of a posture search use.

    Attributes:
        target: Wanted position and normal of the face.
        task: Wanted velocity, joints and weights of the cost.
        atlas: Precomputed postures of the arm.
        chain: Geometry of the arm.
        newton: CostScratch memory of Newton's method.
        scratch: CostScratch memory of the cost.
    """

    target: Target
    task: PostureTask
    atlas: Atlas
    chain: Chain
    newton: NewtonScratch
    scratch: CostScratch


@njit(cache=True)
def _converged_cost(search: Search, steps: int, bound: float, q: Array, qdot: Array) -> float:
    """Change q (n,) in place by Newton's method, fill the joint speeds qdot (n,), and return the cost; see `cost_of_joints`."""
    joints, bounds = search.task.joints, search.atlas.bounds
    if not converge_within_limits(search.target, bounds, steps, search.chain, q, search.scratch.rows, search.newton):
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
    """Refine a posture in place by a compass search along the freedoms, with steps that are halved when none is better.

    Args:
        search: Data of the search.
        cost: Cost of the posture.
        best: Cost of the best refined posture so far; the search ends when it cannot become better than this.
        q: (n,) rad or m, joint positions, changed in place.
        qdot: (n,) rad/s or m/s, joint speeds, changed in place.

    Returns:
        The cost of the refined posture.
    """
    n = len(q)
    trial, trial_qdot, directions = np.empty(n), np.empty(n), np.zeros((3, n))
    size, fresh, count = FIRST_STEP, False, 0
    for _ in range(MOST_POSTURE_STEPS):
        if size <= LAST_STEP:
            break
        if not fresh:
            trial[:] = q
            converge_within_limits(
                search.target, search.atlas.bounds, REFINE_STEPS, search.chain, trial, search.scratch.rows, search.newton
            )
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
            now = _converged_cost(search, REFINE_STEPS, cost, trial, trial_qdot)
            if now < cost:
                cost, moved, fresh = now, True, False
                q[:], qdot[:] = trial, trial_qdot
                break
        if not moved:
            size *= 0.5
            if cost > best + STEEPEST_COST * size:
                break
    return cost


@njit(cache=True, nogil=True)
def search_postures(
    target: Target, velocity: Array, start: Array, limits: JointBounds, weights: Array, count: int, atlas: Atlas, chain: Chain
) -> BestPosture:
    """Search for the posture and joint speeds with the lowest cost among all postures of an arm.

    Args:
        target: Wanted position and normal of the racket's face.
        velocity: (3,) m/s in `table`, wanted velocity of the face centre.
        start: (3, n) joint positions and joint speeds from which the arm starts, and joint positions of the waiting posture.
        limits: (n,) limits of the joints.
        weights: (6,) the fields of `PostureWeights`.
        count: Number of postures of the atlas from which the search starts.
        atlas: Precomputed postures of the arm.
        chain: Geometry of the arm.

    Returns:
        The best posture; its cost is inf if none was found.
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
        costs[m] = _converged_cost(here, SEED_STEPS, least + REFINED_EXCESS, found[m], speeds[m])
        least = min(least, costs[m])
    for _ in range(REFINED_POSTURES):
        m = int(np.argmin(costs))
        if costs[m] == math.inf:
            break
        q, qdot = found[m].copy(), speeds[m].copy()
        for k in range(count + 2):
            if np.abs(found[k] - q).max() < SAME_POSTURE:
                costs[k] = math.inf if k != m else costs[k]
        cost = _descend(here, costs[m], best.cost, q, qdot)
        costs[m] = math.inf
        if cost < best.cost:
            best = BestPosture(cost, q, qdot)
    return best


@njit(cache=True, nogil=True)
def any_posture(target: Target, seed: Array, limits: JointBounds, count: int, atlas: Atlas, chain: Chain, q: Array) -> bool:
    """Find any posture within the joint limits that has a wanted position and normal of the racket's face.

    Newton's method starts from the seed, and then from the postures of the atlas whose face is nearest to the wanted one, until it finds a
    posture within the limits.

    Args:
        target: Wanted position and normal of the face.
        seed: (n,) rad or m, present joint positions.
        limits: (n,) limits of the joints.
        count: Largest number of postures of the atlas that are tried.
        atlas: Precomputed postures of the arm.
        chain: Geometry of the arm.
        q: (n,) rad or m, output: filled with the posture.

    Returns:
        Whether a posture was found. If not, the content of `q` has no meaning.
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
        if not converge_within_limits(target, atlas.bounds, SEED_STEPS, chain, q, rows, scratch):
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
    """Compute the atlas of an arm: ATLAS_SIZE postures that are distributed evenly over the joint limits by a Halton sequence.

    Args:
        chain: Geometry of the arm.
        position: (n, 2) rad or m, position limits of the joints.
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
    """Return the Halton sequence (size,) of a prime: numbers between 0 and 1 whose digits are those of 1, 2, 3, ... in reverse order."""
    numbers, values, share = np.arange(1, size + 1), np.zeros(size), 1.0
    while numbers.any():
        share /= prime
        values += share * (numbers % prime)
        numbers //= prime
    return values
