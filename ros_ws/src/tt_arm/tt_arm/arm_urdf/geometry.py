"""Compute the constants that the kernels take (geometry, inertia, bodies) from pinocchio's model of an arm and its collision bodies."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from tt_core.constants import RACKET_RADIUS
from tt_core.states import Array

from ..dynamics import Links
from ..kinematics import Bodies, Chain
from .bodies import Capsule, merged
from .urdf import RACKET_LINK

BLADE_ALLOWANCE = 0.005  # m beyond the racket's radius: a blade is 157 mm long and 150 mm wide, and the disc has the width
ABOUT = 1e-3  # m; a body whose segment is nearer to a joint's axis than this counts as lying along it
RACKET_DISC_RADIUS = RACKET_RADIUS + BLADE_ALLOWANCE  # m, radius of the disc that represents the racket
HANDLE_RADIUS = 0.018  # m, half the width of a usual handle


class JointFrames(NamedTuple):
    """Frames of the n joints of an arm, in each of which the z axis is the axis of the joint.

    Attributes:
        placements: Pose of the frame of each joint in that of the joint before, at position 0; that of the first one in `table`.
        own: Pose of the frame of each joint in the frame that pinocchio has for the joint.
        linear: (n,) whether a joint is linear.
    """

    placements: list[pin.SE3]
    own: list[pin.SE3]
    linear: npt.NDArray[np.bool_]


def joint_frames(model: pin.Model) -> JointFrames:
    """Compute the frames of the joints of pinocchio's model, in the order from base to racket."""
    data = model.createData()
    zero = pin.neutral(model)
    pin.computeJointJacobians(model, data, zero)
    own, linear = [], []
    for i in range(1, model.njoints):
        motion = data.oMi[i].actInv(pin.Motion(data.J[:, i - 1]))  # of the joint at unit speed, in its own frame
        is_linear = bool(np.linalg.norm(motion.angular) < 0.5)
        axis = motion.linear if is_linear else motion.angular
        own.append(pin.SE3(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis).normalized().matrix(), np.zeros(3)))
        linear.append(is_linear)
    before = [pin.SE3.Identity(), *own]
    placements = [before[i].inverse() * model.jointPlacements[i + 1] * own[i] for i in range(len(own))]
    return JointFrames(placements, own, np.array(linear))


def links(model: pin.Model, frames: JointFrames) -> Links:
    """Return masses and inertias of the bodies that the joints move.

    Args:
        model: Pinocchio's model of the arm.
        frames: Frames of its joints.
    """
    inertias = [own.actInv(inertia) for own, inertia in zip(frames.own, list(model.inertias)[1:], strict=True)]
    return Links(
        mass=np.array([link.mass for link in inertias]),
        centre=np.array([link.lever for link in inertias]),
        inertia=np.array([link.inertia[np.tril_indices(3)] for link in inertias]),
    )


def chain(model: pin.Model, frames: JointFrames) -> Chain:
    """Return the geometry of the joints and of the racket's mount.

    Args:
        model: Pinocchio's model of the arm, placed in `table`.
        frames: Frames of its joints.
    """
    racket = model.frames[model.getFrameId(RACKET_LINK, pin.FrameType.BODY)]
    mount = frames.own[-1].inverse() * racket.placement
    return Chain(
        linear=frames.linear,
        rotations=np.array([placement.rotation for placement in frames.placements]),
        positions=np.array([placement.translation for placement in frames.placements]),
        mount_rotation=np.array(mount.rotation, order="C"),
        mount_position=np.array(mount.translation),
    )


def bodies(model: pin.Model, frames: JointFrames, joints: Chain, capsules: dict[str, list[Capsule]]) -> Bodies:
    """Return the bodies of the arm for collision checks, still without the pairs that must not touch each other.

    Args:
        model: Pinocchio's model of the arm, placed in `table`.
        frames: Frames of its joints.
        joints: Geometry of the joints, the result of `chain`.
        capsules: Capsules of each link by its name, in the frame of the link.
    """
    n = len(frames.own)
    owned: list[tuple[int, Capsule]] = []
    for link, parts in capsules.items():
        frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
        owner = frame.parentJoint - 1
        place = frame.placement if owner < 0 else frames.own[owner].inverse() * frame.placement
        if link == RACKET_LINK:  # what is within the disc is the blade
            parts = [part for part in parts if max(np.hypot(*part.start[:2]), np.hypot(*part.end[:2])) + part.radius > RACKET_DISC_RADIUS]
        owned += [_inwards(owner, part.moved(place), frames) for part in parts]
    owned += [_inwards(n - 1, capsule, frames) for capsule in _handle(model, frames, joints.mount_position)]
    owned = [(owner, capsule) for owner in range(-1, n) for capsule in merged([c for own, c in owned if own == owner])]
    count = len(owned)
    unfinished = Bodies(
        chain=joints,
        levers=np.ones(n),
        starts=np.array([capsule.start for _, capsule in owned]).reshape(count, 3),
        ends=np.array([capsule.end for _, capsule in owned]).reshape(count, 3),
        radii=np.array([capsule.radius for _, capsule in owned]),
        reaches=np.array([capsule.radius + 0.5 * float(np.linalg.norm(capsule.end - capsule.start)) for _, capsule in owned]),
        owners=np.array([owner for owner, _ in owned], dtype=np.int64),
        pairs=np.zeros((0, 2), np.int64),
        rim=RACKET_DISC_RADIUS,
    )
    ranges = np.maximum(np.abs(model.lowerPositionLimit), np.abs(model.upperPositionLimit))
    return unfinished._replace(levers=_levers(unfinished, ranges))


def _inwards(owner: int, capsule: Capsule, frames: JointFrames) -> tuple[int, Capsule]:
    """Return the index of the joint that moves a capsule, and the capsule in the frame of this joint.

    It is `owner`, or an earlier joint if the capsule lies along the axis of `owner`, whose rotation then does not move it.
    """
    while owner >= 0 and not frames.linear[owner] and max(np.hypot(*capsule.start[:2]), np.hypot(*capsule.end[:2])) < ABOUT:
        capsule, owner = capsule.moved(frames.placements[owner]), owner - 1
    return owner, capsule


def _handle(model: pin.Model, frames: JointFrames, face: Array) -> list[Capsule]:
    """Return a capsule for the handle, from the link on which the racket is mounted towards the face centre, up to the rim."""
    parent = model.frames[model.frames[model.getFrameId(RACKET_LINK, pin.FrameType.BODY)].parentFrame]
    flange = parent
    while flange.type != pin.FrameType.BODY and flange.parentFrame != 0:
        flange = model.frames[flange.parentFrame]
    if flange.parentJoint != len(frames.own):
        return []
    start = frames.own[-1].inverse().act(flange.placement.translation)
    way = face - start
    length = float(np.linalg.norm(way))
    return [Capsule(start, start + way * (1.0 - RACKET_DISC_RADIUS / length), HANDLE_RADIUS)] if length > RACKET_DISC_RADIUS else []


def _levers(bodies: Bodies, ranges: Array) -> Array:
    """Return `Bodies.levers`; ranges (n,) m are the largest distances from 0 that linear joints move."""
    n = len(bodies.chain.linear)
    owned = [(owner, m) for m, owner in enumerate(bodies.owners)] + [(n - 1, -1)]
    return np.array([max([1e-3, *(lever(bodies, ranges, i, m) for owner, m in owned if owner >= i)]) for i in range(n)])


def lever(bodies: Bodies, ranges: Array, joint: int, m: int) -> float:
    """Return an upper bound of the distance (m) of any point of a body from the axis of a joint that moves it; 1 for a linear joint.

    Args:
        bodies: Capsules and racket of the arm; `levers` is not used.
        ranges: (n,) m, largest distance from 0 that each linear joint moves.
        joint: Index of the joint.
        m: Index of the capsule; -1 for the racket.
    """
    chain = bodies.chain
    if chain.linear[joint]:
        return 1.0
    if m < 0:
        owner, points, radius = len(chain.linear) - 1, chain.mount_position[None], bodies.rim
    else:
        owner, points, radius = int(bodies.owners[m]), np.array([bodies.starts[m], bodies.ends[m]]), float(bodies.radii[m])
    if owner == joint:
        return float(np.hypot(points[:, 0], points[:, 1]).max()) + radius
    way = 0.0  # m, from the axis of the joint to the origin of joint k at most
    for k in range(joint + 1, owner + 1):
        at = chain.positions[k]
        way += math.hypot(at[0], at[1]) if k == joint + 1 else float(np.linalg.norm(at))
        way += ranges[k] if chain.linear[k] else 0.0
    return way + float(np.linalg.norm(points, axis=1).max()) + radius
