"""What a path asks of the motors, by inverse dynamics (pinocchio, recursive Newton-Euler)."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from tt_core.states import Array

from .model import ArmModel
from .motion import evaluate


def torque_shares(model: ArmModel, end: float, step: float, knots: Array, coefficients: Array) -> Array:
    """(7,): the largest share of each joint's rated torque, every `step` (s) until `end` (s) of a path of polynomials, see `motion`.

    Inertias are those of cylinders and the gears are assumed, see the URDF; friction and rotors are left out.
    """
    q, qdot, qddot, most = np.empty(7), np.empty(7), np.empty(7), np.zeros(7)
    data = model.pinocchio.createData()
    for t in np.append(np.arange(0.0, end, step), end):
        evaluate(t, knots, coefficients, q, qdot, qddot)
        most = np.maximum(most, np.abs(pin.rnea(model.pinocchio, data, q, qdot, qddot)))
    return most / model.torque_limits
