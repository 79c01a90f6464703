"""Closed-form inverse kinematics for arms with a spherical shoulder, an elbow and a spherical wrist, such as the PA10.

The rotation of the flange of such an arm is R = Rz(q1) Ry(q2) Rz(q3) Ry(q4) Rz(q5) Ry(q6) Rz(q7), dissertation (B.1)-(B.8), and there is no
lateral offset between successive joints. `elbow_search` finds the best posture of such an arm in 0.4 of the time that `posture_search`,
which works for any arm, needs (`scripts/bench arms`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numba import njit
from tt_core.states import Array

STRAIGHT = 1e-9  # m or rad, largest deviation of a joint's pose from that of the closed form


class ElbowArm(NamedTuple):
    """Geometry of an arm with a spherical shoulder, an elbow and a spherical wrist.

    Attributes:
        base_rotation: (3, 3) rotation from the frame before the first joint to `table`.
        base_position: (3,) m, origin of this frame in `table`.
        lengths: (4,) m, l_b, l_s, l_e, l_w of the dissertation's Appendix B: from base to shoulder, to elbow, to wrist, to flange.
        mount_rotation: (3, 3) rotation from racket to flange.
        mount_position: (3,) m, centre of the racket's face in the frame of the flange.
    """

    base_rotation: Array
    base_position: Array
    lengths: Array
    mount_rotation: Array
    mount_position: Array


def elbow_arm(model: pin.Model, racket: pin.SE3) -> ElbowArm | None:
    """Return the geometry of an arm that has the closed-form inverse kinematics; None for any other arm.

    The closed form needs seven joints that rotate about z and y alternately, each on the z axis of the one before.

    Args:
        model: Pinocchio's model of the arm, its first joint placed in `table`.
        racket: Pose of the racket in the frame of the last joint.
    """
    if model.njoints != 8:
        return None
    for i in range(1, 8):
        placed = model.jointPlacements[i]
        if model.joints[i].shortname() != ("JointModelRZ" if i % 2 else "JointModelRY"):
            return None
        beside = i > 1 and max(np.abs(placed.rotation - np.eye(3)).max(), np.abs(placed.translation[:2]).max()) > STRAIGHT
        if beside:
            return None
    to_shoulder, to_3, to_elbow, to_5, to_wrist, to_7 = (float(model.jointPlacements[i].translation[2]) for i in range(2, 8))
    lengths = np.array([to_shoulder, to_3 + to_elbow, to_5 + to_wrist, to_7])
    base = model.jointPlacements[1]
    constants = base.rotation, base.translation, lengths, racket.rotation, racket.translation
    return ElbowArm(*(np.array(constant, order="C") for constant in constants))


@njit(cache=True)
def _rotate(rotation: Array, axis: int, c: float, s: float) -> None:
    """Multiply `rotation` (3, 3) in place from the right by Rz (axis 2) or Ry (axis 1) of the angle with the cosine c and the sine s."""
    i, j = (0, 1) if axis == 2 else (2, 0)
    for k in range(3):
        a, b = rotation[k, i], rotation[k, j]
        rotation[k, i] = c * a + s * b
        rotation[k, j] = c * b - s * a


@njit(cache=True)
def _point_along(rotation: Array, x: float, y: float, z: float, q: Array, i: int) -> None:
    """Compute q[i] and q[i + 1] >= 0 for which Rz Ry turns the z axis of `rotation` to the unit vector (x, y, z); apply them to it."""
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
def inverse(position: Array, rotation: Array, swivel: float, arm: ElbowArm, q: Array) -> bool:
    """Compute the joint angles for a racket pose and an angle of the elbow, in closed form.

    Positions of shoulder and wrist and the swivel angle determine the position of the elbow, which is on a circle about the line from
    shoulder to wrist. Then each pair of joints gives one link its direction, and the last joint rotates the flange about its axis.

    Args:
        position: (3,) m in `table`, centre of the racket's face.
        rotation: (3, 3) rotation from racket to `table`.
        swivel: rad, angle of the elbow about the line from shoulder to wrist; 0 is up.
        arm: Geometry of the arm.
        q: (7,) rad, output: filled with the joint angles. q2, q4 and q6 are not negative. The other postures with the same position of all
            links negate one or more of these and rotate the two joints beside each of them by pi.

    Returns:
        Whether the wrist is within reach; if not, `q` is not filled.
    """
    base_rotation, base_position, lengths, mount, beyond = arm
    flange, frame, line = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    upper, lower = lengths[1], lengths[2]
    distance = 0.0
    for k in range(3):
        for j in range(3):
            flange[k, j] = rotation[k, 0] * mount[j, 0] + rotation[k, 1] * mount[j, 1] + rotation[k, 2] * mount[j, 2]
            frame[k, j] = base_rotation[k, j]
        wrist = position[k] - flange[k, 0] * beyond[0] - flange[k, 1] * beyond[1] - flange[k, 2] * (beyond[2] + lengths[3])
        line[k] = wrist - base_position[k] - lengths[0] * frame[k, 2]  # from the shoulder to the wrist
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
    _point_along(frame, ex / upper, ey / upper, ez / upper, q, 0)
    _point_along(frame, (line[0] - ex) / lower, (line[1] - ey) / lower, (line[2] - ez) / lower, q, 2)
    _point_along(frame, flange[0, 2], flange[1, 2], flange[2, 2], q, 4)
    a = frame[0, 0] * flange[0, 0] + frame[1, 0] * flange[1, 0] + frame[2, 0] * flange[2, 0]
    b = frame[0, 1] * flange[0, 0] + frame[1, 1] * flange[1, 0] + frame[2, 1] * flange[2, 0]
    q[6] = math.atan2(b, a)
    return True
