"""State of the joints at one time, and limits of the joints."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from tt_core.errors import BadShape, check_array, check_range
from tt_core.states import Array

JOINT_ACCELERATION = 20.0  # rad/s^2 or m/s^2 in swings; the PA10 then needs 0.76 of its rated torque at most (assumed inertias)
JERK = 4000.0  # rad/s^3 or m/s^3 of each joint in swings; our choice: 5 ms from rest to the full acceleration
NO_ACCELERATION_LIMIT, NO_JERK_LIMIT = 1e4, 1e7  # rad/s^2, rad/s^3 or m; limits of a joint whose description states none
HOLD_RESERVE = 0.04  # s, added to the time a command may act: transport, and a process delayed twice; our choice, costs no stroke


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """Positions, speeds and accelerations of all joints of the arm at one time.

    Attributes:
        time: s.
        q: (n,) positions, rad, or m for a linear joint.
        qdot: (n,) speeds, rad/s or m/s.
        qddot: (n,) accelerations, rad/s^2 or m/s^2; zero if they are not given.
    """

    time: float
    q: Array
    qdot: Array
    qddot: Array = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Copy the arrays; raise BadShape or NotFinite."""
        object.__setattr__(self, "time", check_range("time", self.time, -math.inf, math.inf))
        object.__setattr__(self, "q", check_array("q", self.q, (-1,)))
        n = len(self.q)
        if np.size(self.qddot) == 0:
            object.__setattr__(self, "qddot", np.zeros(n))
        for name in ("qdot", "qddot"):
            object.__setattr__(self, name, check_array(name, getattr(self, name), (n,)))

    @classmethod
    def at_rest(cls, time: float, q: Array) -> Joints:
        """Return the state of joints that are at rest at the positions q (n,) rad or m at `time` (s)."""
        return cls(time, q, np.zeros(np.shape(q)))


JointBounds = npt.NDArray[np.void]  # (n,) of JOINT_BOUNDS, a row for each joint
JOINT_BOUNDS = np.dtype(
    [
        ("low", np.float64),  # rad or m
        ("high", np.float64),  # rad or m
        ("speed", np.float64),  # rad/s or m/s, both ways
        ("acceleration", np.float64),  # rad/s^2 or m/s^2, both ways
        ("jerk", np.float64),  # rad/s^3 or m/s^3, both ways
    ]
)


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of the n joints of an arm: of the arm itself, or the smaller ones that a part of the program may use.

    The limits of the arm itself are `ArmModel.limits`. Posture search, swings, servo and guard use limits made by `reduced`.

    Attributes:
        names: Names of the joints.
        units: Unit of each joint's position, "rad" for a revolute and "m" for a linear joint. All other units follow from it.
        position: (n, 2) lowest and highest position, rad or m.
        speed: (n,) rad/s or m/s, for both directions.
        acceleration: (n,) rad/s^2 or m/s^2, for both directions; NO_ACCELERATION_LIMIT if the URDF of the arm states none.
        jerk: (n,) rad/s^3 or m/s^3, for both directions; NO_JERK_LIMIT if the URDF of the arm states none.
        effort: (n,) N m or N, rated torque or force at the joint.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    position: Array
    speed: Array
    acceleration: Array
    jerk: Array
    effort: Array

    def __post_init__(self) -> None:
        """Copy the arrays; raise BadShape or NotFinite."""
        n = len(self.names)
        if len(self.units) != n:
            raise BadShape("units", (len(self.units),), (n,))
        object.__setattr__(self, "position", check_array("position", self.position, (n, 2)))
        for name in ("speed", "acceleration", "jerk", "effort"):
            object.__setattr__(self, name, check_array(name, getattr(self, name), (n,)))

    @functools.cached_property
    def bounds(self) -> JointBounds:
        """Limits as a structured array (n,) of JOINT_BOUNDS, the form that kernels take; without the effort."""
        bounds = np.empty(len(self.names), JOINT_BOUNDS)
        bounds["low"], bounds["high"] = self.position.T
        bounds["speed"], bounds["acceleration"], bounds["jerk"] = self.speed, self.acceleration, self.jerk
        return bounds

    def reduced(
        self,
        *,
        speed: float = 1.0,
        effort: float = 1.0,
        margin: float = 0.0,
        acceleration: float | None = None,
        jerk: float | None = None,
    ) -> JointLimits:
        """Return smaller limits, for a part of the program that may use only a share of these. The results are cached.

        Args:
            speed: Share of the speed limits, 0 to 1.
            effort: Share of the rated effort, 0 to 1.
            margin: Distance to keep from both position limits, rad or m.
            acceleration: rad/s^2 or m/s^2, limit of each joint whose URDF states none; None keeps NO_ACCELERATION_LIMIT.
            jerk: rad/s^3 or m/s^3, limit of each joint whose URDF states none; None keeps NO_JERK_LIMIT.
        """
        return _reduced(self, speed, effort, margin, acceleration, jerk)


@functools.lru_cache(maxsize=128)
def _reduced(
    limits: JointLimits, speed: float, effort: float, margin: float, acceleration: float | None, jerk: float | None
) -> JointLimits:
    """Return `limits.reduced`; cached, because each plan asks for it."""
    return replace(
        limits,
        position=limits.position + margin * np.array([1.0, -1.0]),
        speed=speed * limits.speed,
        acceleration=_stated(limits.acceleration, NO_ACCELERATION_LIMIT, acceleration),
        jerk=_stated(limits.jerk, NO_JERK_LIMIT, jerk),
        effort=effort * limits.effort,
    )


def _stated(limits: Array, none: float, otherwise: float | None) -> Array:
    """Return the limits (n,), with `otherwise` for joints that have none."""
    return limits if otherwise is None else np.where(limits < none, limits, otherwise)
