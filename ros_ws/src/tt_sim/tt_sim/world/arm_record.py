"""Record of the extreme values of the true arm since the start: speed, acceleration, distance to end stops, and clearance."""

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

SPEED_ROUNDING = 1e-6  # share of the speed limit by which a speed at the limit may be above it


class Bound(Enum):
    """Limits that the true arm must keep."""

    SPEED_LIMIT = "speed limit"
    END_STOP = "end stop"
    CLEARANCE = "clearance"


class TickExtremes(NamedTuple):
    """Extreme values over all joints in one tick, one step of the simulation.

    Attributes:
        speed: Largest ratio of a joint's speed to its speed limit.
        acceleration: rad/s^2, largest of a joint.
        limit_distance: rad, least distance of a joint to its end stop.
        clearance: m, least distance of the arm to table, floor and itself.
        nearest: Index in OBSTACLES of what is nearest.
    """

    speed: float
    acceleration: float
    limit_distance: float
    clearance: float
    nearest: int


@njit(cache=True)
def _measure(q: Array, qdot: Array, before: Array, duration: float, limits: JointBounds, bodies: Bodies) -> TickExtremes:
    """Return the extreme values of one tick.

    Args:
        q: (n,) rad, positions at its end.
        qdot: (n,) rad/s, speeds at its end.
        before: (n,) rad/s, speeds at its beginning.
        duration: s.
        limits: Limits of the joints.
        bodies: Bodies of the arm.
    """
    speed, acceleration, limit_distance = 0.0, 0.0, np.inf
    for i in range(len(q)):
        speed = max(speed, abs(qdot[i]) / limits[i].speed)
        acceleration = max(acceleration, abs(qdot[i] - before[i]) / duration)
        limit_distance = min(limit_distance, q[i] - limits[i].low, limits[i].high - q[i])
    left, nearest = clearance(q, bodies)
    return TickExtremes(speed, acceleration, limit_distance, left, nearest)


class ArmRecord:
    """The extreme value of each quantity of the arm since the start, and the time when it occurred.

    Attributes:
        speed: Largest ratio of a joint's speed to its speed limit, and its time (s).
        acceleration: Largest acceleration of a joint (rad/s^2), and its time (s).
        limit_distance: Least distance of a joint to its end stop (rad), and its time (s).
        hits: How many times a joint ran into an end stop.
        clearance: Least distance of the arm to table, floor and itself (m), and its time (s).
        nearest: Which of these was nearest then, one of OBSTACLES.
    """

    def __init__(self, model: ArmModel, joints: Joints) -> None:
        """Start with the present state of the joints.

        Args:
            model: The arm.
            joints: State of its joints.
        """
        self._bodies, self._limits = model.bodies, model.limits.bounds
        self._joints = joints
        self._broken: frozenset[Bound] = frozenset()  # bounds, in the last tick
        now = _measure(joints.q, joints.qdot, joints.qdot, 1.0, self._limits, self._bodies)
        self.speed, self.acceleration, self.hits = (0.0, joints.time), (0.0, joints.time), 0
        self.limit_distance, self.clearance = (now.limit_distance, joints.time), (now.clearance, joints.time)
        self.nearest = OBSTACLES[now.nearest]

    def note(self, joints: Joints) -> bool:
        """Add the state of the joints at the end of a tick, one step of the simulation. Takes 3 us.

        Returns:
            Whether a limit is broken that was not broken in the tick before.
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
        if now.speed <= 1.0 + SPEED_ROUNDING and now.limit_distance > 0.0 and now.clearance > 0.0:  # nearly always: without making a set
            self._broken = frozenset()
            return False
        is_broken = {
            Bound.SPEED_LIMIT: now.speed > 1.0 + SPEED_ROUNDING,
            Bound.END_STOP: now.limit_distance <= 0.0,
            Bound.CLEARANCE: now.clearance <= 0.0,
        }
        broken = frozenset(bound for bound in Bound if is_broken[bound])
        begun, self._broken = broken - self._broken, broken
        self.hits += Bound.END_STOP in begun
        return bool(begun)

    @property
    def kept(self) -> bool:
        """Whether no limit was broken since the start."""
        return self.speed[0] <= 1.0 + SPEED_ROUNDING and self.hits == 0 and self.clearance[0] > 0.0

    def to_text(self) -> dict[str, Any]:
        """Return all values as text, by name, for a diagnostic status; numbers in SI units."""
        worst = {"speed": self.speed, "acceleration": self.acceleration, "limit_distance": self.limit_distance, "clearance": self.clearance}
        texts = {name: f"{value:.9g}" for name, (value, _) in worst.items()}
        times = {f"{name}_time": f"{time:.6f}" for name, (_, time) in worst.items()}
        return {**texts, **times, "end_stop_hits": str(self.hits), "nearest": self.nearest}
