"""Model of an arm with its racket: geometry, limits and dynamics, made from a URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike

import numpy as np
import pinocchio as pin
from tt_core.constants import GRAVITY
from tt_core.errors import check_array, check_range
from tt_core.robots import read_arm
from tt_core.states import Array

from .arm_urdf.bodies import capsules
from .arm_urdf.geometry import bodies, chain, joint_frames, links
from .arm_urdf.urdf import RACKET_LINK, CheckedUrdf, UrdfError, UrdfFailure, UrdfOptions, read_urdf
from .description import placed_description
from .dynamics import Links
from .ik.closed_form import ElbowArm, elbow_arm
from .ik.posture_search import Atlas, make_atlas
from .joints import NO_ACCELERATION_LIMIT, NO_JERK_LIMIT, JointLimits
from .kinematics import Bodies, Chain, forward
from .safety.body_pairs import find_pairs

__all__ = ["ArmModel", "UrdfError", "UrdfFailure", "UrdfOptions"]


def base_placement(base: Sequence[float]) -> pin.SE3:
    """Return the pose of the arm's root link in `table`.

    Args:
        base: x, y, z (m) and yaw (rad), or x, y, z (m) and roll, pitch, yaw (rad).

    Raises:
        BadShape: There are neither 4 nor 6 numbers.
        NotFinite: A number is NaN or infinite.
    """
    if np.shape(base) == (4,):
        x, y, z, yaw = check_array("base", base, (4,))
        return pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, float(yaw)), np.array([x, y, z]))
    values = check_array("base", base, (6,))
    return pin.SE3(pin.rpy.rpyToMatrix(*values[3:]), values[:3])


def mount_placement(mount: Sequence[float]) -> pin.SE3:
    """Return the pose of the racket in the frame of the tip, the link on which it is mounted.

    Args:
        mount: Distance (m) along the z axis of the tip and angle (rad) about its y axis, or x, y, z (m) and roll, pitch, yaw (rad).

    Raises:
        BadShape: There are neither 2 nor 6 numbers.
        NotFinite: A number is NaN or infinite.
    """
    if np.shape(mount) == (2,):
        ahead, tilt = check_array("mount", mount, (2,))
        return pin.SE3(pin.rpy.rpyToMatrix(0.0, float(tilt), 0.0), np.array([0.0, 0.0, ahead]))
    values = check_array("mount", mount, (6,))
    return pin.SE3(pin.rpy.rpyToMatrix(*values[3:]), values[:3])


def _pinocchio(description: CheckedUrdf, base: pin.SE3) -> pin.Model:
    """Return pinocchio's model of the arm in `table`, from the URDF without its shapes, which the model does not need."""
    robot = ET.fromstring(description.xml)
    for link in robot.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
    try:
        model = pin.buildModelFromXML(ET.tostring(robot, encoding="unicode"))
    except (ValueError, RuntimeError) as error:
        raise UrdfError(UrdfFailure.NOT_READABLE, urdf=description.urdf, error=error) from error
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    model.jointPlacements[1] = base * model.jointPlacements[1]
    for frame in model.frames:
        if frame.parentJoint == 0 and frame.name != "universe":
            frame.placement = base * frame.placement
    return model


def _limits(description: CheckedUrdf) -> JointLimits:
    joints = description.joints
    return JointLimits(
        tuple(joint.name for joint in joints),
        tuple(joint.unit for joint in joints),
        np.array([(joint.low, joint.high) for joint in joints]),
        np.array([joint.speed for joint in joints]),
        np.array([joint.acceleration or NO_ACCELERATION_LIMIT for joint in joints]),
        np.array([joint.jerk or NO_JERK_LIMIT for joint in joints]),
        np.array([joint.effort for joint in joints]),
    )


def _waiting(waiting: Sequence[float] | None, limits: JointLimits) -> Array:
    """Return the waiting posture; if none is given, the middle of each joint's range. Raise OutOfRange for a joint beyond its limit."""
    if waiting is None:
        return limits.position.mean(axis=1)
    posture = check_array("waiting", waiting, (len(limits.names),))
    for name, value, (low, high) in zip(limits.names, posture, limits.position, strict=True):
        check_range(f"waiting position of joint {name}", value, low, high)
    return posture


@dataclass(frozen=True, eq=False)
class ArmModel:
    """Model of an arm with a racket. The racket's face centre and face normal are the origin and the z axis of the frame `racket`.

    Attributes:
        limits: Limits of the n joints, from the URDF.
        waiting: (n,) rad or m, joint positions at which the arm waits for a ball.
        chain: Geometry of the joints, in the form that kernels take.
        bodies: Capsules and racket that must not touch anything, in the form that kernels take.
        links: Masses and inertias of the moving bodies, in the form that kernels take.
        pinocchio: Pinocchio's model of the same arm in `table`, with its dynamics.
        closed_form: Constants of the closed-form inverse kinematics; None for an arm that has none.
        base: Pose of the root link of the URDF in `table`.
        description: The checked URDF, with the racket, from which the model was made.
    """

    limits: JointLimits
    waiting: Array
    chain: Chain
    bodies: Bodies
    links: Links
    pinocchio: pin.Model
    closed_form: ElbowArm | None
    base: pin.SE3
    description: CheckedUrdf

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n joints, from base to racket."""
        return self.limits.names

    @property
    def position_limits(self) -> Array:
        """Lowest and highest position of each joint, (n, 2) rad or m."""
        return self.limits.position

    @property
    def speed_limits(self) -> Array:
        """Speed limits of the joints, (n,) rad/s or m/s, for both directions."""
        return self.limits.speed

    @property
    def torque_limits(self) -> Array:
        """Rated torques (N m) or forces (N) of the joints, (n,)."""
        return self.limits.effort

    @classmethod
    def pa10(
        cls,
        base: Sequence[float] | None = None,
        mount: Sequence[float] | None = None,
        waiting: Sequence[float] | None = None,
        urdf: str | None = None,
    ) -> ArmModel:
        """Return the model of the Mitsubishi PA10, whose joints are s1, s2, s3, e1, e2, w1, w2.

        Args:
            base: Pose of the root link in `table`, as in `from_urdf`; None for that of the PA10's arm file.
            mount: Pose of the racket on the flange, as in `from_urdf`; None for that of the arm file.
            waiting: (7,) rad, joint positions at which the arm waits for a ball; None for those of the arm file.
            urdf: Path of another URDF whose flange has the same link name; None for that of the arm file.

        Raises:
            TtError: An argument or the URDF cannot be used, see `from_urdf`.
        """
        given, path = read_arm("pa10")
        return cls.from_urdf(
            urdf or path,
            given.tip,
            given.base if base is None else base,
            given.mount if mount is None else mount,
            given.waiting if waiting is None else waiting,
        )

    @classmethod
    def from_urdf(
        cls,
        path: str | PathLike[str],
        tip: str | None = None,
        base: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
        mount: Sequence[float] | None = None,
        waiting: Sequence[float] | None = None,
        options: UrdfOptions | None = None,
    ) -> ArmModel:
        """Return the model of a serial arm with 5 to 8 revolute, continuous or prismatic joints.

        Joints that are not between the root and the tip, for example those of a gripper, are fixed. If the tip is the link `racket`, or a
        link `racket` is fixed to the tip, the URDF describes the racket; otherwise a usual racket is added.

        Args:
            path: Path of the URDF.
            tip: Name of the link on which the racket is mounted; None for the only link to which no other link is attached.
            base: Pose of the root link in `table`: x, y, z (m) and yaw (rad), or x, y, z (m) and roll, pitch, yaw (rad).
            mount: Pose of the racket on the tip: its distance (m) along the z axis of the tip and its angle (rad) about the y axis of the
                tip, or x, y, z (m) and roll, pitch, yaw (rad). None keeps the pose of the URDF's own racket, or puts a racket at the tip.
            waiting: (n,) rad or m, joint positions at which the arm waits for a ball; None for the middle of each joint's range.
            options: Limits that replace or complete those of the URDF, joints to fix, and links to leave out; None for no changes.

        Raises:
            UrdfError: The URDF cannot be used.
            BadShape: An argument has another length.
            NotFinite: A number is NaN or infinite.
            OutOfRange: A waiting position is beyond its limit.
        """
        placed = base_placement(base)
        description = read_urdf(str(path), tip, None if mount is None else mount_placement(mount), options or UrdfOptions())
        model, limits = _pinocchio(description, placed), _limits(description)
        posture, frames = _waiting(waiting, limits), joint_frames(model)
        joints = chain(model, frames)
        parts = bodies(model, frames, joints, capsules(description))
        parts = parts._replace(pairs=find_pairs(parts, limits.position))
        closed_form = elbow_arm(model, model.frames[model.getFrameId(RACKET_LINK, pin.FrameType.BODY)].placement)
        return cls(limits, posture, joints, parts, links(model, frames), model, closed_form, placed, description)

    @cached_property
    def atlas(self) -> Atlas:
        """The atlas: precomputed postures all over the limits of the joints, from which the posture search starts."""
        return make_atlas(self.chain, self.limits.position)

    @property
    def placed_description(self) -> str:
        """URDF of the arm for other programs: with the racket, and with the frame `table` as the root link."""
        return placed_description(self.description.xml, self.base)

    def racket(self, q: Array) -> tuple[Array, Array]:
        """Return position (3,) m of the face centre and rotation (3, 3) of the racket in `table`, for joint positions q (n,) rad or m."""
        position, rotation, _ = forward(check_array("q", q, (len(self.names),)).copy(), self.chain)
        return position, rotation

    def jacobian(self, q: Array) -> Array:
        """Return the Jacobian of the racket, (B.21) of the dissertation.

        Args:
            q: (n,) rad or m, joint positions.

        Returns:
            (6, n) matrix from joint speeds to the velocity of the face centre (m/s, rows 0 to 2) and the angular velocity of the racket
            (rad/s, rows 3 to 5) in `table`.
        """
        return forward(check_array("q", q, (len(self.names),)).copy(), self.chain)[2]
