"""Joint torques that a path needs."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.states import Array

from ..dynamics import Links, joint_torques
from ..kinematics import Chain
from ..model import ArmModel
from .profiles import evaluate_path


@njit(cache=True, nogil=True)
def largest_torques(end: float, step: float, knots: Array, coefficients: Array, chain: Chain, links: Links) -> Array:
    """Return the largest absolute torque of each joint on a path, (n,) N m, or N for a linear joint.

    Args:
        end: s, time from the start of the path up to which it is sampled.
        step: s between two samples.
        knots: (joints, n) s, starts of the polynomials of the path, see `profiles`.
        coefficients: (joints, n, 6) polynomials of the path.
        chain: Geometry of the arm.
        links: Masses and inertias of the links.
    """
    n = len(knots)
    q, qdot, qddot, torque, most, wrenches = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.zeros(n), np.empty((n, 6))
    for k in range(math.ceil(end / step) + 1):
        evaluate_path(min(end, k * step), knots, coefficients, q, qdot, qddot)
        joint_torques(q, qdot, qddot, chain, links, torque, wrenches)
        for i in range(n):
            most[i] = max(most[i], abs(torque[i]))
    return most


def torque_shares(model: ArmModel, end: float, step: float, knots: Array, coefficients: Array) -> Array:
    """Compute the largest share of its rated torque that each joint needs on a path.

    Friction and the inertia of the rotors are neglected. The PA10's inertias (solid cylinders) and gear ratio are assumed, see its URDF.

    Args:
        model: The arm.
        end: s, time from the start of the path up to which it is sampled.
        step: s between two samples.
        knots: (joints, n) s, starts of the polynomials of the path, see `profiles`.
        coefficients: (joints, n, 6) polynomials of the path.

    Returns:
        (n,) largest torque of each joint divided by its rated torque.
    """
    return np.asarray(largest_torques(end, step, knots, coefficients, model.chain, model.links) / model.limits.effort)
