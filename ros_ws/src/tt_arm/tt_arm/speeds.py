"""Joint speeds that give the racket a velocity and spare the joint that is nearest to its limit.

With columns a_i = (speed limit i) x (column i of the Jacobian), shares x_i = qdot_i / limit_i are wanted with sum a_i x_i = V and the least
max |x_i|. The velocities possible with |x_i| <= 1 fill a zonotope, so the least maximum is the gauge of V in it: the largest
|V.n| / sum |a_k.n| over the normals n = a_i x a_j of its faces. The shares off that face follow; those in it are the same problem in
a plane.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.errors import TtError, check_array
from tt_core.states import Array

from .model import ArmModel

PARALLEL = 1e-9  # sine below which directions count as parallel
LIU_WEIGHTS = np.array([1.0, 0.6, 2.0, 2.0, 2.0 * np.pi, 2.0 * np.pi])  # the diagonal of W^-1, dissertation (4.65)


@njit(cache=True)
def _dot(columns: Array, k: int, vector: Array) -> float:
    return columns[0, k] * vector[0] + columns[1, k] * vector[1] + columns[2, k] * vector[2]


@njit(cache=True)
def least_shares(columns: Array, velocity: Array, shares: Array) -> float:
    """Fills shares (7,) for columns (3, 7) and velocity (3,); returns the least max |share|, inf when the velocity is impossible."""
    shares[:] = 0.0
    best, n0, n1, n2 = -1.0, 0.0, 0.0, 0.0
    for i in range(7):
        for j in range(i):
            x = columns[1, i] * columns[2, j] - columns[2, i] * columns[1, j]
            y = columns[2, i] * columns[0, j] - columns[0, i] * columns[2, j]
            z = columns[0, i] * columns[1, j] - columns[1, i] * columns[0, j]
            length = math.sqrt(x * x + y * y + z * z)
            if length < PARALLEL:
                continue
            x, y, z = x / length, y / length, z / length
            width = 0.0
            for k in range(7):
                width += abs(columns[0, k] * x + columns[1, k] * y + columns[2, k] * z)
            ahead = velocity[0] * x + velocity[1] * y + velocity[2] * z
            if width < PARALLEL:
                if abs(ahead) > PARALLEL:
                    return math.inf
                continue
            if abs(ahead) / width > best:
                best = abs(ahead) / width
                sign = 1.0 if ahead > 0.0 else -1.0
                n0, n1, n2 = sign * x, sign * y, sign * z
    if best < 0.0:
        return math.inf
    normal = np.array([n0, n1, n2])
    rest = velocity.copy()
    inside = np.zeros(7, np.bool_)
    for k in range(7):
        height = _dot(columns, k, normal)
        if abs(height) > PARALLEL * (1.0 + np.abs(columns[:, k]).max()):
            shares[k] = best if height > 0.0 else -best
            rest -= shares[k] * columns[:, k]
        else:
            inside[k] = True
    _least_in_plane(columns, inside, normal, rest, shares)
    return best


@njit(cache=True)
def _least_in_plane(columns: Array, inside: npt.NDArray[np.bool_], normal: Array, rest: Array, shares: Array) -> None:
    """The same for the columns `inside` the face and what is left of the velocity; columns along the face's edge share alike."""
    best, along = -1.0, -1
    edge = np.zeros(3)
    for i in range(7):
        side = np.cross(normal, columns[:, i])
        length = math.sqrt(side @ side)
        if not inside[i] or length < PARALLEL:
            continue
        side /= length
        width = 0.0
        for k in range(7):
            if inside[k]:
                width += abs(_dot(columns, k, side))
        ratio = float(abs(rest @ side)) / width if width > PARALLEL else 0.0
        if ratio > best:
            best, along = ratio, i
            edge = side if rest @ side > 0.0 else -side
    if along < 0:
        return
    direction = np.cross(edge, normal)
    width = 0.0
    left = rest.copy()
    for k in range(7):
        if inside[k]:
            height = _dot(columns, k, edge)
            if abs(height) > PARALLEL * (1.0 + np.abs(columns[:, k]).max()):
                shares[k] = best if height > 0.0 else -best
                left -= shares[k] * columns[:, k]
                inside[k] = False
            else:
                width += abs(_dot(columns, k, direction))
    if width > PARALLEL:
        for k in range(7):
            height = _dot(columns, k, direction)
            if inside[k] and abs(height) > PARALLEL:
                shares[k] = math.copysign(1.0, height) * (left @ direction) / width


@njit(cache=True)
def least_shares_steady(rows: Array, wanted: Array, shares: Array) -> float:
    """The same with rows (5, 7) and wanted (5,): velocity, and the two turning rates of the face normal.

    Elimination leaves two free shares; the least maximum is reached where three of the seven are equal.
    """
    a = np.empty((5, 8))
    a[:, :7], a[:, 7] = rows, wanted
    order = np.arange(7)
    for i in range(5):
        row, column = i, i
        for r in range(i, 5):
            for c in range(i, 7):
                if abs(a[r, c]) > abs(a[row, column]):
                    row, column = r, c
        if abs(a[row, column]) < PARALLEL:
            return math.inf
        for c in range(8):
            a[i, c], a[row, c] = a[row, c], a[i, c]
        for r in range(5):
            a[r, i], a[r, column] = a[r, column], a[r, i]
        order[i], order[column] = order[column], order[i]
        a[i] /= a[i, i]
        for r in range(5):
            if r != i:
                a[r] -= a[r, i] * a[i]
    base, free = np.zeros(7), np.zeros((7, 2))
    base[:5], free[:5] = a[:, 7], -a[:, 5:7]
    free[5, 0], free[6, 1] = 1.0, 1.0
    best = 0.0
    for i in range(7):
        for j in range(i):
            uk = free[i, 0] * free[j, 1] - free[i, 1] * free[j, 0]
            for k in range(j):
                ui = free[j, 0] * free[k, 1] - free[j, 1] * free[k, 0]
                uj = free[k, 0] * free[i, 1] - free[k, 1] * free[i, 0]
                total = abs(ui) + abs(uj) + abs(uk)
                if total > PARALLEL:
                    best = max(best, abs(ui * base[i] + uj * base[j] + uk * base[k]) / total)
    least, x, y = math.inf, 0.0, 0.0
    for i in range(7):  # two of the shares that are equal give the free ones
        for j in range(i):
            u = free[i, 0] * free[j, 1] - free[i, 1] * free[j, 0]
            if abs(u) < PARALLEL:
                continue
            for sign in (1.0, -1.0):
                for other in (1.0, -1.0):
                    ti, tj = sign * best - base[i], other * best - base[j]
                    xx, yy = (ti * free[j, 1] - tj * free[i, 1]) / u, (tj * free[i, 0] - ti * free[j, 0]) / u
                    most = 0.0
                    for k in range(7):
                        most = max(most, abs(base[k] + free[k, 0] * xx + free[k, 1] * yy))
                    if most < least:
                        least, x, y = most, xx, yy
    for m in range(7):
        shares[order[m]] = base[m] + free[m, 0] * x + free[m, 1] * y
    return best


@njit(cache=True)
def steady_rows(jacobian: Array, rotation: Array, limits: Array) -> Array:
    """(5, 7): velocity of the face centre and turning rates of its normal (about the racket's x and y), per share of the speed limits."""
    rows = np.empty((5, 7))
    for i in range(7):
        for k in range(3):
            rows[k, i] = jacobian[k, i] * limits[i]
        for k in range(2):
            turn = rotation[0, k] * jacobian[3, i] + rotation[1, k] * jacobian[4, i] + rotation[2, k] * jacobian[5, i]
            rows[3 + k, i] = turn * limits[i]
    return rows


def allocate(model: ArmModel, q: Array, velocity: Array, *, steady: bool = False, method: Literal["least", "liu"] = "least") -> Array:
    """Joint speeds (7,) rad/s that move the face centre at `velocity` (3,) m/s in `table`, in posture q (7,) rad.

    steady: the face normal must not turn; otherwise its turning is free. method: "least" keeps max |qdot_i| / limit_i least; "liu" is the
    weighted pseudo-inverse (4.64)-(4.65), joint 7 still. The speeds may break the limits: that is for the caller to see.
    Raises TtError when no joint speeds do it, BadShape, NotFinite.
    """
    velocity = check_array("velocity", velocity, (3,)).copy()
    jacobian = model.jacobian(q)
    if method == "liu":
        j, w = jacobian[:3, :6], LIU_WEIGHTS
        return np.append((j * w).T @ np.linalg.solve((j * w) @ j.T, velocity), 0.0)
    rows = steady_rows(jacobian, model.racket(q)[1], model.speed_limits)
    shares = np.empty(7)
    if steady:
        ratio = least_shares_steady(rows, np.append(velocity, [0.0, 0.0]), shares)
    else:
        ratio = least_shares(rows[:3].copy(), velocity, shares)
    if math.isinf(ratio) or np.abs(rows[:3] @ shares - velocity).max() > 1e-6:
        raise TtError(f"no joint speeds give the racket {velocity} m/s at q = {q}")
    return shares * model.speed_limits
