"""Compute joint speeds that give the racket a velocity, such that the largest ratio of a joint's speed to its limit is least.

The unknowns are the shares x_i = qdot_i / limit_i, and max |x_i| is minimised.

For the velocity V alone (three equations): with the columns a_i = (speed limit i) (column i of the Jacobian), the equation is
sum a_i x_i = V. The velocities that are possible with |x_i| <= 1 fill a zonotope. So the least maximum is the gauge of V in it: the largest
|V.n| / sum |a_k.n| over the normals n = a_i x a_j of its faces. On the best face all shares equal the least maximum with the sign of a_k.n,
except those of the columns that lie in the face. For these there is the same problem in a plane.

For the velocity and a face normal that does not turn (five equations) see `least_shares_steady`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.arrays import Array, Triple
from tt_core.errors import TtError, check_array

if TYPE_CHECKING:
    from ..model import ArmModel

Indices = npt.NDArray[np.int64]

PARALLEL = 1e-9  # sine of the angle below which directions count as parallel
ONES = np.ones(8)  # instead of speed limits, for `steady_rows` of joint speeds


class NoJointSpeeds(TtError):
    """No joint speeds give the racket the asked velocity.

    Attributes:
        q: (n,) rad or m, joint positions.
        velocity: (3,) m/s in `table`, asked velocity of the face centre.
    """

    def __init__(self, q: Array, velocity: Array) -> None:
        """Keep the posture and the velocity."""
        super().__init__(f"no joint speeds give the racket {velocity} m/s at q = {q}")
        self.q, self.velocity = q, velocity


@njit(cache=True)
def _component(columns: Array, k: int, x: float, y: float, z: float) -> float:
    """Return the component of column k along (x, y, z); exactly 0 if they are orthogonal except for rounding."""
    height = columns[0, k] * x + columns[1, k] * y + columns[2, k] * z
    size = max(abs(columns[0, k]), abs(columns[1, k]), abs(columns[2, k]))
    return height if abs(height) > PARALLEL * (1.0 + size) else 0.0


@njit(cache=True, inline="always")
def _least_in_plane(columns: Array, n: int, normal: Triple, rest: Triple, shares: Array) -> None:
    """Fill the shares of the columns that lie in a face of the zonotope; columns along the same edge of the face get the same share.

    Args:
        columns: (3, n), as of `least_shares`.
        n: Count of the columns.
        normal: Of the face, unit.
        rest: m/s, of the velocity, which these columns give.
        shares: (n,) of the speed limits, NaN for the columns in the face; these are filled.
    """
    nx, ny, nz = normal
    rx, ry, rz = rest
    best, ex, ey, ez = -1.0, 0.0, 0.0, 0.0
    for i in range(n):
        if not math.isnan(shares[i]):
            continue
        x = ny * columns[2, i] - nz * columns[1, i]
        y = nz * columns[0, i] - nx * columns[2, i]
        z = nx * columns[1, i] - ny * columns[0, i]
        length = math.sqrt(x * x + y * y + z * z)
        if length < PARALLEL:
            continue
        width, ahead = 0.0, (rx * x + ry * y + rz * z) / length
        for k in range(n):
            if math.isnan(shares[k]):
                width += abs(columns[0, k] * x + columns[1, k] * y + columns[2, k] * z) / length
        ratio = abs(ahead) / width if width > PARALLEL else 0.0
        if ratio > best:
            scale = math.copysign(1.0, ahead) / length
            best, ex, ey, ez = ratio, scale * x, scale * y, scale * z
    dx, dy, dz = ey * nz - ez * ny, ez * nx - ex * nz, ex * ny - ey * nx  # along the edge
    width, left = 0.0, rx * dx + ry * dy + rz * dz
    for k in range(n):
        if math.isnan(shares[k]):
            height = _component(columns, k, ex, ey, ez)
            along = columns[0, k] * dx + columns[1, k] * dy + columns[2, k] * dz
            if height != 0.0:
                shares[k] = math.copysign(best, height)
                left -= shares[k] * along
            else:
                width += abs(along)
    for k in range(n):
        if math.isnan(shares[k]):
            along = columns[0, k] * dx + columns[1, k] * dy + columns[2, k] * dz
            shares[k] = math.copysign(left / width, left * along) if width > PARALLEL and abs(along) > PARALLEL else 0.0


@njit(cache=True, inline="always")
def _least_shares(columns: Array, n: int, velocity: Array, shares: Array, most: float) -> float:
    """Do what `least_shares` does, for n columns of which n is known to the compiler."""
    best, nx, ny, nz = -1.0, 0.0, 0.0, 0.0
    for i in range(n):
        for j in range(i):
            x = columns[1, i] * columns[2, j] - columns[2, i] * columns[1, j]
            y = columns[2, i] * columns[0, j] - columns[0, i] * columns[2, j]
            z = columns[0, i] * columns[1, j] - columns[1, i] * columns[0, j]
            length = x * x + y * y + z * z
            if length < PARALLEL * PARALLEL:
                continue
            width, ahead = 0.0, velocity[0] * x + velocity[1] * y + velocity[2] * z
            for k in range(n):
                width += abs(columns[0, k] * x + columns[1, k] * y + columns[2, k] * z)
            if width * width < PARALLEL * PARALLEL * length:
                if ahead * ahead > PARALLEL * PARALLEL * length:
                    return math.inf
                continue
            if abs(ahead) > best * width:
                best, scale = abs(ahead) / width, math.copysign(1.0, ahead) / math.sqrt(length)
                nx, ny, nz = scale * x, scale * y, scale * z
                if best > most:
                    return math.inf
    if best < 0.0:
        return math.inf
    rx, ry, rz = velocity[0], velocity[1], velocity[2]  # the rest of the velocity
    for k in range(n):
        height = _component(columns, k, nx, ny, nz)
        shares[k] = math.copysign(best, height) if height != 0.0 else math.nan  # in the face
        if height != 0.0:
            rx, ry, rz = rx - shares[k] * columns[0, k], ry - shares[k] * columns[1, k], rz - shares[k] * columns[2, k]
    _least_in_plane(columns, n, (nx, ny, nz), (rx, ry, rz), shares)
    return best


@njit(cache=True)
def least_shares(columns: Array, velocity: Array, shares: Array, most: float = math.inf) -> float:
    """Compute joint speeds that give the racket a velocity, as shares of the speed limits with the least possible maximum.

    Args:
        columns: (3, n) m/s, velocity of the racket that each joint gives at its speed limit. More rows are ignored.
        velocity: (3,) m/s, wanted velocity of the face centre. More numbers are ignored.
        shares: (n,) output: filled with the joint speeds over their limits.
        most: The search ends as soon as it is known that the maximum is larger than this.

    Returns:
        The least maximum of |share|; inf if the velocity is impossible, or needs more than `most`.
    """
    if columns.shape[1] == 7:  # a constant, so that the compiler unrolls the loops: twice as fast
        return _least_shares(columns, 7, velocity, shares, most)
    return _least_shares(columns, columns.shape[1], velocity, shares, most)


@njit(cache=True)
def _largest_share(base: Array, free: Array, y: Array) -> float:
    """Return max |base_i + free_i . y| over the joints i."""
    most = 0.0
    for i in range(len(base)):
        share = base[i]
        for j in range(len(y)):
            share += free[i, j] * y[j]
        most = max(most, abs(share))
    return most


@njit(cache=True)
def _determinant(free: Array, a: int, b: int, c: int) -> float:
    """Return the determinant of the first k columns of free (n, k) in the rows a, b and c, of which the first k count."""
    if free.shape[1] == 1:
        return free[a, 0]
    if free.shape[1] == 2:
        return free[a, 0] * free[b, 1] - free[a, 1] * free[b, 0]
    return (
        free[a, 0] * (free[b, 1] * free[c, 2] - free[b, 2] * free[c, 1])
        - free[a, 1] * (free[b, 0] * free[c, 2] - free[b, 2] * free[c, 0])
        + free[a, 2] * (free[b, 0] * free[c, 1] - free[b, 1] * free[c, 0])
    )


@njit(cache=True)
def _weights(free: Array, rows: Indices, weights: Array) -> None:
    """Fill the weights (k + 1,) with which the sum of the rows (k + 1,) of free (n, k) is zero: minors with alternating signs."""
    k = free.shape[1]
    sign, left = 1.0, np.zeros(4, np.int64)
    for m in range(k + 1):
        for j in range(k):
            left[j] = rows[j if j < m else j + 1]
        weights[m] = sign * _determinant(free, left[0], left[1], left[2])
        sign = -sign


@njit(cache=True)
def _solve(free: Array, rows: Indices, values: Array, y: Array) -> bool:
    """Fill y (k,) with free[rows] y = values, by Cramer's rule, for the first k rows; return whether there is a solution."""
    k = free.shape[1]
    whole = _determinant(free, rows[0], rows[1], rows[2])
    if abs(whole) < PARALLEL:
        return False
    system = np.empty((3, k))
    for j in range(k):
        for i in range(k):
            for c in range(k):
                system[i, c] = values[i] if c == j else free[rows[i], c]
        y[j] = _determinant(system, 0, 1, 2) / whole
    return True


@njit(cache=True)
def _next_subset(rows: Indices, count: int, n: int) -> bool:
    """Replace rows (count,) by the next increasing subset of 0..n-1; return False after the last one."""
    i = count - 1
    while i >= 0 and rows[i] == n - count + i:
        i -= 1
    if i < 0:
        return False
    rows[i] += 1
    for j in range(i + 1, count):
        rows[j] = rows[j - 1] + 1
    return True


@njit(cache=True)
def _corner(base: Array, free: Array, best: float, y: Array) -> None:
    """Fill y (k,) with the point of least maximum among those at which k shares are +-best.

    It is needed if the equations of the best k + 1 joints are dependent, so that they do not determine y.
    """
    n, k = free.shape
    least, rows, values, trial = math.inf, np.arange(4, dtype=np.int64), np.empty(3), np.empty(k)
    while True:
        for signs in range(1 << k):
            for i in range(k):
                values[i] = (best if signs >> i & 1 else -best) - base[rows[i]]
            if _solve(free, rows, values, trial):
                most = _largest_share(base, free, trial)
                if most < least:
                    least = most
                    y[:] = trial
        if not _next_subset(rows, k, n):
            break


@njit(cache=True)
def _least_maximum_of_two(base: Array, free: Array, y: Array) -> float:
    """Do what `_least_maximum` does for seven joints and k = 2, in a fifth of the time: the compiler unrolls the loops."""
    n = 7
    best, u, si, sj, bi, bj = 0.0, 1.0, 0.0, 0.0, n - 2, n - 1
    for i in range(n):
        for j in range(i):
            uk = free[i, 0] * free[j, 1] - free[i, 1] * free[j, 0]
            for k in range(j):
                ui = free[j, 0] * free[k, 1] - free[j, 1] * free[k, 0]
                uj = free[k, 0] * free[i, 1] - free[k, 1] * free[i, 0]
                total, most = abs(ui) + abs(uj) + abs(uk), ui * base[i] + uj * base[j] + uk * base[k]
                if total > PARALLEL and abs(most) > best * total:
                    best = abs(most) / total
                    si, sj, sk = math.copysign(1.0, most * ui), math.copysign(1.0, most * uj), math.copysign(1.0, most * uk)
                    if abs(uk) >= max(abs(ui), abs(uj)):
                        u, bi, bj = uk, i, j
                    elif abs(ui) >= abs(uj):
                        u, bi, bj, si, sj = ui, j, k, sj, sk
                    else:
                        u, bi, bj, si, sj = uj, k, i, sk, si
    ti, tj = si * best - base[bi], sj * best - base[bj]
    y[0], y[1] = (ti * free[bj, 1] - tj * free[bi, 1]) / u, (tj * free[bi, 0] - ti * free[bj, 0]) / u
    if _largest_share(base, free, y) > best * (1.0 + 1e-9):
        _corner(base, free, best, y)
    return best


@njit(cache=True)
def _least_maximum(base: Array, free: Array, y: Array) -> float:
    """Fill y (k,) for which the largest |base_i + free_i . y| is least, and return it.

    With the largest share m this is a linear programme in k + 1 unknowns (y, m), so at its optimum k + 1 of the n shares are equal to m.
    For any k + 1 joints there are weights u_i, the minors of free, that cancel y: sum u_i x_i = sum u_i b_i for every y. Therefore
    m >= |sum u_i b_i| / sum |u_i|, and the largest of these bounds over all such subsets is m, because a basic solution of the dual
    programme has at most k + 1 weights that are not zero. There x_i = m sign(u_i total). All of these equations but the one with the
    largest weight, which leaves the best determined system, give y.
    """
    n, k = free.shape
    best = 0.0
    rows, weights, left, values = np.arange(4, dtype=np.int64), np.empty(4), np.zeros(4, np.int64), np.empty(4)
    y[:] = 0.0
    if k == 0:
        return _largest_share(base, free, y)
    if k == 2:
        return _least_maximum_of_two(base, free, y)
    while True:
        _weights(free, rows, weights)
        total, size, drop = 0.0, 0.0, 0
        for i in range(k + 1):
            total += weights[i] * base[rows[i]]
            size += abs(weights[i])
            drop = i if abs(weights[i]) > abs(weights[drop]) else drop
        if size > PARALLEL and abs(total) > best * size:
            best = abs(total) / size
            for j in range(k):
                m = j if j < drop else j + 1
                left[j], values[j] = rows[m], math.copysign(1.0, total * weights[m])
        if not _next_subset(rows, k + 1, n):
            break
    if best > 0.0:
        for j in range(k):
            values[j] = values[j] * best - base[left[j]]
        if not _solve(free, left, values, y) or _largest_share(base, free, y) > best * (1.0 + 1e-9):
            _corner(base, free, best, y)
    return best


@njit(cache=True, inline="always")
def _least_shares_steady(rows: Array, n: int, wanted: Array, shares: Array) -> float:
    """Do what `least_shares_steady` does, for n columns of which n is known to the compiler."""
    a, order, base, free, y = np.empty((5, n + 1)), np.arange(n), np.zeros(n), np.zeros((n, n - 5)), np.empty(n - 5)
    a[:, :n], a[:, n] = rows, wanted
    for i in range(5):
        row, column = i, i
        for r in range(i, 5):
            for c in range(i, n):
                if abs(a[r, c]) > abs(a[row, column]):
                    row, column = r, c
        if abs(a[row, column]) < PARALLEL:
            return math.inf
        for c in range(n + 1):
            a[i, c], a[row, c] = a[row, c], a[i, c]
        for r in range(5):
            a[r, i], a[r, column] = a[r, column], a[r, i]
        order[i], order[column] = order[column], order[i]
        pivot = 1.0 / a[i, i]
        for c in range(i, n + 1):
            a[i, c] *= pivot
        for r in range(5):
            if r != i:
                factor = a[r, i]
                for c in range(i, n + 1):
                    a[r, c] -= factor * a[i, c]
    for i in range(5):
        base[i] = a[i, n]
        for j in range(n - 5):
            free[i, j] = -a[i, 5 + j]
    for j in range(n - 5):
        free[5 + j, j] = 1.0
    best = _least_maximum(base, free, y)
    for m in range(n):
        shares[order[m]] = base[m]
        for j in range(n - 5):
            shares[order[m]] += free[m, j] * y[j]
    return best


@njit(cache=True)
def least_shares_steady(rows: Array, wanted: Array, shares: Array) -> float:
    """Compute joint speeds with which the racket has a velocity and its face turns at two given rates.

    A share is the speed of a joint divided by its limit. Of all joint speeds that do so, those with the least maximum share are taken.

    Args:
        rows: (5, n) matrix of `steady_rows` for shares.
        wanted: (5,) wanted velocity (m/s) and turning rates about the racket's x and y axes (rad/s).
        shares: (n,) output: filled with the joint speeds over their limits.

    Returns:
        The least maximum of |share|; inf if the rows are linearly dependent.
    """
    if rows.shape[1] == 7:  # as in `least_shares`
        return _least_shares_steady(rows, 7, wanted, shares)
    return _least_shares_steady(rows, rows.shape[1], wanted, shares)


@njit(cache=True)
def steady_rows_into(jacobian: Array, rotation: Array, limits: Array, rows: Array) -> None:
    """Compute the matrix that `steady_rows` returns into a given array.

    Args:
        jacobian: (6, n) Jacobian of `kinematics.forward`.
        rotation: (3, 3) rotation from racket to `table`.
        limits: (n,) rad/s or m/s, speed limits; ones give the matrix for joint speeds.
        rows: (5, n) output: filled with the matrix.
    """
    for i in range(rows.shape[1]):
        for k in range(3):
            rows[k, i] = jacobian[k, i] * limits[i]
        for k in range(2):
            turn = rotation[0, k] * jacobian[3, i] + rotation[1, k] * jacobian[4, i] + rotation[2, k] * jacobian[5, i]
            rows[3 + k, i] = turn * limits[i]


@njit(cache=True)
def steady_rows(jacobian: Array, rotation: Array, limits: Array) -> Array:
    """Return the matrix that maps joint speeds, as shares of the speed limits, to the five quantities of the racket's motion that matter.

    These are the velocity of the face centre and the turning rates of the face normal. The rotation about the normal has no influence.

    Args:
        jacobian: (6, n) Jacobian of `kinematics.forward`.
        rotation: (3, 3) rotation from racket to `table`.
        limits: (n,) rad/s or m/s, speed limits; ones give the matrix for joint speeds.

    Returns:
        (5, n): velocity of the face centre in `table` (m/s), and turning rates of its normal about the racket's x and y axes (rad/s).
    """
    rows = np.empty((5, jacobian.shape[1]))
    steady_rows_into(jacobian, rotation, limits, rows)
    return rows


def allocate(model: ArmModel, q: Array, velocity: Array, *, steady: bool = False) -> Array:
    """Compute the joint speeds that give the racket's face centre a velocity, with the least possible maximum of speed over limit.

    Args:
        model: The arm.
        q: (n,) rad or m, joint positions.
        velocity: (3,) m/s in `table`, wanted velocity of the face centre.
        steady: Whether the face normal must not turn. If False, its turning is free.

    Returns:
        (n,) rad/s or m/s joint speeds, which may exceed the limits.

    Raises:
        NoJointSpeeds: No joint speeds give this velocity.
        BadShape: An array has another shape.
        NotFinite: A number is NaN or infinite.
    """
    velocity = check_array("velocity", velocity, (3,)).copy()
    rows, shares = steady_rows(model.jacobian(q), model.racket(q)[1], np.array(model.speed_limits)), np.empty(len(model.names))
    if steady:
        ratio = least_shares_steady(rows, np.append(velocity, [0.0, 0.0]), shares)
    else:
        ratio = least_shares(rows[:3].copy(), velocity, shares)
    if math.isinf(ratio) or np.abs(rows[:3] @ shares - velocity).max() > 1e-6:
        raise NoJointSpeeds(q, velocity)
    return shares * model.speed_limits
