"""How far racket and forearm stay from the table."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.constants import TABLE_LENGTH, TABLE_WIDTH
from tt_core.states import Array

from .kinematics import Chain, forward
from .motion import evaluate

THICKNESS = 0.03  # m, of the table top, an assumption
RIM = 0.08  # m, from the face centre to the racket's edge, of the racket in the URDF
FOREARM = 0.06  # m, radius around elbow, wrist and handle, of the links in the URDF
AROUND = 12  # points of the rim


@njit(cache=True)
def from_table(x: float, y: float, z: float) -> float:
    """m, from a point in `table` to the table top; 0 inside it."""
    return math.hypot(math.hypot(max(-x, x - TABLE_LENGTH, 0.0), max(-y, y - TABLE_WIDTH, 0.0)), max(z, -THICKNESS - z, 0.0))


@njit(cache=True)
def clearance(q: Array, chain: Chain) -> float:
    """m, from the table to the racket's rim or, less its radius, the line from elbow over wrist to the handle; not above 0 is a touch."""
    face, rotation, _ = forward(q, chain)
    least = np.inf
    for k in range(AROUND):
        c, s = RIM * math.cos(2.0 * math.pi * k / AROUND), RIM * math.sin(2.0 * math.pi * k / AROUND)
        rim = face + c * rotation[:, 0] + s * rotation[:, 1]
        least = min(least, from_table(rim[0], rim[1], rim[2]))
    flange = rotation @ chain.mount_rotation.T
    wrist = face - flange @ chain.mount_position - chain.lengths[3] * flange[:, 2]
    c, s, c2, s2 = math.cos(q[0]), math.sin(q[0]), math.cos(q[1]), math.sin(q[1])
    shoulder = chain.base_position + chain.lengths[0] * chain.base_rotation[:, 2]
    elbow = shoulder + chain.lengths[1] * (chain.base_rotation @ np.array([c * s2, s * s2, c2]))
    for k in range(9):
        p = elbow + 0.25 * k * (wrist - elbow) if k < 5 else wrist + 0.125 * (k - 4) * (face - wrist)
        least = min(least, from_table(p[0], p[1], p[2]) - FOREARM)
    return least


@njit(cache=True)
def path_clearance(end: float, step: float, knots: Array, coefficients: Array, chain: Chain) -> float:
    """The least clearance (m) every `step` (s) until `end` (s) of a path of polynomials, see `motion`."""
    q, qdot, qddot, least = np.empty(7), np.empty(7), np.empty(7), np.inf
    for k in range(int(end / step) + 2):
        evaluate(min(end, k * step), knots, coefficients, q, qdot, qddot)
        least = min(least, clearance(q, chain))
    return least
