"""The dissertation's own posture and joint speeds, for comparison: (4.62)-(4.65) as printed. The robot uses `ik.posture_search` instead.

The posture is the one that Newton's method finds from a seed. The joint speeds are a weighted pseudo-inverse, with joint 7 still.
"""

from __future__ import annotations

import numpy as np
from tt_core.states import Array, RacketState

from .ik.newton import newton
from .model import ArmModel

JOINTS = 7  # of the arm that it is for
WEIGHTS = np.array([1.0, 0.6, 2.0, 2.0, 2.0 * np.pi, 2.0 * np.pi])  # the diagonal of W^-1, (4.65)


def posture(model: ArmModel, racket: RacketState, seed: Array) -> Array | None:
    """Find the posture by Newton's method, (4.62)-(4.63).

    Args:
        model: The arm.
        racket: As wanted.
        seed: (7,) rad, where the search starts.

    Returns:
        (7,) rad, or None if it does not converge.
    """
    found = newton(racket.position.copy(), racket.normal, np.array(seed), model.chain)
    return found.q if found.converged else None


def joint_speeds(model: ArmModel, q: Array, velocity: Array) -> Array:
    """Compute the joint speeds by the weighted pseudo-inverse, (4.64)-(4.65). They may be beyond the limits.

    Args:
        model: The arm.
        q: (7,) rad, the posture.
        velocity: (3,) m/s of the face centre in `table`.

    Returns:
        (7,) rad/s.
    """
    rows = model.jacobian(q)[:3, :6]
    weighted = rows * WEIGHTS
    return np.append(weighted.T @ np.linalg.solve(weighted @ rows.T, velocity), 0.0)
