"""Which torques a path asks of the motors."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.states import Array

from ..dynamics import Links, joint_torques
from ..kinematics import Chain
from ..model import ArmModel
from .profiles import evaluate


@njit(cache=True, nogil=True)
def largest_torques(end: float, step: float, knots: Array, coefficients: Array, chain: Chain, links: Links) -> Array:
    """Return the largest torque of each joint on a path, (n,) N m or N, both ways; see `torque_shares`."""
    n = len(knots)
    q, qdot, qddot, torque, most, wrenches = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.zeros(n), np.empty((n, 6))
    for k in range(math.ceil(end / step) + 1):
        evaluate(min(end, k * step), knots, coefficients, q, qdot, qddot)
        joint_torques(q, qdot, qddot, chain, links, torque, wrenches)
        for i in range(n):
            most[i] = max(most[i], abs(torque[i]))
    return most


def torque_shares(model: ArmModel, end: float, step: float, knots: Array, coefficients: Array) -> Array:
    """Compute the largest share of the rated torque that a path needs.

    Inertias are those of cylinders and the gears are assumed, see the URDF. Friction and rotors are left out.

    Args:
        model: The arm.
        end: s, until which the path is sampled.
        step: s between two samples.
        knots: (joints, n) of the path, see `profiles`.
        coefficients: (joints, n, 6) of the path.

    Returns:
        (n,), the largest share of each joint.
    """
    return np.asarray(largest_torques(end, step, knots, coefficients, model.chain, model.links) / model.limits.effort)
