"""A simulated arm that obeys joint velocity commands with a lag, exactly integrated.

Each joint: qddot = (command - qdot) / time_constant, cut at the acceleration limit; the command is cut at the speed limit, and a joint that
runs into its end stops there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from tt_arm.kinematics import forward
from tt_arm.model import ArmModel
from tt_arm.swing import Joints
from tt_core.errors import check_array, check_range
from tt_core.states import Array

from .world import RacketMotion


@dataclass(frozen=True, slots=True)
class PlantParams:
    """How the simulated arm differs from the perfect one."""

    time_constant: float = 0.005  # s, lag of the joint velocity loops, an assumption
    acceleration: float = 40.0  # rad/s^2, an assumption: twice what a swing asks for
    q_noise: float = 0.0  # rad, standard deviation of a measured position
    qdot_noise: float = 0.0  # rad/s, standard deviation of a measured speed

    def __post_init__(self) -> None:
        check_range("time_constant", self.time_constant, 1e-4, 1.0)
        check_range("acceleration", self.acceleration, 0.1, 1e4)
        check_range("q_noise", self.q_noise, 0.0, 1.0)
        check_range("qdot_noise", self.qdot_noise, 0.0, 10.0)


@njit(cache=True)
def step_joint(q: float, v: float, u: float, duration: float, lag: float, acceleration: float) -> tuple[float, float]:
    """Position and speed after `duration`: at the acceleration limit while it is asked for more, then an exponential."""
    gap = u - v
    ramp = min(duration, max(0.0, abs(gap) / acceleration - lag))
    push = math.copysign(acceleration, gap)
    q += v * ramp + 0.5 * push * ramp * ramp
    v += push * ramp
    rest = duration - ramp
    decay = math.exp(-rest / lag)
    return q + u * rest - (u - v) * lag * (1.0 - decay), u - (u - v) * decay


@njit(cache=True)
def _advance(q: Array, qdot: Array, command: Array, duration: float, limits: Array, lag: float, acceleration: float) -> None:
    """In place; limits (7, 3) low, high, speed."""
    for i in range(7):
        u = min(limits[i, 2], max(-limits[i, 2], command[i]))
        q[i], qdot[i] = step_joint(q[i], qdot[i], u, duration, lag, acceleration)
        if not limits[i, 0] <= q[i] <= limits[i, 1]:
            q[i], qdot[i] = min(limits[i, 1], max(limits[i, 0], q[i])), 0.0


class Plant:
    """Pure but for its constants: the state is passed in and returned."""

    def __init__(self, model: ArmModel, params: PlantParams | None = None) -> None:
        self.model, self.params = model, params or PlantParams()
        self._limits = np.column_stack([model.position_limits, model.speed_limits])

    def advance(self, state: Joints, command: Array, duration: float) -> Joints:
        """The joints `duration` (s) later under one command (7,) rad/s. Raises OutOfRange, BadShape, NotFinite."""
        duration = check_range("duration", duration, 0.0, 10.0)
        q, qdot = self._after(state, check_array("command", command, (7,)), duration)
        return Joints(state.time + duration, q, qdot)

    def racket(self, state: Joints, command: Array | None = None, duration: float = 0.0) -> RacketMotion:
        """The racket at `state`, or `duration` (s) later under `command` (7,), exact at any instant of a tick; about 15 us."""
        q, qdot = (state.q.copy(), state.qdot) if command is None else self._after(state, command, duration)
        position, rotation, jacobian = forward(q, self.model.chain)
        return RacketMotion(position, rotation, jacobian[:3] @ qdot)

    def measured(self, state: Joints, rng: np.random.Generator) -> Joints:
        """What the encoders tell."""
        q, qdot = rng.normal(0.0, self.params.q_noise, 7), rng.normal(0.0, self.params.qdot_noise, 7)
        return Joints(state.time, state.q + q, state.qdot + qdot)

    def _after(self, state: Joints, command: Array, duration: float) -> tuple[Array, Array]:
        q, qdot = state.q.copy(), state.qdot.copy()
        _advance(q, qdot, command.astype(float), duration, self._limits, self.params.time_constant, self.params.acceleration)
        return q, qdot
