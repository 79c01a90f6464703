"""Inverse of the racket's rebound model: the racket state for a given change of the ball's velocity and spin (dissertation Section 4.2.1).

v0 and w0 are velocity and spin of the ball before the hit, v1 and w1 those after it. With xi = turn (v1 - v0) and eta = w1 - w0 the model
requires eta = xi x n (4.15, corrected), so there is a closed formula for the face normal n. The racket's velocity follows from the impulses
along n and perpendicular to it. Kernels do not validate their arguments.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.arrays import Array
from tt_core.bounce import RacketCoefficients
from tt_core.constants import BALL_RADIUS


@njit(cache=True)
def spin_after(v0: Array, w0: Array, v1: Array, spin_y: float, spin_z: float, w1: Array) -> None:
    """Compute the spin after the hit: y and z are given, x follows from (v1 - v0).(w1 - w0) = 0, which is (4.16) of the dissertation.

    All vectors are in `table`.

    Args:
        v0: (3,) m/s, velocity of the ball before the hit.
        w0: (3,) rad/s, spin before the hit.
        v1: (3,) m/s, velocity after the hit; its x must differ from that of `v0`.
        spin_y: rad/s, spin about y after the hit.
        spin_z: rad/s, spin about z after the hit.
        w1: (3,) rad/s, output: filled with the spin after the hit.
    """
    w1[1], w1[2] = spin_y, spin_z
    w1[0] = w0[0] - ((v1[1] - v0[1]) * (spin_y - w0[1]) + (v1[2] - v0[2]) * (spin_z - w0[2])) / (v1[0] - v0[0])


@njit(cache=True)
def _speed_for(change: float, gain: float, drop: float, least: float) -> float:
    """Return the speed u >= 0 (m/s) that solves max(least, gain - drop u) u = change; drop in s/m, change in m/s."""
    if drop == 0.0:
        return change / gain
    under = gain * gain - 4.0 * drop * change
    u = (gain - math.sqrt(under)) / (2.0 * drop) if under >= 0.0 else np.inf
    return u if gain - drop * u >= least else change / least


@njit(cache=True)
def racket_for(v0: Array, w0: Array, v1: Array, w1: Array, rubber: RacketCoefficients, racket_velocity: Array, normal: Array) -> float:
    """Compute the racket's velocity and face normal that change velocity and spin of the ball as asked.

    Two normals solve the equations. The one with n.(v1 - v0) > 0 is taken, because a racket can only push. All vectors are in `table`.

    Args:
        v0: (3,) m/s, velocity of the ball before the hit.
        w0: (3,) rad/s, spin before the hit.
        v1: (3,) m/s, velocity after the hit.
        w1: (3,) rad/s, spin after the hit, with (v1 - v0).(w1 - w0) = 0.
        rubber: Coefficients of the racket's rebound model.
        racket_velocity: (3,) m/s, output: filled with the racket's velocity.
        normal: (3,) output: filled with the unit face normal.

    Returns:
        The asked change of spin divided by the largest change that the rubber can give. If it is over 1, no racket state exists, and the
        outputs are not filled.
    """
    xi, eta = np.empty(3), np.empty(3)
    xi2, eta2 = 0.0, 0.0
    for k in range(3):
        xi[k] = rubber.turn * (v1[k] - v0[k])
        eta[k] = w1[k] - w0[k]
        xi2 += xi[k] * xi[k]
        eta2 += eta[k] * eta[k]
    if eta2 > xi2 or xi2 == 0.0:
        return math.sqrt(eta2 / xi2) if xi2 > 0.0 else np.inf
    along = math.sqrt(1.0 - eta2 / xi2) / math.sqrt(xi2)
    normal[0] = (eta[1] * xi[2] - eta[2] * xi[1]) / xi2 + along * xi[0]
    normal[1] = (eta[2] * xi[0] - eta[0] * xi[2]) / xi2 + along * xi[1]
    normal[2] = (eta[0] * xi[1] - eta[1] * xi[0]) / xi2 + along * xi[2]
    push = 0.0  # m/s, change of velocity along the normal
    for k in range(3):
        push += (v1[k] - v0[k]) * normal[k]
    across = np.empty(3)  # m/s, change of velocity across the normal
    size = 0.0
    for k in range(3):
        across[k] = v1[k] - v0[k] - push * normal[k]
        size += across[k] * across[k]
    size = math.sqrt(size)
    approach = _speed_for(push, 1.0 + rubber.restitution, rubber.restitution_drop, 1.0 + rubber.restitution_least)
    slip = _speed_for(size, rubber.tangential, rubber.tangential_drop, rubber.tangential_least)
    keep = slip / size if size > 0.0 else 0.0
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        turned = BALL_RADIUS * (w0[i] * normal[j] - w0[j] * normal[i])
        racket_velocity[k] = v0[k] + approach * normal[k] - turned + keep * across[k]
    return math.sqrt(eta2 / xi2)
