"""Kernel of the arm's inverse dynamics: which torques a motion needs (recursive Newton-Euler; `tests/arm` compares with pinocchio's)."""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit
from tt_core.constants import GRAVITY
from tt_core.states import Array

Vector = tuple[float, float, float]
Tensor = tuple[float, float, float, float, float, float]  # symmetric: xx, xy, yy, xz, yz, zz


class Links(NamedTuple):
    """The rigid bodies that the joints move, one row for each, in the frame of its link.

    Attributes:
        offset: (7,) m, height of the link's joint above the joint before it.
        mass: (7,) kg.
        centre: (7, 3) m, centre of mass.
        inertia: (7, 6) kg m^2 about the centre of mass: xx, xy, yy, xz, yz, zz.
    """

    offset: Array
    mass: Array
    centre: Array
    inertia: Array


@njit(cache=True)
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True)
def _times(tensor: Tensor, v: Vector) -> Vector:
    xx, xy, yy, xz, yz, zz = tensor
    x, y, z = v
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z


@njit(cache=True)
def _rotated(v: Vector, about_y: int, c: float, s: float) -> Vector:
    """Return v turned about z, or about y, by the angle with cosine c and sine s."""
    return (c * v[0] + s * v[2], v[1], c * v[2] - s * v[0]) if about_y else (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])


@njit(cache=True)
def joint_torques(q: Array, qdot: Array, qddot: Array, links: Links, torque: Array, wrenches: Array) -> None:
    """Fill the torques that a motion needs.

    Outwards along the arm the acceleration of each link gives the wrench on it; inwards these add up. Gravity is an acceleration of the
    base. Each link's vectors are in its own frame, in which the joint's axis is z or y.

    Args:
        q: (7,) rad.
        qdot: (7,) rad/s.
        qddot: (7,) rad/s^2.
        links: The bodies.
        torque: (7,) N m; filled.
        wrenches: (7, 6) working memory: force and moment on each link.
    """
    omega, alpha, acceleration = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, GRAVITY)  # rad/s, rad/s^2, m/s^2 at the joint
    for i in range(7):
        c, s, about_y, arm = math.cos(q[i]), math.sin(q[i]), i % 2, (0.0, 0.0, links.offset[i])
        acceleration = _rotated(_sum(acceleration, _sum(_cross(alpha, arm), _cross(omega, _cross(omega, arm)))), about_y, c, -s)
        omega, alpha = _rotated(omega, about_y, c, -s), _rotated(alpha, about_y, c, -s)
        own_omega, own_alpha = ((0.0, qdot[i], 0.0), (0.0, qddot[i], 0.0)) if about_y else ((0.0, 0.0, qdot[i]), (0.0, 0.0, qddot[i]))
        alpha = _sum(alpha, _sum(_cross(omega, own_omega), own_alpha))
        omega = _sum(omega, own_omega)
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
    for i in range(6, -1, -1):
        force = _sum(force, (wrenches[i, 0], wrenches[i, 1], wrenches[i, 2]))
        moment = _sum(moment, (wrenches[i, 3], wrenches[i, 4], wrenches[i, 5]))
        torque[i] = moment[1] if i % 2 else moment[2]
        c, s = math.cos(q[i]), math.sin(q[i])
        force, moment = _rotated(force, i % 2, c, s), _rotated(moment, i % 2, c, s)
        moment = _sum(moment, _cross((0.0, 0.0, links.offset[i]), force))
