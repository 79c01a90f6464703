"""Forward kinematics of the arm: kernels that compute the pose of the racket and of the arm's bodies from joint positions.

Every joint has a frame whose z axis is the axis of the joint. The frame of a joint follows from that of the joint before by a constant
placement and then the motion of the joint: a rotation about z, or a translation along z if the joint is linear. The kernels do not check
their arguments. Vectors are in the frame `table` unless said otherwise. Lengths of arrays: n joints, m capsules.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.states import Array


class Chain(NamedTuple):
    """Geometry of an arm with n joints: constant placements of the joint frames and of the racket.

    Attributes:
        linear: (n,) whether a joint is linear.
        rotations: (n, 3, 3) rotation from the frame of a joint at position 0 to the frame of the joint before it; the first one to `table`.
        positions: (n, 3) m, origin of the frame of a joint in the frame of the joint before it; the first one in `table`.
        mount_rotation: (3, 3) rotation from the racket to the frame of the last joint.
        mount_position: (3,) m, centre of the racket's face in the frame of the last joint.
    """

    linear: npt.NDArray[np.bool_]
    rotations: Array
    positions: Array
    mount_rotation: Array
    mount_position: Array


class Bodies(NamedTuple):
    """Bodies of an arm for collision checks: the links as capsules, and the racket as a disc.

    A capsule is the set of all points within a radius of a line segment. The bodies are not a part of `Chain`, because each array in an
    argument makes a call 10 ns slower.

    Attributes:
        chain: Geometry of the joints that move the bodies.
        levers: (n,) for a revolute joint the largest distance in m from its axis of any point that it moves; 1 for a linear joint.
        starts: (m, 3) m, first end of each capsule's segment, in the frame of its joint.
        ends: (m, 3) m, second end of each capsule's segment, in the frame of its joint.
        radii: (m,) m, radius of each capsule.
        reaches: (m,) m, radius of the sphere around the middle of a capsule that contains it.
        owners: (m,) index of the joint that moves the capsule, in increasing order; -1 for a capsule that does not move, which is in
            `table`.
        pairs: (p, 2) indices of capsules that must not touch each other; the second is -1 for the racket.
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
    """Change the pose of the frame before joint i to the pose of the frame of joint i, in place.

    Args:
        i: Index of the joint.
        q: rad or m, position of the joint.
        linear: Whether the joint is linear.
        placed: (n, 3, 3) `Chain.rotations`.
        at: (n, 3) m, `Chain.positions`.
        point: (3,) m, origin of the frame in `table`; changed in place.
        rotation: (3, 3) rotation from the frame to `table`; changed in place.
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
    """Set point (3,) to zero and rotation (3, 3) to the unit matrix, the pose of the frame `table` in itself."""
    for k in range(3):
        point[k] = 0.0
        for j in range(3):
            rotation[k, j] = 1.0 if j == k else 0.0


@njit(cache=True, inline="always")
def mount_racket(mount: Array, beyond: Array, point: Array, rotation: Array) -> None:
    """Change the pose of the last joint's frame to the pose of the racket, in place.

    Args:
        mount: (3, 3) `Chain.mount_rotation`.
        beyond: (3,) m, `Chain.mount_position`.
        point: (3,) m, origin of the frame in `table`; changed in place.
        rotation: (3, 3) rotation from the frame to `table`; changed in place.
    """
    for k in range(3):
        a, b, c = rotation[k, 0], rotation[k, 1], rotation[k, 2]
        point[k] += a * beyond[0] + b * beyond[1] + c * beyond[2]
        for j in range(3):
            rotation[k, j] = a * mount[0, j] + b * mount[1, j] + c * mount[2, j]


@njit(cache=True)
def forward_into(q: Array, chain: Chain, point: Array, rotation: Array, jacobian: Array) -> None:
    """Compute the racket's pose and Jacobian into given arrays.

    Args:
        q: (n,) rad or m, joint positions.
        chain: Geometry of the arm.
        point: (3,) m, output: filled with the position of the face centre in `table`.
        rotation: (3, 3) output: filled with the rotation from racket to `table`.
        jacobian: (6, n) output: filled with the Jacobian from joint speeds to the velocity of the face centre (m/s) and the angular
            velocity (rad/s) in `table`.
    """
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
        q: (n,) rad or m, joint positions.
        chain: Geometry of the arm.

    Returns:
        Position (3,) m of the face centre in `table`, rotation (3, 3) from racket to `table`, and Jacobian (6, n) from joint speeds to the
        velocity of the face centre (m/s) and the angular velocity (rad/s) in `table`.
    """
    point, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, len(q)))
    forward_into(q, chain, point, rotation, jacobian)
    return point, rotation, jacobian


@njit(cache=True, inline="always")
def place_bodies(q: Array, bodies: Bodies, starts: Array, ends: Array, point: Array, rotation: Array) -> None:
    """Compute where the capsules and the racket are in `table`.

    Args:
        q: (n,) rad or m, joint positions.
        bodies: Capsules and racket of the arm.
        starts: (m, 3) m, output: filled with the first ends of the capsules' segments.
        ends: (m, 3) m, output: filled with the second ends of the capsules' segments.
        point: (3,) m, output: filled with the centre of the racket's face.
        rotation: (3, 3) output: filled with the rotation from racket to `table`.
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
