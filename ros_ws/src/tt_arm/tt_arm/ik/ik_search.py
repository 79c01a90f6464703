"""Kernels of the search among all postures for a stroke.

Both freedoms, the racket's turn about its normal and the elbow's angle, give a posture in closed form. Its cost is bounded from below step
by step, what is cheap to know first, and a posture is given up as soon as it cannot be the best.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

from ..kinematics import Chain, forward_into, inverse
from ..trajectory.profiles import fastest, least_time, soonest
from .velocity_allocation import least_shares, least_shares_steady, steady_rows_into

LIMIT_COST = 20.0  # per rad beyond the room kept from a position limit
LATE_COST = 5.0  # for each of the times below that is too short
LATER = (1.0, 1.1, 1.4, 2.0, 3.0, 1e3)  # times the swing time; the last one asks what the joints can do at all
SCATTERED = 173  # the grid is walked in such strides, to meet a good posture early: a prime that is larger than any grid
STARTS = 2  # postures of the grid that are refined
CLOSE = 3.0  # cost above the best of the grid, up to which a posture may still be refined to a better one
STEEP = 8.0  # per rad of the step: a start that costs more than this above the best is given up
MOST_STEPS = 1000  # of one descent, which takes about 30
STEP_LEAST = 0.01  # rad, where the refinement ends
ONES = np.ones(7)
WAYS = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0))


class Scratch(NamedTuple):
    """Memory of a search."""

    turned: Array  # (3, 3)
    point: Array  # (3,)
    jacobian: Array  # (6, 7)
    rows: Array  # (5, 7)
    scaled: Array  # (5, 7)
    middle: Array  # (7,)
    half: Array  # (7,)
    wanted: Array  # (5,)
    shares: Array  # (7,)
    steady: Array  # (7,)
    mixed: Array  # (7,)


@njit(cache=True)
def turning(rows: Array, qdot: Array) -> float:
    """rad/s, of the face normal, for rows (5, 7) of `steady_rows` and qdot (7,) in their unit."""
    x = y = 0.0
    for i in range(7):
        x += rows[3, i] * qdot[i]
        y += rows[4, i] * qdot[i]
    return math.hypot(x, y)


@njit(cache=True)
def _wound(q: float, seed: float, low: float, high: float) -> float:
    """The same angle, at the turn nearest to the seed, or at the next one if only that is within the limits."""
    q += 2.0 * math.pi * round((seed - q) / (2.0 * math.pi))
    if not low <= q <= high:
        for other in (q - 2.0 * math.pi, q + 2.0 * math.pi):
            if low < other < high:
                return other
    return q


@njit(cache=True)
def _wind(q: Array, seed: Array, limits: Array) -> float:
    """The same links in space by other angles, in place: those nearest to the seed; returns the way, s at full speed, inf if all break a
    limit.

    Each bit of the eight branches negates q2, q4 or q6 and turns its neighbours by pi.
    """
    angles, ways = np.empty((7, 2)), np.empty((7, 2))
    for i in range(7):
        for k in range(2):
            angle = (-q[i] if i % 2 else q[i] + math.pi) if k else q[i]
            angle = _wound(angle, seed[i], limits[i, 0], limits[i, 1])
            inside = limits[i, 0] <= angle <= limits[i, 1]
            angles[i, k], ways[i, k] = angle, abs(angle - seed[i]) / limits[i, 2] if inside else math.inf
    nearest, best = math.inf, 0
    for branch in range(8):
        b0, b1, b2 = branch & 1, branch >> 1 & 1, branch >> 2
        far = max(ways[0, b0], ways[1, b0], ways[2, b0 ^ b1], ways[3, b1], ways[4, b1 ^ b2], ways[5, b2], ways[6, b2])
        if far < nearest:
            nearest, best = far, branch
    b0, b1, b2 = best & 1, best >> 1 & 1, best >> 2
    q[0], q[1], q[2], q[3] = angles[0, b0], angles[1, b0], angles[2, b0 ^ b1], angles[3, b1]
    q[4], q[5], q[6] = angles[4, b1 ^ b2], angles[5, b2], angles[6, b2]
    return nearest


@njit(cache=True)
def _beyond(q: Array, qdot: Array, limits: Array, margin: float, acceleration: float, hold: float) -> float:
    """Cost of what lies beyond the room kept from the position limits, to brake in; at once, or after a drive has held its speed for
    `hold` (s)."""
    cost = 0.0
    for i in range(7):
        room = min(qdot[i] ** 2 / (2.0 * acceleration), 0.2 * (limits[i, 1] - limits[i, 0])) + margin
        cost += LIMIT_COST * max(0.0, limits[i, 0] + room - q[i], q[i] - limits[i, 1] + room)
        stop = q[i] + hold * qdot[i] + 0.5 * qdot[i] * abs(qdot[i]) / acceleration
        cost += LIMIT_COST * max(0.0, limits[i, 0] - stop, stop - limits[i, 1])
    return cost


@njit(cache=True)
def _largest(shares: Array) -> float:
    most = 0.0
    for i in range(7):
        most = max(most, abs(shares[i]))
    return most


@njit(cache=True)
def _steadier(rows: Array, wanted: Array, shares: Array, affordable: float, steady: Array) -> bool:
    """Fills the shares (7,) that hold the face as still as `affordable` allows, if any do; the face centre moves alike."""
    if _largest(shares) > affordable or least_shares_steady(rows, wanted, steady) == math.inf:
        return False
    part = 1.0
    for i in range(7):
        step = steady[i] - shares[i]
        if abs(steady[i]) > affordable:
            part = min(part, (math.copysign(affordable, step) - shares[i]) / step)
    for i in range(7):
        steady[i] = shares[i] + part * (steady[i] - shares[i])
    return True


@njit(cache=True)
def _posture(
    turn: float, swivel: float, position: Array, rotation: Array, velocity: Array, seed: Array, limits: Array, weights: Array, chain: Chain,
    bound: float, q: Array, qdot: Array, scratch: Scratch,
) -> float:  # fmt: skip
    """Fills q (7,) and qdot (7,) of the best posture with both freedoms given and returns its cost; inf as soon as the cost is seen to
    reach `bound`.

    seed: (3, 7) q, qdot, and q where it waits. limits: (7, 3) low, high, speed. weights: (6,) swing time, acceleration, affordable,
    turning, margin, return.
    """
    turned, point, jacobian, rows, scaled, middle, half, wanted, shares, steady, mixed = scratch
    c, s = math.cos(turn), math.sin(turn)
    for k in range(3):
        turned[k, 0], turned[k, 1] = c * rotation[k, 0] + s * rotation[k, 1], c * rotation[k, 1] - s * rotation[k, 0]
        turned[k, 2] = rotation[k, 2]
    if not inverse(position, turned, swivel, chain, q):
        return math.inf
    nearest = _wind(q, seed[0], limits)
    if nearest == math.inf:
        return math.inf
    acceleration, waits = weights[1], seed[2]
    qdot[:] = 0.0
    least, late, back = _beyond(q, qdot, limits, weights[4], acceleration, weights[6]), 0, 0.0
    while weights[0] * LATER[late] < nearest:
        late += 1
    for i in range(7):
        back = max(back, soonest(abs(waits[i] - q[i]), limits[i, 2], acceleration))
    if least + LATE_COST * late + weights[5] * back >= bound:
        return math.inf
    known = False
    while True:  # until the joint speeds that are possible at the strike give the velocity
        time, in_time, back = weights[0] * LATER[late], True, 0.0
        for i in range(7):
            high = fastest(time, q[i] - seed[0, i], seed[1, i], limits[i, 2], acceleration)
            low = -fastest(time, seed[0, i] - q[i], -seed[1, i], limits[i, 2], acceleration)
            middle[i], half[i], in_time = 0.5 * (high + low), 0.5 * (high - low), in_time and high > low
            way = waits[i] - q[i]
            ideal = math.copysign(min(limits[i, 2], math.sqrt(2.0 * acceleration * abs(way))), way)
            back = max(back, least_time(way, max(low, min(high, ideal)), 0.0, limits[i, 2], acceleration))
        last = late + 1 == len(LATER)
        if not in_time or last:
            back = 0.0
        if least + LATE_COST * late + weights[5] * back >= bound:
            return math.inf
        if in_time:
            if not known:
                forward_into(q, chain, point, turned, jacobian)
                steady_rows_into(jacobian, turned, ONES, rows)
                known = True
            for k in range(5):
                wanted[k] = velocity[k] if k < 3 else 0.0
                for i in range(7):
                    wanted[k] -= rows[k, i] * middle[i]
                    scaled[k, i] = rows[k, i] * half[i]
            if least_shares(scaled, wanted, shares, math.inf if last else 1.0) < math.inf:
                break
        late += 1
        if last:
            return math.inf
    least += LATE_COST * late + weights[5] * back
    if least + _largest(shares) >= bound:
        return math.inf

    best = math.inf
    for hold in (False, True):
        if hold and (least + _largest(shares) >= min(best, bound) or not _steadier(scaled, wanted, shares, weights[2], steady)):
            break
        given, back = steady if hold else shares, 0.0
        for i in range(7):
            mixed[i] = middle[i] + half[i] * given[i]
            back = max(back, least_time(seed[2, i] - q[i], mixed[i], 0.0, limits[i, 2], acceleration))
        for k in range(3):
            missing = velocity[k]
            for i in range(7):
                missing -= rows[k, i] * mixed[i]
            if abs(missing) > 1e-6:  # singular
                return best
        cost = LATE_COST * late + weights[5] * back + _largest(given) + weights[3] * turning(rows, mixed)
        cost += _beyond(q, mixed, limits, weights[4], acceleration, weights[6])
        if cost < best:
            best = cost
            qdot[:] = mixed
    return best


@njit(cache=True, nogil=True)
def search(
    position: Array, rotation: Array, velocity: Array, seed: Array, limits: Array, weights: Array, grid: int, chain: Chain
) -> tuple[float, Array, Array]:
    """Cost, q (7,), qdot (7,) of the best posture: a grid over both freedoms, then a compass search from its best points."""
    costs, least, step = np.empty((grid, grid)), math.inf, 2.0 * math.pi / grid
    scratch = Scratch(
        np.empty((3, 3)), np.empty(3), np.empty((6, 7)), np.empty((5, 7)), np.empty((5, 7)),
        np.empty(7), np.empty(7), np.empty(5), np.empty(7), np.empty(7), np.empty(7),
    )  # fmt: skip
    q, qdot, here_q, here_qdot, best_q, best_qdot = np.empty((6, 7))
    for n in range(grid * grid):
        at = SCATTERED * n % (grid * grid)
        i, j = at // grid, at % grid
        costs[i, j] = _posture(
            i * step, j * step, position, rotation, velocity, seed, limits, weights, chain, least + CLOSE, q, qdot, scratch
        )
        if costs[i, j] < least:
            least = costs[i, j]
    best, best_turn, best_swivel = math.inf, math.inf, math.inf
    best_q[:], best_qdot[:] = seed[0], 0.0
    for _ in range(STARTS):
        at = int(np.argmin(costs))
        i, j = at // grid, at % grid
        if costs[i, j] == math.inf:
            break
        turn, swivel, size = i * step, j * step, 0.5 * step
        here = _posture(turn, swivel, position, rotation, velocity, seed, limits, weights, chain, math.inf, here_q, here_qdot, scratch)
        for di in range(-1, 2):
            for dj in range(-1, 2):
                costs[(i + di) % grid, (j + dj) % grid] = math.inf
        for _ in range(MOST_STEPS):
            if size <= STEP_LEAST:
                break
            moved = False
            for du, dv in WAYS:
                u, v = turn + du * size, swivel + dv * size
                cost = _posture(u, v, position, rotation, velocity, seed, limits, weights, chain, here, q, qdot, scratch)
                if cost < here:
                    here, turn, swivel, moved = cost, u, v, True
                    here_q[:], here_qdot[:] = q, qdot
                    break
            if not moved:
                size *= 0.5
                same = max(abs(turn - best_turn), abs(swivel - best_swivel)) < 2.0 * size  # as where the start before has ended
                if same or here > best + STEEP * size:
                    break
        if here < best:
            best, best_turn, best_swivel = here, turn, swivel
            best_q[:], best_qdot[:] = here_q, here_qdot
    return best, best_q, best_qdot
