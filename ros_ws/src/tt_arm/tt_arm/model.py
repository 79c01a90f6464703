"""The arm and its racket: geometry, limits and dynamics, from a URDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from importlib import resources

import numpy as np
import pinocchio as pin
from tt_core.constants import GRAVITY
from tt_core.errors import TtError, check_array, check_range
from tt_core.failures import Failure
from tt_core.states import Array

from .dynamics import Links
from .joints import ACCELERATION, JERK, JointLimits
from .kinematics import Chain, CollisionRadii, forward

URDF = resources.files(__package__) / "urdf" / "pa10.urdf"
BASE = (-0.80, 0.7625, -0.06, 0.0)  # m, m, m, rad: base_link in `table` as x, y, z, yaw; our choice: a 0.70 m pedestal behind the table
MOUNT = (0.15, 0.5 * np.pi)  # m beyond the flange on its axis, rad about its y axis; our choice: the normal is the flange's x axis
# rad; found by a search: leaves the most time for the catapult's balls at scales 3 to 5, and reaches the printed strokes within 0.4 s
WAITING = tuple(np.radians([-63.1, 63.9, 56.3, 110.5, -11.3, 85.3, 136.8]).tolist())
BLADE_ALLOWANCE = 0.005  # m beyond the racket's radius: a blade is 157 mm long and 150 mm wide, and the URDF's disc has the width


class UrdfFailure(Enum):
    """Why a URDF cannot be used."""

    NOT_READABLE = "urdf = {urdf!r} cannot be read: {error}"
    WRONG_JOINTS = "urdf = {urdf!r} has {count} joints {joints}, wanted 7 revolute ones and a link named racket"
    WRONG_AXIS = "urdf = {urdf!r}: joint {joint} is a {kind}, wanted one about {axis}"
    WRONG_PLACE = "urdf = {urdf!r}: joint {joint} stands at {place} m, wanted straight above the joint before"
    WRONG_LIMITS = "urdf = {urdf!r}: joint {joint} has limits {low:g} to {high:g} {unit}, {speed:g} {unit}/s, {effort:g} N m"
    NO_COLLISION_RADIUS = "urdf = {urdf!r}: link {link} has no collision element with a radius; a cylinder, a capsule or a sphere is wanted"


class UrdfError(TtError):
    """A URDF that cannot be used.

    Attributes:
        failure: The reason.
    """

    def __init__(self, code: UrdfFailure, **values: object) -> None:
        """Keep the reason; its sentence is the text of the error."""
        self.failure = Failure(code, **values)
        super().__init__(str(self.failure))


def _read(urdf: str) -> pin.Model:
    """Return pinocchio's model of an arm with seven joints that turn about z and y in turn; raise UrdfError for any other."""
    try:
        model = pin.buildModelFromUrdf(urdf)
    except (ValueError, RuntimeError) as error:
        raise UrdfError(UrdfFailure.NOT_READABLE, urdf=urdf, error=error) from error
    if not (model.nq == model.nv == 7 and model.existFrame("racket")):
        raise UrdfError(UrdfFailure.WRONG_JOINTS, urdf=urdf, count=model.nq, joints=list(model.names[1:]))
    for i in range(1, 8):
        name, kind, placed = model.names[i], model.joints[i].shortname(), model.jointPlacements[i]
        if kind != ("JointModelRZ" if i % 2 else "JointModelRY"):
            raise UrdfError(UrdfFailure.WRONG_AXIS, urdf=urdf, joint=name, kind=kind.removeprefix("JointModel"), axis="z" if i % 2 else "y")
        if np.abs(placed.rotation - np.eye(3)).max() > 1e-9 or np.abs(placed.translation[:2]).max() > 1e-9:
            raise UrdfError(UrdfFailure.WRONG_PLACE, urdf=urdf, joint=name, place=placed.translation)
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    return model


def _limits(urdf: str, model: pin.Model) -> JointLimits:
    """Return the limits of the URDF, and the usual ones of acceleration and jerk, which a URDF does not hold."""
    names, n = tuple(model.names[1:]), len(model.names) - 1
    units = tuple("m" if joint.shortname().startswith("JointModelP") else "rad" for joint in list(model.joints)[1:])
    rows = zip(names, units, model.lowerPositionLimit, model.upperPositionLimit, model.velocityLimit, model.effortLimit, strict=True)
    for name, unit, low, high, speed, effort in rows:
        if not (low < high and 0.0 < speed < 100.0 and 0.0 < effort < 1e5):
            values = {"unit": unit, "low": low, "high": high, "speed": speed, "effort": effort}
            raise UrdfError(UrdfFailure.WRONG_LIMITS, urdf=urdf, joint=name, **values)
    position = np.column_stack([model.lowerPositionLimit, model.upperPositionLimit])
    return JointLimits(names, units, position, model.velocityLimit, np.full(n, ACCELERATION), np.full(n, JERK), model.effortLimit)


def _collision_radii(urdf: str, model: pin.Model) -> CollisionRadii:
    """Return the radii of the URDF's collision elements, the largest one of each body."""
    radii = dict.fromkeys(CollisionRadii._fields, 0.0)
    for shape in pin.buildGeomFromUrdf(model, urdf, pin.GeometryType.COLLISION).geometryObjects:
        link, radius = model.frames[shape.parentFrame].name, getattr(shape.geometry, "radius", None)
        if radius is None:
            raise UrdfError(UrdfFailure.NO_COLLISION_RADIUS, urdf=urdf, link=link)
        joints = shape.parentJoint  # how many joints lie between the base and the link
        body = "racket" if link == "racket" else "pedestal" if joints < 2 else "upper_arm" if joints < 4 else "forearm"
        radii[body] = max(radii[body], radius)
    for body, radius in radii.items():
        if radius == 0.0:
            raise UrdfError(UrdfFailure.NO_COLLISION_RADIUS, urdf=urdf, link=body)
    radii["racket"] += BLADE_ALLOWANCE
    return CollisionRadii(**radii)


def _within_limits(waiting: Array, limits: JointLimits) -> Array:
    """Return the waiting posture; raise OutOfRange for an angle beyond its limit."""
    for name, angle, (low, high) in zip(limits.names, waiting, limits.position, strict=True):
        check_range(f"waiting angle of joint {name}", angle, low, high)
    return waiting


def _links(model: pin.Model) -> Links:
    placements, inertias = list(model.jointPlacements)[1:], list(model.inertias)[1:]
    return Links(
        offset=np.array([placement.translation[2] for placement in placements]),
        mass=np.array([link.mass for link in inertias]),
        centre=np.array([link.lever for link in inertias]),
        inertia=np.array([link.inertia[np.tril_indices(3)] for link in inertias]),
    )


@dataclass(frozen=True, eq=False)
class ArmModel:
    """An arm with a racket, whose face centre and normal are the origin and the z axis of the frame `racket`.

    The joints of the PA10 are s1, s2, s3, e1, e2, w1, w2.

    Attributes:
        limits: Of the joints, from the URDF.
        waiting: (7,) rad, where the arm waits for a ball.
        chain: The geometry, for kernels.
        links: The moving bodies, for kernels.
        pinocchio: Pinocchio's model of the same arm, with its dynamics.
    """

    limits: JointLimits
    waiting: Array
    chain: Chain
    links: Links
    pinocchio: pin.Model

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the joints."""
        return self.limits.names

    @property
    def position_limits(self) -> Array:
        """Return the lowest and highest position of each joint, (7, 2) rad."""
        return self.limits.position

    @property
    def speed_limits(self) -> Array:
        """Return the speed limits, (7,) rad/s, both ways."""
        return self.limits.speed

    @property
    def torque_limits(self) -> Array:
        """Return the rated torques, (7,) N m at the joints."""
        return self.limits.effort

    @classmethod
    def pa10(
        cls, base: Sequence[float] = BASE, mount: Sequence[float] = MOUNT, waiting: Sequence[float] = WAITING, urdf: str = str(URDF)
    ) -> ArmModel:
        """Return the Mitsubishi PA10.

        Args:
            base: x, y, z (m) and yaw (rad) of base_link in `table`.
            mount: Distance (m) of the racket beyond the flange, and its angle (rad) about the flange's y axis.
            waiting: (7,) rad, where the arm waits for a ball.
            urdf: Path of a description with the structure of the PA10. Its numbers may be others.

        Raises:
            BadShape: An argument has another length.
            NotFinite: A number is NaN or infinite.
            OutOfRange: A waiting angle is beyond its limit.
            UrdfError: The URDF cannot be used.
        """
        x, y, z, yaw = check_array("base", base, (4,))
        ahead, tilt = check_array("mount", mount, (2,))
        model = _read(urdf)
        limits, radii = _limits(urdf, model), _collision_radii(urdf, model)
        lengths = [sum(model.jointPlacements[i].translation[2] for i in pair) for pair in ((1, 2), (3, 4), (5, 6), (7,))]
        racket = pin.SE3(pin.rpy.rpyToMatrix(0.0, float(tilt), 0.0), np.array([0.0, 0.0, ahead]))
        model.frames[model.getFrameId("racket")].placement = racket
        base_rotation, base_position = pin.rpy.rpyToMatrix(0.0, 0.0, float(yaw)), np.array([x, y, z])
        model.jointPlacements[1] = pin.SE3(base_rotation, base_position) * model.jointPlacements[1]
        constants = base_rotation, base_position, np.array(lengths), racket.rotation, racket.translation, np.array(radii)
        return cls(
            limits=limits,
            waiting=_within_limits(check_array("waiting", waiting, (7,)), limits),
            chain=Chain(*(np.array(constant, order="C") for constant in constants)),
            links=_links(model),
            pinocchio=model,
        )

    def racket(self, q: Array) -> tuple[Array, Array]:
        """Return position (3,) m of the face centre and rotation (3, 3) of the racket in `table`, for q (7,) rad."""
        position, rotation, _ = forward(check_array("q", q, (7,)).copy(), self.chain)
        return position, rotation

    def jacobian(self, q: Array) -> Array:
        """Return the Jacobian (6, 7), (B.21), from joint speeds to velocity of the face centre (m/s) and angular velocity (rad/s)."""
        return forward(check_array("q", q, (7,)).copy(), self.chain)[2]
