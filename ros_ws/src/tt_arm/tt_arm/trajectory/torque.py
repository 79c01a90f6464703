"""Which torques a path asks of the motors."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.states import Array

from ..dynamics import Links, joint_torques
from ..model import ArmModel
from .profiles import evaluate


@njit(cache=True, nogil=True)
def largest_torques(end: float, step: float, knots: Array, coefficients: Array, links: Links) -> Array:
    """Return the largest torque of each joint on a path, (7,) N m, both ways; see `torque_shares`."""
    q, qdot, qddot, torque, most, wrenches = np.empty(7), np.empty(7), np.empty(7), np.empty(7), np.zeros(7), np.empty((7, 6))
    for n in range(math.ceil(end / step) + 1):
        evaluate(min(end, n * step), knots, coefficients, q, qdot, qddot)
        joint_torques(q, qdot, qddot, links, torque, wrenches)
        for i in range(7):
            most[i] = max(most[i], abs(torque[i]))
    return most


def torque_shares(model: ArmModel, end: float, step: float, knots: Array, coefficients: Array) -> Array:
    """Compute the largest share of the rated torque that a path needs.

    Inertias are those of cylinders and the gears are assumed, see the URDF. Friction and rotors are left out.

    Args:
        model: The arm.
        end: s, until which the path is sampled.
        step: s between two samples.
        knots: (7, n) of the path, see `profiles`.
        coefficients: (7, n, 6) of the path.

    Returns:
        (7,), the largest share of each joint.
    """
    return np.asarray(largest_torques(end, step, knots, coefficients, model.links) / model.limits.effort)
