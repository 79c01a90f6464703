"""The dissertation's own posture and joint speeds, for comparison: (4.62)-(4.65) as printed. The robot uses `ik.posture_search` instead.

The posture is the one that Newton's method finds from a seed. The joint speeds come from a weighted pseudo-inverse, with joint 7 at rest.
"""

from __future__ import annotations

import numpy as np
from tt_core.states import Array, RacketState

from .ik.newton import newton
from .model import ArmModel

JOINTS = 7  # number of joints of the arm for which it is
WEIGHTS = np.array([1.0, 0.6, 2.0, 2.0, 2.0 * np.pi, 2.0 * np.pi])  # the diagonal of W^-1, (4.65)


def posture(model: ArmModel, racket: RacketState, seed: Array) -> Array | None:
    """Find a posture with the wanted racket position and normal by Newton's method, (4.62)-(4.63) of the dissertation.

    Args:
        model: Arm with seven joints.
        racket: Wanted racket state.
        seed: (7,) rad, posture from which the iteration starts.

    Returns:
        (7,) rad joint positions, or None if the iteration does not converge.
    """
    found = newton(racket.position.copy(), racket.normal, np.array(seed), model.chain)
    return found.q if found.converged else None


def joint_speeds(model: ArmModel, q: Array, velocity: Array) -> Array:
    """Compute joint speeds for a racket velocity by the weighted pseudo-inverse, (4.64)-(4.65) of the dissertation.

    Args:
        model: Arm with seven joints.
        q: (7,) rad, joint positions.
        velocity: (3,) m/s in `table`, wanted velocity of the racket's face centre.

    Returns:
        (7,) rad/s joint speeds, which may exceed the limits; that of joint 7 is 0.
    """
    rows = model.jacobian(q)[:3, :6]
    weighted = rows * WEIGHTS
    return np.append(weighted.T @ np.linalg.solve(weighted @ rows.T, velocity), 0.0)
