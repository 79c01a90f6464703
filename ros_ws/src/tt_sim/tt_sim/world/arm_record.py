"""The worst that the true arm did since the start: speed, acceleration, distance to its end stops, and clearance."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from tt_arm.joints import JointBounds, Joints
from tt_arm.kinematics import Chain
from tt_arm.model import ArmModel
from tt_arm.safety.clearance import OBSTACLES, clearance
from tt_core.states import Array

ROUNDING = 1e-6  # of the speed limit, that a speed at the limit may be above it


class TickExtremes(NamedTuple):
    """The extremes of one tick."""

    speed: float  # largest, in speed limits
    acceleration: float  # rad/s^2, largest
    limit_distance: float  # rad, of the nearest joint to its end stop
    clearance: float  # m
    nearest: int  # index in OBSTACLES


@njit(cache=True)
def measure(q: Array, qdot: Array, before: Array, duration: float, limits: JointBounds, chain: Chain) -> TickExtremes:
    """Measure one tick.

    Args:
        q: (7,) rad at its end.
        qdot: (7,) rad/s at its end.
        before: (7,) rad/s at its beginning.
        duration: s.
        limits: Of the joints.
        chain: Of the arm.
    """
    speed, acceleration, limit_distance = 0.0, 0.0, np.inf
    for i in range(7):
        speed = max(speed, abs(qdot[i]) / limits[i].speed)
        acceleration = max(acceleration, abs(qdot[i] - before[i]) / duration)
        limit_distance = min(limit_distance, q[i] - limits[i].low, limits[i].high - q[i])
    left, nearest = clearance(q, chain)
    return TickExtremes(speed, acceleration, limit_distance, left, nearest)


class ArmRecord:
    """Keep the worst of each quantity, with the time when it was.

    Attributes:
        speed: (largest speed in speed limits, time s).
        acceleration: (largest acceleration rad/s^2, time s).
        limit_distance: (least distance to an end stop rad, time s).
        hits: How many times an end stop was run into.
        clearance: (least clearance m, time s).
        nearest: What the least clearance was from.
    """

    def __init__(self, model: ArmModel, joints: Joints) -> None:
        self._chain, self._limits = model.chain, model.limits.bounds
        self._joints = joints
        self._broken: frozenset[str] = frozenset()  # bounds, in the last tick
        _, _, limit_distance, left, nearest = measure(joints.q, joints.qdot, joints.qdot, 1.0, self._limits, self._chain)
        self.speed, self.acceleration, self.hits = (0.0, joints.time), (0.0, joints.time), 0
        self.limit_distance, self.clearance, self.nearest = (limit_distance, joints.time), (left, joints.time), OBSTACLES[nearest]

    def note(self, joints: Joints) -> bool:
        """Note the state at the end of a tick, and tell whether a bound is broken that was not in the tick before; 3 us."""
        last, self._joints = self._joints, joints
        time = joints.time
        values = measure(joints.q, joints.qdot, last.qdot, time - last.time, self._limits, self._chain)
        speed, acceleration, limit_distance, left, nearest = values
        if speed > self.speed[0]:
            self.speed = speed, time
        if acceleration > self.acceleration[0]:
            self.acceleration = acceleration, time
        if limit_distance < self.limit_distance[0]:
            self.limit_distance = limit_distance, time
        if left < self.clearance[0]:
            self.clearance, self.nearest = (left, time), OBSTACLES[nearest]
        if speed <= 1.0 + ROUNDING and limit_distance > 0.0 and left > 0.0:
            self._broken = frozenset()
            return False
        checks = (("speed limit", speed > 1.0 + ROUNDING), ("end stop", limit_distance <= 0.0), ("clearance", left <= 0.0))
        broken = frozenset(name for name, is_broken in checks if is_broken)
        begun, self._broken = broken - self._broken, broken
        self.hits += "end stop" in begun
        return bool(begun)

    @property
    def kept(self) -> bool:
        """Whether no bound was broken since the start."""
        return self.speed[0] <= 1.0 + ROUNDING and self.hits == 0 and self.clearance[0] > 0.0

    def told(self) -> dict[str, Any]:
        """All of it as text, numbers in SI units."""
        worst = {"speed": self.speed, "acceleration": self.acceleration, "limit_distance": self.limit_distance, "clearance": self.clearance}
        texts = {name: f"{value:.9g}" for name, (value, _) in worst.items()}
        times = {f"{name}_time": f"{time:.6f}" for name, (_, time) in worst.items()}
        return {**texts, **times, "end_stop_hits": str(self.hits), "nearest": self.nearest}
