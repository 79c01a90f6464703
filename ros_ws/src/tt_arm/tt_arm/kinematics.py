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
def _turn(rotation: Array, axis: int, c: float, s: float) -> None:
    """rotation @ Rz (axis 2) or rotation @ Ry (axis 1) by the angle with cosine c and sine s, in place."""
    i, j = (0, 1) if axis == 2 else (2, 0)
    for k in range(3):
        a, b = rotation[k, i], rotation[k, j]
        rotation[k, i] = c * a + s * b
        rotation[k, j] = c * b - s * a


@njit(cache=True)
def forward_into(q: Array, chain: Chain, point: Array, rotation: Array, jacobian: Array) -> None:
    """Fills what `forward` returns."""
    base_rotation, base_position, lengths, mount, beyond = chain
    for k in range(3):
        point[k] = base_position[k]
        for j in range(3):
            rotation[k, j] = base_rotation[k, j]
    for i in range(7):
        axis = 2 - i % 2
        if axis == 1:  # l_b, l_s, l_e lead to shoulder, elbow, wrist
            for k in range(3):
                point[k] += lengths[i // 2] * rotation[k, 2]
        for k in range(3):  # pivots for now
            jacobian[k, i], jacobian[3 + k, i] = point[k], rotation[k, axis]
        _turn(rotation, axis, math.cos(q[i]), math.sin(q[i]))
    for k in range(3):
        a, b, c = rotation[k, 0], rotation[k, 1], rotation[k, 2]
        point[k] += a * beyond[0] + b * beyond[1] + c * (lengths[3] + beyond[2])
        for j in range(3):
            rotation[k, j] = a * mount[0, j] + b * mount[1, j] + c * mount[2, j]
    for i in range(7):
        x, y, z = point[0] - jacobian[0, i], point[1] - jacobian[1, i], point[2] - jacobian[2, i]
        jacobian[0, i] = jacobian[4, i] * z - jacobian[5, i] * y
        jacobian[1, i] = jacobian[5, i] * x - jacobian[3, i] * z
        jacobian[2, i] = jacobian[3, i] * y - jacobian[4, i] * x


@njit(cache=True)
def forward(q: Array, chain: Chain) -> tuple[Array, Array, Array]:
    """Racket position (3,), rotation (3, 3) and Jacobian (6, 7) of (velocity of the face centre, angular velocity), for q (7,) rad."""
    point, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, 7))
    forward_into(q, chain, point, rotation, jacobian)
    return point, rotation, jacobian


@njit(cache=True)
def skeleton(q: Array, chain: Chain, points: Array, rotation: Array) -> float:
    """Fills points (4, 3) of shoulder, elbow, wrist and face centre and the racket's rotation (3, 3), for q (7,) rad; returns the cosine
    of the angle between forearm and hand."""
    base_rotation, base_position, lengths, mount, beyond = chain
    x, y, z = base_position[0], base_position[1], base_position[2]
    for k in range(3):
        for j in range(3):
            rotation[k, j] = base_rotation[k, j]
    fx = fy = fz = 0.0
    for i in range(7):
        if i % 2:
            fx, fy, fz, n = rotation[0, 2], rotation[1, 2], rotation[2, 2], i // 2
            x, y, z = x + lengths[n] * fx, y + lengths[n] * fy, z + lengths[n] * fz
            points[n, 0], points[n, 1], points[n, 2] = x, y, z
        _turn(rotation, 2 - i % 2, math.cos(q[i]), math.sin(q[i]))
    folded = fx * rotation[0, 2] + fy * rotation[1, 2] + fz * rotation[2, 2]
    for k in range(3):
        a, b, c = rotation[k, 0], rotation[k, 1], rotation[k, 2]
        points[3, k] = points[2, k] + a * beyond[0] + b * beyond[1] + c * (lengths[3] + beyond[2])
        for j in range(3):
            rotation[k, j] = a * mount[0, j] + b * mount[1, j] + c * mount[2, j]
    return folded


@njit(cache=True)
def _aim(rotation: Array, x: float, y: float, z: float, q: Array, i: int) -> None:
    """q[i], q[i + 1] >= 0 that bring the z axis of `rotation` along the unit (x, y, z) by Rz Ry; `rotation` follows."""
    a = rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z
    b = rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z
    c = rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z
    across = math.sqrt(a * a + b * b)
    q[i], q[i + 1] = 0.0, math.atan2(across, c)
    if across > 0.0:  # it is 0 for a and b below 1e-162, too
        q[i] = math.atan2(b, a)
        _turn(rotation, 2, a / across, b / across)
    _turn(rotation, 1, c, across)


@njit(cache=True)
def inverse(position: Array, rotation: Array, swivel: float, chain: Chain, q: Array) -> bool:
    """Fills q (7,) for a racket pose and an elbow angle; False when out of reach.

    swivel: rad, of the elbow about the line from shoulder to wrist. The answer has q2, q4, q6 >= 0; the other postures with the same
    links in space negate one of these and turn its two neighbours by pi.
    """
    base_rotation, base_position, lengths, mount, beyond = chain
    flange, arm, line = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    upper, lower = lengths[1], lengths[2]
    distance = 0.0
    for k in range(3):
        for j in range(3):
            flange[k, j] = rotation[k, 0] * mount[j, 0] + rotation[k, 1] * mount[j, 1] + rotation[k, 2] * mount[j, 2]
            arm[k, j] = base_rotation[k, j]
        wrist = position[k] - flange[k, 0] * beyond[0] - flange[k, 1] * beyond[1] - flange[k, 2] * (beyond[2] + lengths[3])
        line[k] = wrist - base_position[k] - lengths[0] * arm[k, 2]  # from the shoulder
        distance += line[k] ** 2
    distance = math.sqrt(distance)
    along = (distance**2 + upper**2 - lower**2) / (2.0 * distance)  # to the foot of the elbow's circle
    if abs(along) > upper * (1.0 + 1e-12) or distance < 1e-6:
        return False
    x, y, z = line[0] / distance, line[1] / distance, line[2] / distance
    flat = math.hypot(x, y)
    side, ahead = (-y / flat, x / flat) if flat > 1e-9 else (0.0, 1.0)  # horizontal, square to the line; and with it up is
    radius = math.sqrt(max(0.0, upper**2 - along**2))
    c, s = radius * math.cos(swivel), radius * math.sin(swivel)
    ex = along * x - c * z * ahead + s * side
    ey = along * y + c * z * side + s * ahead
    ez = along * z + c * (x * ahead - y * side)
    _aim(arm, ex / upper, ey / upper, ez / upper, q, 0)
    _aim(arm, (line[0] - ex) / lower, (line[1] - ey) / lower, (line[2] - ez) / lower, q, 2)
    _aim(arm, flange[0, 2], flange[1, 2], flange[2, 2], q, 4)
    a = arm[0, 0] * flange[0, 0] + arm[1, 0] * flange[1, 0] + arm[2, 0] * flange[2, 0]
    b = arm[0, 1] * flange[0, 0] + arm[1, 1] * flange[1, 0] + arm[2, 1] * flange[2, 0]
    q[6] = math.atan2(b, a)
    return True
