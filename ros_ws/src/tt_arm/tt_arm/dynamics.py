"""Inverse dynamics of the arm: joint torques of a motion, by the recursive Newton-Euler method (`tests/arm` compares with pinocchio)."""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit
from tt_core.arrays import Array, Triple
from tt_core.constants import GRAVITY

from .kinematics import Chain

Tensor = tuple[float, float, float, float, float, float]  # symmetric: xx, xy, yy, xz, yz, zz


class Links(NamedTuple):
    """Inertial data of the n rigid bodies that the joints move, one row for each joint, in the frame of the joint.

    Attributes:
        mass: (n,) kg.
        centre: (n, 3) m, centre of mass.
        inertia: (n, 6) kg m^2 about the centre of mass: xx, xy, yy, xz, yz, zz.
    """

    mass: Array
    centre: Array
    inertia: Array


@njit(cache=True)
def _cross(a: Triple, b: Triple) -> Triple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def _sum(a: Triple, b: Triple) -> Triple:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True)
def _times(tensor: Tensor, v: Triple) -> Triple:
    xx, xy, yy, xz, yz, zz = tensor
    x, y, z = v
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z


@njit(cache=True)
def _inwards(v: Triple, i: int, c: float, s: float, chain: Chain) -> Triple:
    """Transform a vector from the frame of joint i to the frame of the joint before; c and s are cosine and sine of the joint's angle."""
    r = chain.rotations
    x, y, z = c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]
    return (
        r[i, 0, 0] * x + r[i, 0, 1] * y + r[i, 0, 2] * z,
        r[i, 1, 0] * x + r[i, 1, 1] * y + r[i, 1, 2] * z,
        r[i, 2, 0] * x + r[i, 2, 1] * y + r[i, 2, 2] * z,
    )


@njit(cache=True)
def _outwards(v: Triple, i: int, c: float, s: float, chain: Chain) -> Triple:
    """Transform a vector from the frame of the joint before to the frame of joint i; the inverse of `_inwards`."""
    r = chain.rotations
    x = r[i, 0, 0] * v[0] + r[i, 1, 0] * v[1] + r[i, 2, 0] * v[2]
    y = r[i, 0, 1] * v[0] + r[i, 1, 1] * v[1] + r[i, 2, 1] * v[2]
    z = r[i, 0, 2] * v[0] + r[i, 1, 2] * v[1] + r[i, 2, 2] * v[2]
    return c * x + s * y, c * y - s * x, z


@njit(cache=True)
def _arm(i: int, q: float, chain: Chain) -> Triple:
    """Return the origin (m) of the frame of joint i in the frame of the joint before."""
    r, p = chain.rotations, chain.positions
    along = q if chain.linear[i] else 0.0
    return p[i, 0] + along * r[i, 0, 2], p[i, 1] + along * r[i, 1, 2], p[i, 2] + along * r[i, 2, 2]


@njit(cache=True)
def joint_torques(q: Array, qdot: Array, qddot: Array, chain: Chain, links: Links, torque: Array, wrenches: Array) -> None:
    """Compute the torques (forces of linear joints) that a motion of the arm needs.

    The first loop goes from the base outwards and computes the acceleration of each link and the wrench that it needs. The second loop goes
    inwards and adds the wrenches. Gravity is treated as an upward acceleration of the table. The vectors of each link are in the frame of
    its joint, whose axis is z.

    Args:
        q: (n,) rad or m, joint positions.
        qdot: (n,) rad/s or m/s, joint speeds.
        qddot: (n,) rad/s^2 or m/s^2, joint accelerations.
        chain: Geometry of the arm.
        links: Masses and inertias of the links.
        torque: (n,) N m or N, output: filled with the torques or forces.
        wrenches: (n, 6) scratch memory: force and moment on each link.
    """
    n = len(q)
    omega, alpha, acceleration = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, GRAVITY)  # rad/s, rad/s^2, m/s^2 at the joint
    for i in range(n):
        linear, arm = chain.linear[i], _arm(i, q[i], chain)
        c, s = (1.0, 0.0) if linear else (math.cos(q[i]), math.sin(q[i]))
        acceleration = _outwards(_sum(acceleration, _sum(_cross(alpha, arm), _cross(omega, _cross(omega, arm)))), i, c, s, chain)
        omega, alpha = _outwards(omega, i, c, s, chain), _outwards(alpha, i, c, s, chain)
        if linear:
            x, y, _ = _cross(omega, (0.0, 0.0, qdot[i]))  # half of the Coriolis acceleration
            acceleration = _sum(acceleration, (2.0 * x, 2.0 * y, qddot[i]))
        else:
            alpha = _sum(alpha, _sum(_cross(omega, (0.0, 0.0, qdot[i])), (0.0, 0.0, qddot[i])))
            omega = _sum(omega, (0.0, 0.0, qdot[i]))
        mass, centre = links.mass[i], (links.centre[i, 0], links.centre[i, 1], links.centre[i, 2])
        x, y, z = _sum(acceleration, _sum(_cross(alpha, centre), _cross(omega, _cross(omega, centre))))
        force = mass * x, mass * y, mass * z
        row = links.inertia[i]
        inertia = row[0], row[1], row[2], row[3], row[4], row[5]
        momentum = _times(inertia, omega)  # kg m^2/s, about the centre of mass
        moment = _sum(_times(inertia, alpha), _sum(_cross(omega, momentum), _cross(centre, force)))
        for k in range(3):
            wrenches[i, k], wrenches[i, 3 + k] = force[k], moment[k]
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)  # of the links beyond
    for i in range(n - 1, -1, -1):
        force = _sum(force, (wrenches[i, 0], wrenches[i, 1], wrenches[i, 2]))
        moment = _sum(moment, (wrenches[i, 3], wrenches[i, 4], wrenches[i, 5]))
        linear = chain.linear[i]
        torque[i] = force[2] if linear else moment[2]
        c, s = (1.0, 0.0) if linear else (math.cos(q[i]), math.sin(q[i]))
        force, moment = _inwards(force, i, c, s, chain), _inwards(moment, i, c, s, chain)
        moment = _sum(moment, _cross(_arm(i, q[i], chain), force))
