"""Kernels of the arm's geometry: from joint angles to the racket, and back in closed form.

The PA10 has a spherical shoulder, an elbow and a spherical wrist. Its rotation is
R = Rz(q1) Ry(q2) Rz(q3) Ry(q4) Rz(q5) Ry(q6) Rz(q7), dissertation (B.1)-(B.8).
The kernels do not check their arguments. Vectors are in the frame `table` unless said otherwise.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array


class Chain(NamedTuple):
    """The constants of the arm's geometry.

    Attributes:
        base_rotation: (3, 3) base_link to table.
        base_position: (3,) m, base_link in table.
        lengths: (4,) m, l_b, l_s, l_e, l_w of Appendix B: base to shoulder, to elbow, to wrist, to flange.
        mount_rotation: (3, 3) racket to flange.
        mount_position: (3,) m, face centre in the flange's frame.
        radii: (4,) m, of the bodies; read it with `collision_radii`.
    """

    base_rotation: Array
    base_position: Array
    lengths: Array
    mount_rotation: Array
    mount_position: Array
    radii: Array


class CollisionRadii(NamedTuple):
    """Radii (m) of the bodies that must not touch anything, from the collision elements of the URDF."""

    racket: float
    forearm: float  # elbow to face centre
    upper_arm: float  # shoulder to elbow
    pedestal: float  # floor to shoulder


@njit(cache=True)
def collision_radii(chain: Chain) -> CollisionRadii:
    """Return `chain.radii` by name. `Chain` holds an array, because a nested tuple takes longer to pass from Python."""
    radii = chain.radii
    return CollisionRadii(radii[0], radii[1], radii[2], radii[3])


@njit(cache=True)
def _rotate(rotation: Array, axis: int, c: float, s: float) -> None:
    """Multiply `rotation` (3, 3) in place from the right by Rz (axis 2) or Ry (axis 1) of the angle with cosine c and sine s."""
    i, j = (0, 1) if axis == 2 else (2, 0)
    for k in range(3):
        a, b = rotation[k, i], rotation[k, j]
        rotation[k, i] = c * a + s * b
        rotation[k, j] = c * b - s * a


@njit(cache=True)
def _mount_racket(rotation: Array, wrist: Array, mount: Array, beyond: Array, hand: float, point: Array) -> None:
    """Turn `rotation` (3, 3) of the flange into that of the racket, in place; fill point (3,) m with the face centre.

    mount and beyond are the rotation and position of `Chain`, hand is the length (m) from the wrist to the flange.
    """
    for k in range(3):
        a, b, c = rotation[k, 0], rotation[k, 1], rotation[k, 2]
        point[k] = wrist[k] + (a * beyond[0] + b * beyond[1] + c * (hand + beyond[2]))
        for j in range(3):
            rotation[k, j] = a * mount[0, j] + b * mount[1, j] + c * mount[2, j]


@njit(cache=True)
def forward_into(q: Array, chain: Chain, point: Array, rotation: Array, jacobian: Array) -> None:
    """Fill what `forward` returns."""
    base_rotation, base_position, lengths, mount, beyond, _ = chain
    for k in range(3):
        point[k] = base_position[k]
        for j in range(3):
            rotation[k, j] = base_rotation[k, j]
    for i in range(7):
        axis = 2 - i % 2
        if axis == 1:  # the lengths lead to shoulder, elbow and wrist
            for k in range(3):
                point[k] += lengths[i // 2] * rotation[k, 2]
        for k in range(3):  # the upper rows hold the joint's position until the face centre is known
            jacobian[k, i], jacobian[3 + k, i] = point[k], rotation[k, axis]
        _rotate(rotation, axis, math.cos(q[i]), math.sin(q[i]))
    _mount_racket(rotation, point, mount, beyond, lengths[3], point)
    for i in range(7):
        x, y, z = point[0] - jacobian[0, i], point[1] - jacobian[1, i], point[2] - jacobian[2, i]
        jacobian[0, i] = jacobian[4, i] * z - jacobian[5, i] * y
        jacobian[1, i] = jacobian[5, i] * x - jacobian[3, i] * z
        jacobian[2, i] = jacobian[3, i] * y - jacobian[4, i] * x


@njit(cache=True)
def forward(q: Array, chain: Chain) -> tuple[Array, Array, Array]:
    """Compute the racket's pose and Jacobian, (B.9)-(B.21).

    Args:
        q: (7,) rad.
        chain: The geometry.

    Returns:
        Position (3,) m of the face centre, rotation (3, 3) racket to table, and Jacobian (6, 7) from joint speeds to the velocity of the
        face centre (m/s) and the angular velocity (rad/s).
    """
    point, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, 7))
    forward_into(q, chain, point, rotation, jacobian)
    return point, rotation, jacobian


@njit(cache=True)
def skeleton(q: Array, chain: Chain, points: Array, rotation: Array) -> float:
    """Fill the points between which the bodies of the arm lie.

    Args:
        q: (7,) rad.
        chain: The geometry.
        points: (4, 3) or more rows; filled with shoulder, elbow, wrist and face centre, m.
        rotation: (3, 3); filled with the racket's rotation.

    Returns:
        The cosine of the angle between forearm and hand.
    """
    base_rotation, base_position, lengths, mount, beyond, _ = chain
    x, y, z = base_position[0], base_position[1], base_position[2]
    for k in range(3):
        for j in range(3):
            rotation[k, j] = base_rotation[k, j]
    fx = fy = fz = 0.0  # direction of the last link before the wrist
    for i in range(7):
        if i % 2:
            fx, fy, fz, n = rotation[0, 2], rotation[1, 2], rotation[2, 2], i // 2
            x, y, z = x + lengths[n] * fx, y + lengths[n] * fy, z + lengths[n] * fz
            points[n, 0], points[n, 1], points[n, 2] = x, y, z
        _rotate(rotation, 2 - i % 2, math.cos(q[i]), math.sin(q[i]))
    cosine = fx * rotation[0, 2] + fy * rotation[1, 2] + fz * rotation[2, 2]
    _mount_racket(rotation, points[2], mount, beyond, lengths[3], points[3])
    return cosine


@njit(cache=True)
def _point_along(rotation: Array, x: float, y: float, z: float, q: Array, i: int) -> None:
    """Fill q[i] and q[i + 1] >= 0, for which Rz Ry brings the z axis of `rotation` along the unit vector (x, y, z); turn `rotation` so."""
    a = rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z
    b = rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z
    c = rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z
    across = math.sqrt(a * a + b * b)
    q[i], q[i + 1] = 0.0, math.atan2(across, c)
    if across > 0.0:  # it is also 0 for a and b below 1e-162
        q[i] = math.atan2(b, a)
        _rotate(rotation, 2, a / across, b / across)
    _rotate(rotation, 1, c, across)


@njit(cache=True)
def inverse(position: Array, rotation: Array, swivel: float, chain: Chain, q: Array) -> bool:
    """Fill the joint angles for a racket pose and an elbow angle, in closed form.

    The shoulder, the wrist and the swivel angle give the elbow: it lies on a circle about the line from shoulder to wrist. Each pair of
    joints then points one link along its direction, and the last joint turns the hand about its axis.

    Args:
        position: (3,) m, face centre.
        rotation: (3, 3) racket to table.
        swivel: rad, of the elbow about the line from shoulder to wrist; 0 is up.
        chain: The geometry.
        q: (7,) rad; filled. q2, q4 and q6 are not negative. The other postures with the same links in space negate one of these and turn
            its two neighbours by pi.

    Returns:
        Whether the wrist is within reach.
    """
    base_rotation, base_position, lengths, mount, beyond, _ = chain
    flange, arm, line = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    upper, lower = lengths[1], lengths[2]
    distance = 0.0
    for k in range(3):
        for j in range(3):
            flange[k, j] = rotation[k, 0] * mount[j, 0] + rotation[k, 1] * mount[j, 1] + rotation[k, 2] * mount[j, 2]
            arm[k, j] = base_rotation[k, j]
        wrist = position[k] - flange[k, 0] * beyond[0] - flange[k, 1] * beyond[1] - flange[k, 2] * (beyond[2] + lengths[3])
        line[k] = wrist - base_position[k] - lengths[0] * arm[k, 2]  # from the shoulder to the wrist
        distance += line[k] ** 2
    distance = math.sqrt(distance)
    along = (distance**2 + upper**2 - lower**2) / (2.0 * distance)  # from the shoulder to the centre of the elbow's circle
    if abs(along) > upper * (1.0 + 1e-12) or distance < 1e-6:
        return False
    x, y, z = line[0] / distance, line[1] / distance, line[2] / distance
    flat = math.hypot(x, y)
    side, ahead = (-y / flat, x / flat) if flat > 1e-9 else (0.0, 1.0)  # horizontal unit vector (side, ahead, 0), square to the line
    radius = math.sqrt(max(0.0, upper**2 - along**2))
    c, s = radius * math.cos(swivel), radius * math.sin(swivel)
    ex = along * x - c * z * ahead + s * side
    ey = along * y + c * z * side + s * ahead
    ez = along * z + c * (x * ahead - y * side)
    _point_along(arm, ex / upper, ey / upper, ez / upper, q, 0)
    _point_along(arm, (line[0] - ex) / lower, (line[1] - ey) / lower, (line[2] - ez) / lower, q, 2)
    _point_along(arm, flange[0, 2], flange[1, 2], flange[2, 2], q, 4)
    a = arm[0, 0] * flange[0, 0] + arm[1, 0] * flange[1, 0] + arm[2, 0] * flange[2, 0]
    b = arm[0, 1] * flange[0, 0] + arm[1, 1] * flange[1, 0] + arm[2, 1] * flange[2, 0]
    q[6] = math.atan2(b, a)
    return True
