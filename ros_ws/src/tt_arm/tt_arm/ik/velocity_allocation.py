"""Joint speeds that give the racket a velocity and spare the joint that is nearest to its speed limit.

The shares x_i = qdot_i / limit_i are wanted with the least max |x_i|.

For the velocity V alone (three rows): with the columns a_i = (speed limit i) (column i of the Jacobian), sum a_i x_i = V. The velocities
that are possible with |x_i| <= 1 fill a zonotope. So the least maximum is the gauge of V in it: the largest |V.n| / sum |a_k.n| over
the normals n = a_i x a_j of its faces. On the best face all shares are the least maximum with the sign of a_k.n, but for those of the
columns in the face. These are the same problem in a plane.

For the velocity and a still face normal (five rows) see `least_shares_steady`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.errors import TtError, check_array
from tt_core.states import Array

from ..model import ArmModel

PARALLEL = 1e-9  # sine below which directions count as parallel


class NoJointSpeeds(TtError):
    """No joint speeds move the racket as asked.

    Attributes:
        q: (7,) rad, the posture.
        velocity: (3,) m/s, as asked.
    """

    def __init__(self, q: Array, velocity: Array) -> None:
        """Keep the posture and the velocity."""
        super().__init__(f"no joint speeds give the racket {velocity} m/s at q = {q}")
        self.q, self.velocity = q, velocity


@njit(cache=True)
def _component(columns: Array, k: int, x: float, y: float, z: float) -> float:
    """Return the component of column k along (x, y, z); exactly 0 where it is square to it but for rounding."""
    height = columns[0, k] * x + columns[1, k] * y + columns[2, k] * z
    size = max(abs(columns[0, k]), abs(columns[1, k]), abs(columns[2, k]))
    return height if abs(height) > PARALLEL * (1.0 + size) else 0.0


@njit(cache=True)
def least_shares(columns: Array, velocity: Array, shares: Array, most: float = math.inf) -> float:
    """Fill the shares with the least maximum that give a velocity.

    Args:
        columns: (3, 7) or more rows, of which three are read: m/s of the racket for each joint at its speed limit.
        velocity: (3,) m/s or more numbers, of which three are read.
        shares: (7,) of the speed limits; filled.
        most: Bound, above which the search ends.

    Returns:
        The least max |share|; inf if the velocity is impossible, or as soon as it is seen to need more than `most`.
    """
    best, nx, ny, nz = -1.0, 0.0, 0.0, 0.0
    for i in range(7):
        for j in range(i):
            x = columns[1, i] * columns[2, j] - columns[2, i] * columns[1, j]
            y = columns[2, i] * columns[0, j] - columns[0, i] * columns[2, j]
            z = columns[0, i] * columns[1, j] - columns[1, i] * columns[0, j]
            length = x * x + y * y + z * z
            if length < PARALLEL * PARALLEL:
                continue
            width, ahead = 0.0, velocity[0] * x + velocity[1] * y + velocity[2] * z
            for k in range(7):
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
    for k in range(7):
        height = _component(columns, k, nx, ny, nz)
        shares[k] = math.copysign(best, height) if height != 0.0 else math.nan  # in the face
        if height != 0.0:
            rx, ry, rz = rx - shares[k] * columns[0, k], ry - shares[k] * columns[1, k], rz - shares[k] * columns[2, k]
    _least_in_plane(columns, nx, ny, nz, rx, ry, rz, shares)
    return best


@njit(cache=True)
def _least_in_plane(columns: Array, nx: float, ny: float, nz: float, rx: float, ry: float, rz: float, shares: Array) -> None:
    """Fill the shares of the columns that lie in a face of the zonotope; columns along the same edge of the face get the same share.

    Args:
        columns: (3, 7), as of `least_shares`.
        nx: x of the face's unit normal.
        ny: y of it.
        nz: z of it.
        rx: x of the rest of the velocity (m/s), which these columns give.
        ry: y of it.
        rz: z of it.
        shares: (7,) of the speed limits, NaN for the columns in the face; these are filled.
    """
    best, ex, ey, ez = -1.0, 0.0, 0.0, 0.0
    for i in range(7):
        if not math.isnan(shares[i]):
            continue
        x = ny * columns[2, i] - nz * columns[1, i]
        y = nz * columns[0, i] - nx * columns[2, i]
        z = nx * columns[1, i] - ny * columns[0, i]
        length = math.sqrt(x * x + y * y + z * z)
        if length < PARALLEL:
            continue
        width, ahead = 0.0, (rx * x + ry * y + rz * z) / length
        for k in range(7):
            if math.isnan(shares[k]):
                width += abs(columns[0, k] * x + columns[1, k] * y + columns[2, k] * z) / length
        ratio = abs(ahead) / width if width > PARALLEL else 0.0
        if ratio > best:
            scale = math.copysign(1.0, ahead) / length
            best, ex, ey, ez = ratio, scale * x, scale * y, scale * z
    dx, dy, dz = ey * nz - ez * ny, ez * nx - ex * nz, ex * ny - ey * nx  # along the edge
    width, left = 0.0, rx * dx + ry * dy + rz * dz
    for k in range(7):
        if math.isnan(shares[k]):
            height = _component(columns, k, ex, ey, ez)
            along = columns[0, k] * dx + columns[1, k] * dy + columns[2, k] * dz
            if height != 0.0:
                shares[k] = math.copysign(best, height)
                left -= shares[k] * along
            else:
                width += abs(along)
    for k in range(7):
        if math.isnan(shares[k]):
            along = columns[0, k] * dx + columns[1, k] * dy + columns[2, k] * dz
            shares[k] = math.copysign(left / width, left * along) if width > PARALLEL and abs(along) > PARALLEL else 0.0


@njit(cache=True)
def _largest_share(base: Array, free: Array, x: float, y: float) -> float:
    """Return max |base_k + free_k . (x, y)| over the joints k."""
    most = 0.0
    for k in range(7):
        most = max(most, abs(base[k] + free[k, 0] * x + free[k, 1] * y))
    return most


@njit(cache=True)
def _corner(base: Array, free: Array, best: float) -> tuple[float, float]:
    """Return the free shares (x, y) with the least maximum among the points where two shares are +-best.

    Needed where the best triple has two shares alike, so that it does not determine x and y.
    """
    least, at_x, at_y = math.inf, 0.0, 0.0
    for i in range(7):
        for j in range(i):
            u = free[i, 0] * free[j, 1] - free[i, 1] * free[j, 0]
            if abs(u) < PARALLEL:
                continue
            for sign in (1.0, -1.0):
                for other in (1.0, -1.0):
                    ti, tj = sign * best - base[i], other * best - base[j]
                    x, y = (ti * free[j, 1] - tj * free[i, 1]) / u, (tj * free[i, 0] - ti * free[j, 0]) / u
                    most = _largest_share(base, free, x, y)
                    if most < least:
                        least, at_x, at_y = most, x, y
    return at_x, at_y


@njit(cache=True)
def least_shares_steady(rows: Array, wanted: Array, shares: Array) -> float:
    """Fill the shares with the least maximum that give a velocity and two turning rates of the face normal.

    Elimination with full pivoting leaves two free shares y: x_k = b_k + f_k . y for each joint k, with `base` b and `free` f. The least
    maximum m over y is a linear programme in three unknowns (y, m), so at its optimum three of the seven |x_k| are equal to m.

    For three joints i, j, k the weights u_i = f_j x f_k, u_j = f_k x f_i, u_k = f_i x f_j (cross products in the plane) cancel y:
    u_i x_i + u_j x_j + u_k x_k = u_i b_i + u_j b_j + u_k b_k for every y. Therefore
    m >= |u_i b_i + u_j b_j + u_k b_k| / (|u_i| + |u_j| + |u_k|), and the largest of these bounds over all triples is m, because a basic
    solution of the dual programme has at most three weights that are not zero. There x_i = m sign(u_i total), and so on. Two of these
    three equations, those whose cross product is largest, give y.

    Args:
        rows: (5, 7) of `steady_rows`.
        wanted: (5,) velocity (m/s) and turning rates (rad/s) that the rows are to give.
        shares: (7,) of the speed limits; filled.

    Returns:
        The least max |share|; inf if the rows are dependent.
    """
    a, order, base, free = np.empty((5, 8)), np.arange(7), np.zeros(7), np.zeros((7, 2))
    a[:, :7], a[:, 7] = rows, wanted
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
        pivot = 1.0 / a[i, i]
        for c in range(i, 8):
            a[i, c] *= pivot
        for r in range(5):
            if r != i:
                factor = a[r, i]
                for c in range(i, 8):
                    a[r, c] -= factor * a[i, c]
    for i in range(5):
        base[i], free[i, 0], free[i, 1] = a[i, 7], -a[i, 5], -a[i, 6]
    free[5, 0], free[6, 1] = 1.0, 1.0
    best, u, si, sj, bi, bj = 0.0, 1.0, 0.0, 0.0, 5, 6
    for i in range(7):
        for j in range(i):
            uk = free[i, 0] * free[j, 1] - free[i, 1] * free[j, 0]
            for k in range(j):
                ui = free[j, 0] * free[k, 1] - free[j, 1] * free[k, 0]
                uj = free[k, 0] * free[i, 1] - free[k, 1] * free[i, 0]
                total, most = abs(ui) + abs(uj) + abs(uk), ui * base[i] + uj * base[j] + uk * base[k]
                if total > PARALLEL and abs(most) > best * total:
                    best = abs(most) / total
                    si, sj, sk = math.copysign(1.0, most * ui), math.copysign(1.0, most * uj), math.copysign(1.0, most * uk)
                    if abs(uk) >= max(abs(ui), abs(uj)):  # two of the three give the free ones: those that are least alike
                        u, bi, bj = uk, i, j
                    elif abs(ui) >= abs(uj):
                        u, bi, bj, si, sj = ui, j, k, sj, sk
                    else:
                        u, bi, bj, si, sj = uj, k, i, sk, si
    ti, tj = si * best - base[bi], sj * best - base[bj]
    x, y = (ti * free[bj, 1] - tj * free[bi, 1]) / u, (tj * free[bi, 0] - ti * free[bj, 0]) / u
    if _largest_share(base, free, x, y) > best * (1.0 + 1e-9):
        x, y = _corner(base, free, best)
    for m in range(7):
        shares[order[m]] = base[m] + free[m, 0] * x + free[m, 1] * y
    return best


@njit(cache=True)
def steady_rows_into(jacobian: Array, rotation: Array, limits: Array, rows: Array) -> None:
    """Fill what `steady_rows` returns."""
    for i in range(7):
        for k in range(3):
            rows[k, i] = jacobian[k, i] * limits[i]
        for k in range(2):
            turn = rotation[0, k] * jacobian[3, i] + rotation[1, k] * jacobian[4, i] + rotation[2, k] * jacobian[5, i]
            rows[3 + k, i] = turn * limits[i]


@njit(cache=True)
def steady_rows(jacobian: Array, rotation: Array, limits: Array) -> Array:
    """Return the rows that map shares of the speed limits to the racket's motion.

    Args:
        jacobian: (6, 7) of `kinematics.forward`.
        rotation: (3, 3) racket to table.
        limits: (7,) rad/s, speed limits; ones give the rows for joint speeds in rad/s.

    Returns:
        (5, 7): velocity of the face centre (m/s), and turning rates of its normal about the racket's x and y axes (rad/s).
    """
    rows = np.empty((5, 7))
    steady_rows_into(jacobian, rotation, limits, rows)
    return rows


def allocate(model: ArmModel, q: Array, velocity: Array, *, steady: bool = False) -> Array:
    """Compute the joint speeds that move the face centre with the least max |qdot_i| / limit_i. They may be beyond the limits.

    Args:
        model: The arm.
        q: (7,) rad, the posture.
        velocity: (3,) m/s in `table`.
        steady: Whether the face normal must not turn; otherwise its turning is free.

    Returns:
        (7,) rad/s.

    Raises:
        NoJointSpeeds: No joint speeds give this velocity.
        BadShape: An array has another shape.
        NotFinite: A number is NaN or infinite.
    """
    velocity = check_array("velocity", velocity, (3,)).copy()
    rows, shares = steady_rows(model.jacobian(q), model.racket(q)[1], np.array(model.speed_limits)), np.empty(7)
    if steady:
        ratio = least_shares_steady(rows, np.append(velocity, [0.0, 0.0]), shares)
    else:
        ratio = least_shares(rows[:3].copy(), velocity, shares)
    if math.isinf(ratio) or np.abs(rows[:3] @ shares - velocity).max() > 1e-6:
        raise NoJointSpeeds(q, velocity)
    return shares * model.speed_limits
