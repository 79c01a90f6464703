"""Simulated arm that follows joint velocity commands with a lag, integrated exactly.

For each joint qddot = (command - qdot) / time_constant, limited to the acceleration limit. The command is limited to the speed limit, and a
joint that reaches its end stop stops there. With a torque limit, inverse dynamics (pinocchio) give the torques that a step needs. If one of
them is above its limit, the torques are limited, and forward dynamics give the motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from numba import njit
from tt_arm.joints import JointBounds, Joints
from tt_arm.kinematics import forward
from tt_arm.model import ArmModel
from tt_core.errors import check_array, check_range
from tt_core.params import check, param
from tt_core.states import Array

from .true_ball import RacketMotion


@dataclass(frozen=True, slots=True)
class PlantParams:
    """Differences of the simulated arm from a perfect one."""

    time_constant: float = param(0.005, "s", "lag of the joint velocity loops, an assumption", low=0.0001, high=1.0)
    acceleration: float = param(
        40.0,
        "rad/s^2",
        "acceleration of each joint whose description states none, an assumption: twice that of swings",
        low=0.1,
        high=10000.0,
    )
    speed_share: float = param(1.0, "", "share of the speed limits that the drives reach", low=0.01, high=1.0)
    torque_share: float = param(0.0, "", "share of the rated torque that the motors have; 0: no limit", low=0.0, high=100.0)
    q_noise: float = param(0.0, "rad", "standard deviation of a measured position", low=0.0, high=1.0)
    qdot_noise: float = param(0.0, "rad/s", "standard deviation of a measured speed", low=0.0, high=10.0)
    q_step: float = param(0.0, "rad", "resolution of the encoders; 0: exact", low=0.0, high=0.1)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


@njit(cache=True)
def step_joint(q: float, v: float, u: float, duration: float, lag: float, acceleration: float) -> tuple[float, float]:
    """Advance one joint: first at the acceleration limit, if the command needs more, then by an exponential.

    Args:
        q: rad, position.
        v: rad/s, speed.
        u: rad/s, the command.
        duration: s.
        lag: s, time constant of the velocity controller.
        acceleration: rad/s^2, limit in both directions.

    Returns:
        Position (rad) and speed (rad/s) after `duration`.
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
def advance_joints(q: Array, qdot: Array, command: Array, duration: float, limits: JointBounds, lag: float) -> None:
    """Advance all joints in place. A joint that reaches its end stop stops there.

    Args:
        q: (n,) rad; changed.
        qdot: (n,) rad/s; changed.
        command: (n,) rad/s.
        duration: s.
        limits: Limits of the joints that the drives reach.
        lag: s, time constant of the velocity controllers.
    """
    for i in range(len(q)):
        u = min(limits[i].speed, max(-limits[i].speed, command[i]))
        q[i], qdot[i] = step_joint(q[i], qdot[i], u, duration, lag, limits[i].acceleration)
        if not limits[i].low <= q[i] <= limits[i].high:
            q[i], qdot[i] = min(limits[i].high, max(limits[i].low, q[i])), 0.0


class Plant:
    """The simulated arm. It holds constants only: the state of the joints is passed in and returned.

    Attributes:
        model: The arm.
        params: Differences from a perfect arm.
        limits: Limits that its joints reach.
    """

    def __init__(self, model: ArmModel, params: PlantParams | None = None) -> None:
        """Store the constants of an arm.

        Args:
            model: The arm.
            params: Differences from a perfect arm.
        """
        self.model, self.params = model, params or PlantParams()
        speed, effort = self.params.speed_share, self.params.torque_share
        self.limits = model.limits.reduced(speed=speed, effort=effort, acceleration=self.params.acceleration)

    @cached_property
    def _data(self) -> pin.Data:
        return self.model.pinocchio.createData()

    def advance(self, state: Joints, command: Array, duration: float) -> Joints:
        """Return the state of the joints after some time under one command.

        Args:
            state: The joints now.
            command: (n,) rad/s.
            duration: s, 0 to 10.

        Raises:
            OutOfRange: `duration` is outside its range.
            BadShape: `command` has another shape.
            NotFinite: A number is NaN or infinite.
        """
        duration = check_range("duration", duration, 0.0, 10.0)
        q, qdot = self._after(state, check_array("command", command, (len(state.q),)), duration)
        return Joints(state.time + duration, q, qdot)

    def racket(self, state: Joints, command: Array | None = None, duration: float = 0.0) -> RacketMotion:
        """Return the state of the racket now, or after some time under one command; exact at any time within a tick. Takes about 15 us.

        Args:
            state: The joints now.
            command: (n,) rad/s; None for the racket now.
            duration: s, time under the command.
        """
        q, qdot = (state.q.copy(), state.qdot) if command is None else self._after(state, command, duration)
        position, rotation, jacobian = forward(q, self.model.chain)
        return RacketMotion(position, rotation, jacobian[:3] @ qdot, jacobian[3:] @ qdot)

    def effort(self, before: Joints, after: Joints) -> Array:
        """Return the mean torques (n,) in N m of the motors between two states, by inverse dynamics. Takes about 10 us.

        Args:
            before: The joints at the beginning.
            after: The joints at the end, at a later time.
        """
        qddot = (after.qdot - before.qdot) / (after.time - before.time)
        torque: Array = pin.rnea(self.model.pinocchio, self._data, np.array(before.q), np.array(before.qdot), qddot)
        return torque.copy()

    def measured(self, state: Joints, rng: np.random.Generator) -> Joints:
        """Return the state of the joints as the encoders measure it.

        Args:
            state: The true state.
            rng: Random numbers for the noise.
        """
        params = self.params
        if params.q_noise == params.qdot_noise == params.q_step == 0.0:
            return state
        q, qdot = state.q + rng.normal(0.0, params.q_noise, len(state.q)), state.qdot + rng.normal(0.0, params.qdot_noise, len(state.q))
        return Joints(state.time, np.round(q / params.q_step) * params.q_step if params.q_step > 0.0 else q, qdot)

    def _after(self, state: Joints, command: Array, duration: float) -> tuple[Array, Array]:
        q, qdot, params = state.q.copy(), state.qdot.copy(), self.params
        advance_joints(q, qdot, command.astype(float), duration, self.limits.bounds, params.time_constant)
        if params.torque_share > 0.0 and duration > 0.0:
            return self._driven(state, q, qdot, duration)
        return q, qdot

    def _driven(self, state: Joints, q: Array, qdot: Array, duration: float) -> tuple[Array, Array]:
        """Return q and qdot after `duration` (s) as the motors can make them; given are those without a torque limit."""
        model, most = self.model.pinocchio, self.limits.effort
        q_before, qdot_before = np.array(state.q), np.array(state.qdot)
        torque = pin.rnea(model, self._data, q_before, qdot_before, (qdot - qdot_before) / duration)
        if (np.abs(torque) <= most).all():
            return q, qdot
        qddot = pin.aba(model, self._data, q_before, qdot_before, np.clip(torque, -most, most))
        q, qdot = q_before + duration * qdot_before + 0.5 * duration**2 * qddot, qdot_before + duration * qddot
        inside = np.clip(q, *self.limits.position.T)
        return inside, np.where(inside == q, qdot, 0.0)
