"""The PA10 and its racket: geometry, limits, dynamics, from the URDF in this package."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources

import numpy as np
import pinocchio as pin
from tt_core.errors import TtError, check_array, check_range
from tt_core.states import Array

from .kinematics import Chain, forward

URDF = resources.files(__package__) / "urdf" / "pa10.urdf"
BASE = (-0.80, 0.7625, -0.06, 0.0)  # m, m, m, rad: base_link in `table` as x, y, z, yaw; our choice: a 0.70 m pedestal behind the table
MOUNT = (0.15, 0.5 * np.pi)  # m beyond the flange on its axis, rad about its y axis; our choice: the normal is the flange's x axis
# rad; found by a search: leaves the most time for the catapult's balls at scales 3 to 5, and reaches the printed strokes within 0.4 s
WAITING = tuple(np.radians([-63.1, 63.9, 56.3, 110.5, -11.3, 85.3, 136.8]).tolist())


def _read(urdf: str) -> pin.Model:
    """Raises TtError for what is no URDF, or not of seven joints that turn about z and y in turn."""
    try:
        model = pin.buildModelFromUrdf(urdf)
    except (ValueError, RuntimeError) as error:
        raise TtError(f"urdf = {urdf!r} cannot be read: {error}") from error
    if not (model.nq == model.nv == 7 and model.existFrame("racket")):
        raise TtError(f"urdf = {urdf!r} has {model.nq} joints {list(model.names[1:])}, wanted 7 revolute ones and a link named racket")
    for i in range(1, 8):
        kind, placed = model.joints[i].shortname(), model.jointPlacements[i]
        if kind != ("JointModelRZ" if i % 2 else "JointModelRY"):
            raise TtError(f"urdf = {urdf!r}: joint {model.names[i]} is a {kind[10:]}, wanted one about {'z' if i % 2 else 'y'}")
        if np.abs(placed.rotation - np.eye(3)).max() > 1e-9 or np.abs(placed.translation[:2]).max() > 1e-9:
            raise TtError(f"urdf = {urdf!r}: joint {model.names[i]} stands at {placed.translation} m, wanted straight above the one before")
    limits = zip(model.names[1:], model.lowerPositionLimit, model.upperPositionLimit, model.velocityLimit, model.effortLimit, strict=True)
    for name, low, high, speed, torque in limits:
        if not (low < high and 0.0 < speed < 100.0 and 0.0 < torque < 1e5):
            raise TtError(f"urdf = {urdf!r}: joint {name} has limits {low:g} to {high:g} rad, {speed:g} rad/s, {torque:g} N m")
    return model


def _inside(model: pin.Model, waiting: Array) -> Array:
    for i, name in enumerate(model.names[1:]):
        check_range(f"waiting angle of joint {name}", waiting[i], model.lowerPositionLimit[i], model.upperPositionLimit[i])
    return waiting


def _bodies(model: pin.Model) -> Array:
    links = zip(list(model.jointPlacements)[1:], list(model.inertias)[1:], strict=True)
    return np.array([[at.translation[2], body.mass, *body.lever, *body.inertia[np.tril_indices(3)]] for at, body in links])


@dataclass(frozen=True, eq=False)
class ArmModel:
    """Joint order s1, s2, s3, e1, e2, w1, w2; `racket` is the face centre, its z axis the face normal.

    position_limits: (7, 2) rad, low and high. speed_limits: (7,) rad/s, both ways. torque_limits: (7,) N m at the joints.
    waiting: (7,) rad, where the arm waits for a ball. chain: what the kernels need. bodies: (7, 11) for each link the height of its joint
    above the one before (m), mass (kg), centre of mass (m), and inertia about it (kg m^2) as xx, xy, yy, xz, yz, zz, in its own frame.
    pinocchio: the model with its dynamics.
    """

    names: tuple[str, ...]
    position_limits: Array
    speed_limits: Array
    torque_limits: Array
    waiting: Array
    chain: Chain
    bodies: Array
    pinocchio: pin.Model

    @classmethod
    def pa10(
        cls, base: Sequence[float] = BASE, mount: Sequence[float] = MOUNT, waiting: Sequence[float] = WAITING, urdf: str = str(URDF)
    ) -> ArmModel:
        """base: x, y, z (m) and yaw (rad) of base_link in `table`. mount: m beyond the flange, rad about the flange's y axis.

        urdf: path of a description with the PA10's structure; its numbers may be others. Raises BadShape, NotFinite, TtError.
        """
        x, y, z, yaw = check_array("base", base, (4,))
        ahead, tilt = check_array("mount", mount, (2,))
        model = _read(urdf)
        lengths = [sum(model.jointPlacements[i].translation[2] for i in pair) for pair in ((1, 2), (3, 4), (5, 6), (7,))]
        racket = pin.SE3(pin.rpy.rpyToMatrix(0.0, float(tilt), 0.0), np.array([0.0, 0.0, ahead]))
        model.frames[model.getFrameId("racket")].placement = racket
        model.jointPlacements[1] = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, float(yaw)), np.array([x, y, z])) * model.jointPlacements[1]
        constants = (pin.rpy.rpyToMatrix(0.0, 0.0, float(yaw)), np.array([x, y, z]), np.array(lengths), racket.rotation, racket.translation)
        return cls(
            names=tuple(model.names[1:]),
            position_limits=np.column_stack([model.lowerPositionLimit, model.upperPositionLimit]),
            speed_limits=model.velocityLimit.copy(),
            torque_limits=model.effortLimit.copy(),
            waiting=_inside(model, check_array("waiting", waiting, (7,))),
            chain=Chain(*(np.array(c, order="C") for c in constants)),
            bodies=_bodies(model),
            pinocchio=model,
        )

    def racket(self, q: Array) -> tuple[Array, Array]:
        """Position (3,) m of the face centre and rotation (3, 3) of the racket, in `table`, for q (7,) rad."""
        position, rotation, _ = forward(check_array("q", q, (7,)).copy(), self.chain)
        return position, rotation

    def jacobian(self, q: Array) -> Array:
        """(6, 7) to the velocity of the face centre (m/s) and the racket's angular velocity (rad/s), in `table`, (B.21)."""
        return forward(check_array("q", q, (7,)).copy(), self.chain)[2]
