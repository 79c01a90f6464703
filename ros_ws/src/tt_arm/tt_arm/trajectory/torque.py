"""What a path asks of the motors, by inverse dynamics (recursive Newton-Euler; `tests/arm` compares with pinocchio's)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.states import Array

from ..model import ArmModel
from .profiles import evaluate

GRAVITY = 9.81  # m/s^2, as pinocchio's
Vector = tuple[float, float, float]


@njit(cache=True)
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True)
def _turned(v: Vector, about_y: int, c: float, s: float) -> Vector:
    """About z or y by the angle with cosine c and sine s."""
    return (c * v[0] + s * v[2], v[1], c * v[2] - s * v[0]) if about_y else (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])


@njit(cache=True)
def torques(q: Array, qdot: Array, qddot: Array, bodies: Array, torque: Array, wrenches: Array) -> None:
    """Fills torque (7,) N m for q, qdot, qddot (7,); bodies (7, 11) as of the model. wrenches (7, 6) is scratch.

    Each link's vectors are in its own frame, of which z or y is the joint's axis.
    """
    omega, alpha, pull = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, GRAVITY)  # rad/s, rad/s^2, m/s^2 at the joint
    for i in range(7):
        c, s, about_y, arm = math.cos(q[i]), math.sin(q[i]), i % 2, (0.0, 0.0, bodies[i, 0])
        pull = _turned(_sum(pull, _sum(_cross(alpha, arm), _cross(omega, _cross(omega, arm)))), about_y, c, -s)
        omega, alpha = _turned(omega, about_y, c, -s), _turned(alpha, about_y, c, -s)
        own, gain = ((0.0, qdot[i], 0.0), (0.0, qddot[i], 0.0)) if about_y else ((0.0, 0.0, qdot[i]), (0.0, 0.0, qddot[i]))
        alpha = _sum(alpha, _sum(_cross(omega, own), gain))
        omega = _sum(omega, own)
        mass, centre = bodies[i, 1], (bodies[i, 2], bodies[i, 3], bodies[i, 4])
        x, y, z = _sum(pull, _sum(_cross(alpha, centre), _cross(omega, _cross(omega, centre))))
        force = mass * x, mass * y, mass * z
        xx, xy, yy, xz, yz, zz = bodies[i, 5], bodies[i, 6], bodies[i, 7], bodies[i, 8], bodies[i, 9], bodies[i, 10]
        x, y, z = omega
        spin = xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
        x, y, z = alpha
        moment = xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
        moment = _sum(moment, _sum(_cross(omega, spin), _cross(centre, force)))
        for k in range(3):
            wrenches[i, k], wrenches[i, 3 + k] = force[k], moment[k]
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)  # of the links beyond
    for i in range(6, -1, -1):
        force = _sum(force, (wrenches[i, 0], wrenches[i, 1], wrenches[i, 2]))
        moment = _sum(moment, (wrenches[i, 3], wrenches[i, 4], wrenches[i, 5]))
        torque[i] = moment[1] if i % 2 else moment[2]
        c, s = math.cos(q[i]), math.sin(q[i])
        force, moment = _turned(force, i % 2, c, s), _turned(moment, i % 2, c, s)
        moment = _sum(moment, _cross((0.0, 0.0, bodies[i, 0]), force))


@njit(cache=True, nogil=True)
def most_torques(end: float, step: float, knots: Array, coefficients: Array, bodies: Array) -> Array:
    """(7,) N m, the largest each way, see `torque_shares`."""
    q, qdot, qddot, torque, most, wrenches = np.empty(7), np.empty(7), np.empty(7), np.empty(7), np.zeros(7), np.empty((7, 6))
    for n in range(math.ceil(end / step) + 1):
        evaluate(min(end, n * step), knots, coefficients, q, qdot, qddot)
        torques(q, qdot, qddot, bodies, torque, wrenches)
        for i in range(7):
            most[i] = max(most[i], abs(torque[i]))
    return most


def torque_shares(model: ArmModel, end: float, step: float, knots: Array, coefficients: Array) -> Array:
    """(7,): the largest share of each joint's rated torque, every `step` (s) until `end` (s) of a path of polynomials, see `motion`.

    Inertias are those of cylinders and the gears are assumed, see the URDF; friction and rotors are left out.
    """
    return np.asarray(most_torques(end, step, knots, coefficients, model.bodies) / model.torque_limits)
