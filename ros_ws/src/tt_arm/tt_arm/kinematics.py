"""Kernels of the arm's geometry: joints to racket, and back in closed form.

The PA10 is a spherical shoulder, an elbow and a spherical wrist: R = Rz(q1) Ry(q2) Rz(q3) Ry(q4) Rz(q5) Ry(q6) Rz(q7) (dissertation
(B.1)-(B.8)). Kernels do not validate. Vectors are in `table` unless said otherwise.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array


class Chain(NamedTuple):
    """The constants of the geometry.

    base_rotation (3, 3), base_position (3,): base_link in `table`. lengths (4,): m, l_b, l_s, l_e, l_w of Appendix B.
    mount_rotation (3, 3), mount_position (3,): racket in the flange.
    """

    base_rotation: Array
    base_position: Array
    lengths: Array
    mount_rotation: Array
    mount_position: Array


@njit(cache=True)
def _turn(rotation: Array, axis: int, angle: float) -> None:
    """rotation @ Rz(angle) (axis 2) or rotation @ Ry(angle) (axis 1), in place."""
    c, s = math.cos(angle), math.sin(angle)
    i, j = (0, 1) if axis == 2 else (2, 0)
    for k in range(3):
        a, b = rotation[k, i], rotation[k, j]
        rotation[k, i] = c * a + s * b
        rotation[k, j] = c * b - s * a


@njit(cache=True)
def forward(q: Array, chain: Chain) -> tuple[Array, Array, Array]:
    """Racket position (3,), rotation (3, 3) and Jacobian (6, 7) of (velocity of the face centre, angular velocity), for q (7,) rad."""
    rotation, point = chain.base_rotation.copy(), chain.base_position.copy()
    axes, pivots = np.empty((7, 3)), np.empty((7, 3))
    for i in range(7):
        axis = 2 - i % 2
        if axis == 1:  # l_b, l_s, l_e lead to shoulder, elbow, wrist
            for k in range(3):
                point[k] += chain.lengths[i // 2] * rotation[k, 2]
        axes[i] = rotation[:, axis]
        pivots[i] = point
        _turn(rotation, axis, q[i])
    beyond = chain.mount_position
    for k in range(3):
        reach = chain.lengths[3] + beyond[2]
        point[k] += rotation[k, 0] * beyond[0] + rotation[k, 1] * beyond[1] + rotation[k, 2] * reach
    jacobian = np.empty((6, 7))
    for i in range(7):
        x, y, z = point[0] - pivots[i, 0], point[1] - pivots[i, 1], point[2] - pivots[i, 2]
        jacobian[0, i] = axes[i, 1] * z - axes[i, 2] * y
        jacobian[1, i] = axes[i, 2] * x - axes[i, 0] * z
        jacobian[2, i] = axes[i, 0] * y - axes[i, 1] * x
        jacobian[3:, i] = axes[i]
    return point, rotation @ chain.mount_rotation, jacobian


@njit(cache=True)
def _aim(rotation: Array, direction: Array, q: Array, i: int) -> None:
    """q[i], q[i + 1] >= 0 that bring the z axis of `rotation` along the unit `direction` by Rz Ry; `rotation` follows."""
    x = rotation[0, 0] * direction[0] + rotation[1, 0] * direction[1] + rotation[2, 0] * direction[2]
    y = rotation[0, 1] * direction[0] + rotation[1, 1] * direction[1] + rotation[2, 1] * direction[2]
    z = rotation[0, 2] * direction[0] + rotation[1, 2] * direction[1] + rotation[2, 2] * direction[2]
    q[i], q[i + 1] = math.atan2(y, x), math.atan2(math.hypot(x, y), z)
    _turn(rotation, 2, q[i])
    _turn(rotation, 1, q[i + 1])


@njit(cache=True)
def inverse(position: Array, rotation: Array, swivel: float, chain: Chain, q: Array) -> bool:
    """Fills q (7,) for a racket pose and an elbow angle; False when out of reach.

    swivel: rad, of the elbow about the line from shoulder to wrist. The answer has q2, q4, q6 >= 0; the other postures with the same
    links in space negate one of these and turn its two neighbours by pi.
    """
    flange = rotation @ chain.mount_rotation.T
    beyond = chain.mount_position.copy()
    beyond[2] += chain.lengths[3]
    arm = chain.base_rotation.copy()
    line = position - flange @ beyond - chain.base_position - chain.lengths[0] * arm[:, 2]  # shoulder to wrist
    upper, lower = chain.lengths[1], chain.lengths[2]
    distance = math.sqrt(line[0] ** 2 + line[1] ** 2 + line[2] ** 2)
    along = (distance**2 + upper**2 - lower**2) / (2.0 * distance)  # to the foot of the elbow's circle
    if abs(along) > upper * (1.0 + 1e-12) or distance < 1e-6:
        return False
    line /= distance
    side = np.array([-line[1], line[0], 0.0])  # horizontal, square to the line
    length = math.hypot(side[0], side[1])
    if length < 1e-9:
        side[0], side[1], length = 0.0, 1.0, 1.0
    side /= length
    up = np.array([line[1] * side[2] - line[2] * side[1], line[2] * side[0] - line[0] * side[2], line[0] * side[1] - line[1] * side[0]])
    radius = math.sqrt(max(0.0, upper**2 - along**2))
    elbow = along * line + radius * (math.cos(swivel) * up + math.sin(swivel) * side)
    _aim(arm, elbow / upper, q, 0)
    _aim(arm, (distance * line - elbow) / lower, q, 2)
    _aim(arm, flange[:, 2].copy(), q, 4)
    x = arm[0, 0] * flange[0, 0] + arm[1, 0] * flange[1, 0] + arm[2, 0] * flange[2, 0]
    y = arm[0, 1] * flange[0, 0] + arm[1, 1] * flange[1, 0] + arm[2, 1] * flange[2, 0]
    q[6] = math.atan2(y, x)
    return True
