"""The worst that the true arm did since the start: speed, acceleration, distance to its end stops, and clearance."""

from __future__ import annotations

from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from tt_arm.joints import JointBounds, Joints
from tt_arm.kinematics import Bodies
from tt_arm.model import ArmModel
from tt_arm.safety.clearance import OBSTACLES, clearance
from tt_core.states import Array

ROUNDING = 1e-6  # of the speed limit; a speed at the limit may be above it by so much


class Bound(Enum):
    """Bounds that the true arm must not break."""

    SPEED_LIMIT = "speed limit"
    END_STOP = "end stop"
    CLEARANCE = "clearance"


class TickExtremes(NamedTuple):
    """The worst joint of one tick in each respect.

    Attributes:
        speed: Largest speed, in speed limits.
        acceleration: rad/s^2, the largest.
        limit_distance: rad, from the nearest joint to its end stop.
        clearance: m.
        nearest: Index in OBSTACLES of what is nearest.
    """

    speed: float
    acceleration: float
    limit_distance: float
    clearance: float
    nearest: int


@njit(cache=True)
def _measure(q: Array, qdot: Array, before: Array, duration: float, limits: JointBounds, bodies: Bodies) -> TickExtremes:
    """Measure one tick.

    Args:
        q: (n,) rad at its end.
        qdot: (n,) rad/s at its end.
        before: (n,) rad/s at its beginning.
        duration: s.
        limits: Of the joints.
        bodies: Of the arm.
    """
    speed, acceleration, limit_distance = 0.0, 0.0, np.inf
    for i in range(len(q)):
        speed = max(speed, abs(qdot[i]) / limits[i].speed)
        acceleration = max(acceleration, abs(qdot[i] - before[i]) / duration)
        limit_distance = min(limit_distance, q[i] - limits[i].low, limits[i].high - q[i])
    left, nearest = clearance(q, bodies)
    return TickExtremes(speed, acceleration, limit_distance, left, nearest)


class ArmRecord:
    """The worst of each quantity, with the time when it was.

    Attributes:
        speed: (largest speed in speed limits, time s).
        acceleration: (largest acceleration rad/s^2, time s).
        limit_distance: (least distance to an end stop rad, time s).
        hits: How many times an end stop was run into.
        clearance: (least clearance m, time s).
        nearest: What the least clearance was from.
    """

    def __init__(self, model: ArmModel, joints: Joints) -> None:
        """Begin with the present state of the joints."""
        self._bodies, self._limits = model.bodies, model.limits.bounds
        self._joints = joints
        self._broken: frozenset[Bound] = frozenset()  # bounds, in the last tick
        now = _measure(joints.q, joints.qdot, joints.qdot, 1.0, self._limits, self._bodies)
        self.speed, self.acceleration, self.hits = (0.0, joints.time), (0.0, joints.time), 0
        self.limit_distance, self.clearance = (now.limit_distance, joints.time), (now.clearance, joints.time)
        self.nearest = OBSTACLES[now.nearest]

    def note(self, joints: Joints) -> bool:
        """Note the state at the end of a tick; 3 us.

        Returns:
            Whether a bound is broken that was not broken in the tick before.
        """
        last, self._joints = self._joints, joints
        time = joints.time
        now = _measure(joints.q, joints.qdot, last.qdot, time - last.time, self._limits, self._bodies)
        if now.speed > self.speed[0]:
            self.speed = now.speed, time
        if now.acceleration > self.acceleration[0]:
            self.acceleration = now.acceleration, time
        if now.limit_distance < self.limit_distance[0]:
            self.limit_distance = now.limit_distance, time
        if now.clearance < self.clearance[0]:
            self.clearance, self.nearest = (now.clearance, time), OBSTACLES[now.nearest]
        if now.speed <= 1.0 + ROUNDING and now.limit_distance > 0.0 and now.clearance > 0.0:  # nearly always: without making a set
            self._broken = frozenset()
            return False
        is_broken = {
            Bound.SPEED_LIMIT: now.speed > 1.0 + ROUNDING,
            Bound.END_STOP: now.limit_distance <= 0.0,
            Bound.CLEARANCE: now.clearance <= 0.0,
        }
        broken = frozenset(bound for bound in Bound if is_broken[bound])
        begun, self._broken = broken - self._broken, broken
        self.hits += Bound.END_STOP in begun
        return bool(begun)

    @property
    def kept(self) -> bool:
        """Whether no bound was broken since the start."""
        return self.speed[0] <= 1.0 + ROUNDING and self.hits == 0 and self.clearance[0] > 0.0

    def to_text(self) -> dict[str, Any]:
        """Return all of it as text, numbers in SI units."""
        worst = {"speed": self.speed, "acceleration": self.acceleration, "limit_distance": self.limit_distance, "clearance": self.clearance}
        texts = {name: f"{value:.9g}" for name, (value, _) in worst.items()}
        times = {f"{name}_time": f"{time:.6f}" for name, (_, time) in worst.items()}
        return {**texts, **times, "end_stop_hits": str(self.hits), "nearest": self.nearest}
