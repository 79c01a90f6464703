"""Joints: their motion at one instant, and their limits."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from tt_core.errors import BadShape, check_array, check_range
from tt_core.states import Array

ACCELERATION = 20.0  # rad/s^2 or m/s^2 of each joint in swings; the PA10 then needs 0.76 of its rated torque at most (assumed inertias)
JERK = 4000.0  # rad/s^3 or m/s^3 of each joint in swings; our choice: 5 ms from rest to the full acceleration
NO_ACCELERATION_LIMIT, NO_JERK_LIMIT = 1e4, 1e7  # rad or m, s; limits of a joint whose description states none
HOLD_RESERVE = 0.04  # s more for which a command may act: its transport, and a process that is held up twice; our choice, costs no stroke


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """The motion of the joints at one instant.

    Attributes:
        time: s.
        q: (n,) rad, or m for a linear joint.
        qdot: (n,) rad/s or m/s.
        qddot: (n,) rad/s^2 or m/s^2; zero where it is not given.
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
        """Return joints at rest at q (n,) rad or m at `time` (s)."""
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
    """What each joint may do: the limits of the posture search, of swings, the servo, the guard and the simulated arm.

    The limits of the arm itself are `ArmModel.limits`. Whoever may use less of them takes `reduced`.

    Attributes:
        names: Of the joints.
        units: Of each joint's position, "rad" for a revolute and "m" for a linear joint. All other units follow from it.
        position: (n, 2) lowest and highest position, rad or m.
        speed: (n,) rad/s or m/s, both ways.
        acceleration: (n,) rad/s^2 or m/s^2, both ways; NO_ACCELERATION_LIMIT where the description of the arm states none.
        jerk: (n,) rad/s^3 or m/s^3, both ways; NO_JERK_LIMIT where the description of the arm states none.
        effort: (n,) N m or N, rated, at the joint.
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
        """Return the limits in the form that kernels take."""
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
        """Return the limits of somebody who may use less. The results are cached.

        Args:
            speed: Share of the speed limits.
            effort: Share of the rated effort.
            margin: Distance kept from both position limits, rad or m.
            acceleration: rad/s^2 or m/s^2, limit of each joint whose description states none; None keeps NO_ACCELERATION_LIMIT.
            jerk: rad/s^3 or m/s^3, limit of each joint whose description states none; None keeps NO_JERK_LIMIT.
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
