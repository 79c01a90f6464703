"""Kernels of the arm's geometry: from joint positions to the racket and the bodies.

Every joint has a frame whose z axis is the axis of the joint. From one joint to the next leads a constant placement, then the motion of the
joint: a turn about z, or a shift along z where it is linear. The kernels do not check their arguments. Vectors are in the frame `table`
unless said otherwise. Lengths of arrays: n joints, m capsules.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.states import Array


class Chain(NamedTuple):
    """The constants of the arm's geometry.

    Attributes:
        linear: (n,) whether a joint is linear.
        rotations: (n, 3, 3) frame of a joint to that of the joint before; of the first one to table.
        positions: (n, 3) m, origin of the same.
        mount_rotation: (3, 3) racket to the frame of the last joint.
        mount_position: (3,) m, face centre in the frame of the last joint.
    """

    linear: npt.NDArray[np.bool_]
    rotations: Array
    positions: Array
    mount_rotation: Array
    mount_position: Array


class Bodies(NamedTuple):
    """The bodies of an arm as capsules, all that is within a radius of a segment, and the racket as a disc.

    Kept apart from `Chain`, because each array in an argument costs a call 10 ns.

    Attributes:
        chain: The joints that move them.
        levers: (n,) m for a turning joint, the largest distance from its axis of any point that it moves; 1 for a linear one.
        starts: (m, 3) m, where the segment of a capsule begins, in the frame of its joint.
        ends: (m, 3) m, where it ends.
        radii: (m,) m, of the capsules.
        reaches: (m,) m, radius of the sphere around the middle of a capsule.
        owners: (m,) index of the joint that moves the capsule; -1 for one that stands still, whose points are in table. In this order.
        pairs: (p, 2) capsules that must not touch each other; the second is -1 for the racket.
        rim: m, radius of the racket.
    """

    chain: Chain
    levers: Array
    starts: Array
    ends: Array
    radii: Array
    reaches: Array
    owners: npt.NDArray[np.int64]
    pairs: npt.NDArray[np.int64]
    rim: float


@njit(cache=True, inline="always")
def move_frame(i: int, q: float, linear: bool, placed: Array, at: Array, point: Array, rotation: Array) -> None:
    """Turn point (3,) and rotation (3, 3) of the frame before joint i into those of its own frame, in place.

    Args:
        i: Index of the joint.
        q: rad or m.
        linear: Whether it is linear.
        placed: Rotations of `Chain`.
        at: Positions of `Chain`.
        point: (3,) m; changed.
        rotation: (3, 3); changed.
    """
    c, s = (1.0, 0.0) if linear else (math.cos(q), math.sin(q))
    for k in range(3):
        a, b, d = rotation[k, 0], rotation[k, 1], rotation[k, 2]
        point[k] += a * at[i, 0] + b * at[i, 1] + d * at[i, 2]
        x = a * placed[i, 0, 0] + b * placed[i, 1, 0] + d * placed[i, 2, 0]
        y = a * placed[i, 0, 1] + b * placed[i, 1, 1] + d * placed[i, 2, 1]
        z = a * placed[i, 0, 2] + b * placed[i, 1, 2] + d * placed[i, 2, 2]
        rotation[k, 0], rotation[k, 1], rotation[k, 2] = c * x + s * y, c * y - s * x, z
        if linear:
            point[k] += q * z


@njit(cache=True, inline="always")
def begin_frame(point: Array, rotation: Array) -> None:
    """Fill point (3,) and rotation (3, 3) of the frame `table`."""
    for k in range(3):
        point[k] = 0.0
        for j in range(3):
            rotation[k, j] = 1.0 if j == k else 0.0


@njit(cache=True, inline="always")
def mount_racket(mount: Array, beyond: Array, point: Array, rotation: Array) -> None:
    """Turn point (3,) and rotation (3, 3) of the frame of the last joint into those of the racket, in place."""
    for k in range(3):
        a, b, c = rotation[k, 0], rotation[k, 1], rotation[k, 2]
        point[k] += a * beyond[0] + b * beyond[1] + c * beyond[2]
        for j in range(3):
            rotation[k, j] = a * mount[0, j] + b * mount[1, j] + c * mount[2, j]


@njit(cache=True)
def forward_into(q: Array, chain: Chain, point: Array, rotation: Array, jacobian: Array) -> None:
    """Fill what `forward` returns."""
    n = len(q)
    linear, placed, at, mount, beyond = chain
    begin_frame(point, rotation)
    for i in range(n):
        move_frame(i, q[i], linear[i], placed, at, point, rotation)
        for k in range(3):  # the upper rows hold the joint's position until the face centre is known
            jacobian[k, i], jacobian[3 + k, i] = point[k], rotation[k, 2]
    mount_racket(mount, beyond, point, rotation)
    for i in range(n):
        ax, ay, az = jacobian[3, i], jacobian[4, i], jacobian[5, i]
        if linear[i]:
            jacobian[0, i], jacobian[1, i], jacobian[2, i] = ax, ay, az
            jacobian[3, i], jacobian[4, i], jacobian[5, i] = 0.0, 0.0, 0.0
        else:
            x, y, z = point[0] - jacobian[0, i], point[1] - jacobian[1, i], point[2] - jacobian[2, i]
            jacobian[0, i], jacobian[1, i], jacobian[2, i] = ay * z - az * y, az * x - ax * z, ax * y - ay * x


@njit(cache=True)
def forward(q: Array, chain: Chain) -> tuple[Array, Array, Array]:
    """Compute the racket's pose and Jacobian.

    Args:
        q: (n,) rad or m.
        chain: The geometry.

    Returns:
        Position (3,) m of the face centre, rotation (3, 3) racket to table, and Jacobian (6, n) from joint speeds to the velocity of the
        face centre (m/s) and the angular velocity (rad/s).
    """
    point, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, len(q)))
    forward_into(q, chain, point, rotation, jacobian)
    return point, rotation, jacobian


@njit(cache=True, inline="always")
def place_bodies(q: Array, bodies: Bodies, starts: Array, ends: Array, point: Array, rotation: Array) -> None:
    """Fill where the bodies are.

    Args:
        q: (n,) rad or m.
        bodies: Of the arm.
        starts: (m, 3) m; filled with where the segments begin.
        ends: (m, 3) m; filled with where they end.
        point: (3,) m; filled with the face centre.
        rotation: (3, 3); filled with the racket's rotation.
    """
    linear, placed, at, mount, beyond = bodies.chain
    own_starts, own_ends, owners = bodies.starts, bodies.ends, bodies.owners
    begin_frame(point, rotation)
    joint, count = -1, len(owners)
    for m in range(count):
        while joint < owners[m]:
            joint += 1
            move_frame(joint, q[joint], linear[joint], placed, at, point, rotation)
        for k in range(3):
            a, b, c = rotation[k, 0], rotation[k, 1], rotation[k, 2]
            starts[m, k] = point[k] + a * own_starts[m, 0] + b * own_starts[m, 1] + c * own_starts[m, 2]
            ends[m, k] = point[k] + a * own_ends[m, 0] + b * own_ends[m, 1] + c * own_ends[m, 2]
    while joint < len(q) - 1:
        joint += 1
        move_frame(joint, q[joint], linear[joint], placed, at, point, rotation)
    mount_racket(mount, beyond, point, rotation)
