"""A simulated arm that obeys joint velocity commands with a lag, exactly integrated.

Each joint: qddot = (command - qdot) / time_constant, cut at the acceleration limit; the command is cut at the speed limit, and a joint that
runs into its end stops there. With a torque limit the dynamics (pinocchio) tell what the motors would need over the tick: a torque that
they have not is cut, and all joints move as the torques left make them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from numba import njit
from tt_arm.joints import Joints
from tt_arm.kinematics import forward
from tt_arm.model import ArmModel
from tt_core.errors import check_array, check_range
from tt_core.params import check, param
from tt_core.states import Array

from .true_ball import RacketMotion


@dataclass(frozen=True, slots=True)
class PlantParams:
    """How the simulated arm differs from the perfect one."""

    time_constant: float = param(0.005, "s", "time constant of the joint velocity loops, an assumption", low=0.0001, high=1.0)
    acceleration: float = param(
        40.0, "rad/s^2", "largest acceleration of each joint, an assumption: twice what a swing asks for", low=0.1, high=10000.0
    )
    speed_share: float = param(1.0, "", "share of the speed limits of the joints that the drives reach", low=0.01, high=1.0)
    torque_share: float = param(0.0, "", "share of the rated joint torque that the motors have; 0: no limit", low=0.0, high=100.0)
    q_noise: float = param(0.0, "rad", "standard deviation of a measured joint position", low=0.0, high=1.0)
    qdot_noise: float = param(0.0, "rad/s", "standard deviation of a measured joint speed", low=0.0, high=10.0)
    q_step: float = param(0.0, "rad", "resolution of the joint encoders; 0: none", low=0.0, high=0.1)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


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
def advance_joints(q: Array, qdot: Array, command: Array, duration: float, limits: Array, lag: float, acceleration: float) -> None:
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
        self.limits = np.column_stack([model.position_limits, self.params.speed_share * model.speed_limits])

    @cached_property
    def _data(self) -> pin.Data:
        return self.model.pinocchio.createData()

    def advance(self, state: Joints, command: Array, duration: float) -> Joints:
        """The joints `duration` (s) later under one command (7,) rad/s. Raises OutOfRange, BadShape, NotFinite."""
        duration = check_range("duration", duration, 0.0, 10.0)
        q, qdot = self._after(state, check_array("command", command, (7,)), duration)
        return Joints(state.time + duration, q, qdot)

    def racket(self, state: Joints, command: Array | None = None, duration: float = 0.0) -> RacketMotion:
        """The racket at `state`, or `duration` (s) later under `command` (7,), exact at any instant of a tick; about 15 us."""
        q, qdot = (state.q.copy(), state.qdot) if command is None else self._after(state, command, duration)
        position, rotation, jacobian = forward(q, self.model.chain)
        return RacketMotion(position, rotation, jacobian[:3] @ qdot, jacobian[3:] @ qdot)

    def measured(self, state: Joints, rng: np.random.Generator) -> Joints:
        """What the encoders tell."""
        params = self.params
        if params.q_noise == params.qdot_noise == params.q_step == 0.0:
            return state
        q, qdot = state.q + rng.normal(0.0, params.q_noise, 7), state.qdot + rng.normal(0.0, params.qdot_noise, 7)
        return Joints(state.time, np.round(q / params.q_step) * params.q_step if params.q_step > 0.0 else q, qdot)

    def _after(self, state: Joints, command: Array, duration: float) -> tuple[Array, Array]:
        q, qdot, params = state.q.copy(), state.qdot.copy(), self.params
        advance_joints(q, qdot, command.astype(float), duration, self.limits, params.time_constant, params.acceleration)
        if params.torque_share > 0.0 and duration > 0.0:
            return self._driven(state, q, qdot, duration)
        return q, qdot

    def _driven(self, state: Joints, q: Array, qdot: Array, duration: float) -> tuple[Array, Array]:
        """q and qdot after `duration`, wanted without a torque limit, as the motors can make them."""
        model, most = self.model.pinocchio, self.params.torque_share * self.model.torque_limits
        before = np.array(state.q), np.array(state.qdot)
        torque = pin.rnea(model, self._data, *before, (qdot - before[1]) / duration)
        if (np.abs(torque) <= most).all():
            return q, qdot
        qddot = pin.aba(model, self._data, *before, np.clip(torque, -most, most))
        q, qdot = before[0] + duration * before[1] + 0.5 * duration**2 * qddot, before[1] + duration * qddot
        inside = np.clip(q, self.limits[:, 0], self.limits[:, 1])
        return inside, np.where(inside == q, qdot, 0.0)
