"""A simulated arm that obeys joint velocity commands with a lag, exactly integrated.

Each joint: qddot = (command - qdot) / time_constant, cut at the acceleration limit. The command is cut at the speed limit, and a joint that
runs into its end stop rests there. With a torque limit, the inverse dynamics (pinocchio) give the torques that the motors would need over
the tick. If one is beyond its limit, all are cut at their limits, and the forward dynamics give the motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

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


class DriveLimits(NamedTuple):
    """What drives and end stops allow, for the kernels; one value for each joint.

    Attributes:
        low: rad, the lower end stop.
        high: rad, the upper end stop.
        speed: rad/s.
    """

    low: Array
    high: Array
    speed: Array


@njit(cache=True)
def drive_limits(rows: Array) -> DriveLimits:
    """Give names to the columns of rows (joints, 3), as `Plant.limits` has them."""
    return DriveLimits(rows[:, 0], rows[:, 1], rows[:, 2])


@njit(cache=True)
def step_joint(q: float, v: float, u: float, duration: float, lag: float, acceleration: float) -> tuple[float, float]:
    """Move one joint: at the acceleration limit while the lag asks for more, then as an exponential.

    Args:
        q: rad.
        v: rad/s.
        u: rad/s, the command.
        duration: s.
        lag: s, time constant.
        acceleration: rad/s^2, limit.

    Returns:
        Position and speed after `duration`.
    """
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
    """Move all joints, in place; limits: rows of `drive_limits`; the rest as of `step_joint`."""
    limit = drive_limits(limits)
    for i in range(len(q)):
        u = min(limit.speed[i], max(-limit.speed[i], command[i]))
        q[i], qdot[i] = step_joint(q[i], qdot[i], u, duration, lag, acceleration)
        if not limit.low[i] <= q[i] <= limit.high[i]:
            q[i], qdot[i] = min(limit.high[i], max(limit.low[i], q[i])), 0.0


class Plant:
    """The arm. It holds constants only: the state is passed in and returned.

    Attributes:
        model: What the arm is.
        params: How it differs from the perfect one.
        limits: (7, 3), rows of `drive_limits`.
    """

    def __init__(self, model: ArmModel, params: PlantParams | None = None) -> None:
        """Take the limits of the model and the share of them that the drives reach."""
        self.model, self.params = model, params or PlantParams()
        self.limits = np.column_stack([model.position_limits, self.params.speed_share * model.speed_limits])

    @property
    def speed_limits(self) -> Array:
        """Speeds at which the drives cut commands, (7,) rad/s."""
        return self.limits[:, 2]

    @cached_property
    def _data(self) -> pin.Data:
        return self.model.pinocchio.createData()

    def advance(self, state: Joints, command: Array, duration: float) -> Joints:
        """Move the joints under one command.

        Args:
            state: Where they start.
            command: (7,) rad/s.
            duration: s.

        Returns:
            The joints `duration` later.

        Raises:
            OutOfRange: The duration is not within [0, 10].
            BadShape: The command is not one number for each joint.
            NotFinite: A number is NaN or infinite.
        """
        duration = check_range("duration", duration, 0.0, 10.0)
        q, qdot = self._after(state, check_array("command", command, (7,)), duration)
        return Joints(state.time + duration, q, qdot)

    def racket(self, state: Joints, command: Array | None = None, duration: float = 0.0) -> RacketMotion:
        """Return the racket at `state`, or later, exact at any instant of a tick; about 15 us.

        Args:
            state: Of the joints.
            command: (7,) rad/s, obeyed for `duration`; None for the racket at `state`.
            duration: s.
        """
        q, qdot = (state.q.copy(), state.qdot) if command is None else self._after(state, command, duration)
        position, rotation, jacobian = forward(q, self.model.chain)
        return RacketMotion(position, rotation, jacobian[:3] @ qdot, jacobian[3:] @ qdot)

    def measured(self, state: Joints, rng: np.random.Generator) -> Joints:
        """Return the joints as the encoders measure them; rng: of the noise."""
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
        """Return q and qdot after `duration`, wanted without a torque limit, as the motors can make them."""
        model, most = self.model.pinocchio, self.params.torque_share * self.model.torque_limits
        before = np.array(state.q), np.array(state.qdot)
        torque = pin.rnea(model, self._data, *before, (qdot - before[1]) / duration)
        if (np.abs(torque) <= most).all():
            return q, qdot
        qddot = pin.aba(model, self._data, *before, np.clip(torque, -most, most))
        q, qdot = before[0] + duration * before[1] + 0.5 * duration**2 * qddot, before[1] + duration * qddot
        inside = np.clip(q, self.model.position_limits[:, 0], self.model.position_limits[:, 1])
        return inside, np.where(inside == q, qdot, 0.0)
