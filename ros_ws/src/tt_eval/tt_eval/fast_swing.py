"""Fast simulation of one swing, the joint motion that makes a stroke, and of the ball that meets the racket.

One call does what `SimulatedRobot` and `ArmControl` do in ticks, steps of fixed duration. Servo, guard and plant are the kernels that they
use, with the parameters of the given controller. If the guard or a torque limit would act, the result is None and the ticks must be
simulated one by one. The guard's check of clearance is left out: a swing is planned with more clearance than the guard keeps, which is
checked here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numba import njit
from tt_arm.control import ArmControl
from tt_arm.joints import JointBounds
from tt_arm.kinematics import Chain, forward_into
from tt_arm.safety.command_limits import NOT_CUT, limit_command
from tt_arm.servo import servo_speed
from tt_arm.swing import Swing
from tt_arm.trajectory.profiles import evaluate_path
from tt_core.physics import Physics
from tt_core.states import Array, BallState
from tt_sim.world.plant import Plant, advance_joints
from tt_sim.world.true_ball import CONTACT_LOG, Coefficients, Contact, contacts_from, travel

MOST_CONTACTS = 8  # more than a ball has from launch to landing
AFTER_STRIKE = 0.06  # s after the strike, for which the swing is simulated


class Controller(NamedTuple):
    """Parameters of servo and guard, as compiled functions take them."""

    lead: float  # s, time by which the path's speed is read in advance
    gain: float  # 1/s, gain of the position error
    lost: float  # rad, distance of a joint from its path at which the swing is given up
    hold: float  # s, for which a drive may hold a command
    speed: Array  # (n,) rad/s, limits of the servo
    guard: JointBounds  # limits of commands
    braking: Array  # (n,) rad/s^2, deceleration that the guard counts on


class Drives(NamedTuple):
    """Parameters of the simulated arm, as compiled functions take them."""

    limits: JointBounds
    lag: float  # s, time constant of the velocity controllers
    q_step: float  # rad, resolution of the encoders; 0: exact
    noise: Array  # (ticks, n) rad, errors of the measured positions


class Followed(NamedTuple):
    """Path of the joints to be followed, and the time at which it starts."""

    start: float  # s; inf to stay at rest
    knots: Array  # (joints, n) s since the start, see `tt_arm.trajectory.profiles`
    coefficients: Array  # (joints, n, 6) of the polynomials between them


class Setup(NamedTuple):
    """Physics and arm with which a ball is simulated."""

    physics: Physics  # true for this ball
    plant: Plant  # the simulated arm
    control: ArmControl  # its controller
    tick: float  # s, step of the simulation


class Record(NamedTuple):
    """Arrays with the motion of arm and racket, a row for each tick."""

    joints: Array  # (ticks, 1 + 2 n) time (s), positions (rad or m), speeds (rad/s or m/s)
    rackets: Array  # (ticks, 12) position (m), normal, velocity (m/s), angular velocity (rad/s)


@njit(cache=True)
def _record_racket(q: Array, qdot: Array, chain: Chain, jacobian: Array, rotation: Array, row: Array) -> None:
    """Fill a row (12,) of `Record.rackets`."""
    forward_into(q, chain, row[:3], rotation, jacobian)
    for k in range(3):
        row[3 + k] = rotation[k, 2]
    for k in range(6):
        row[6 + k] = 0.0
        for i in range(len(q)):
            row[6 + k] += jacobian[k, i] * qdot[i]


@njit(cache=True)
def _swing(
    time: float, tick: float, q: Array, path: Followed, controller: Controller, drives: Drives, chain: Chain, record: Record
) -> bool:
    """Follow a path from rest at q (n,) rad, which is changed, at `time` (s).

    Returns:
        Whether the guard stays silent; otherwise the record ends early.
    """
    n = len(q)
    rest, qdot, wanted, last, command = q.copy(), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    q_path, qdot_ahead, measured, unused, unused_too = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    rotation, jacobian, speed, noise = np.empty((3, 3)), np.empty((6, n)), controller.speed, drives.noise
    lead, gain, joints = controller.lead, controller.gain, record.joints
    for k in range(len(joints)):
        now = time + k * tick
        joints[k, 0] = now
        for i in range(n):
            joints[k, 1 + i], joints[k, 1 + n + i] = q[i], qdot[i]
        _record_racket(q, qdot, chain, jacobian, rotation, record.rackets[k])
        if now + lead >= path.start:
            evaluate_path(now - path.start, path.knots, path.coefficients, q_path, unused, unused_too)
            evaluate_path(now + lead - path.start, path.knots, path.coefficients, unused, qdot_ahead, unused_too)
        else:
            q_path[:], qdot_ahead[:] = rest, 0.0
        for i in range(n):
            measured[i] = q[i] + noise[k, i]
            if drives.q_step > 0.0:
                measured[i] = round(measured[i] / drives.q_step) * drives.q_step
            wanted[i] = servo_speed(q_path[i], qdot_ahead[i], measured[i], gain, speed[i])
            if abs(q_path[i] - measured[i]) > controller.lost:
                return False
        if limit_command(measured, wanted, last, tick, controller.hold, controller.guard, controller.braking, command) != NOT_CUT:
            return False
        last[:] = command
        advance_joints(q, qdot, command, tick, drives.limits, drives.lag)
    return True


def _has_torque(plant: Plant, joints: Array, tick: float) -> bool:
    """Return whether the motors have the torque of every tick, as `Plant` asks."""
    model, most = plant.model.pinocchio, plant.limits.effort
    every_q, every_qdot = np.split(joints[:, 1:], 2, axis=1)
    data, every_qddot = model.createData(), np.diff(every_qdot, axis=0) / tick
    moving = np.flatnonzero(np.abs(every_qddot).max(axis=1) > 1e-6)
    rows = zip(every_q[moving], every_qdot[moving], every_qddot[moving], strict=True)
    return all((np.abs(pin.rnea(model, data, q, qdot, a)) <= most).all() for q, qdot, a in rows)


def _controller(control: ArmControl) -> Controller:
    guard, limits = control.guard.params.of_joints(control.model).bounds, control.limits
    speed, braking = np.array(control.model.speed_limits), np.array(limits.of_joints(control.model).acceleration)
    return Controller(control.servo.lead, control.servo.gain, control.params.lost, limits.hold, speed, guard, braking)


def rally(
    ball: BallState, swing: Swing | None, time: float, setup: Setup, longest: float, rng: np.random.Generator
) -> tuple[list[Contact], Array] | None:
    """Simulate a ball against an arm that waits until a given time and then makes a swing.

    Args:
        ball: The ball at its launch.
        swing: Motion of the arm; None if it keeps waiting.
        time: s, start of the swing.
        setup: Physics, arm and controller.
        longest: s, time until which the ball is simulated.
        rng: Random numbers for the encoders.

    Returns:
        Contacts of the ball, and the motion of the joints as in `Episode`; None if the guard or a torque limit would act.
    """
    physics, plant, control, tick = setup
    params, model = plant.params, plant.model
    if control.guard.params.clearance > control.limits.clearance:
        return None
    n = 2 if swing is None else math.ceil((swing.strike_time + AFTER_STRIKE - time) / tick)
    count = len(model.names)
    record, noise = Record(np.empty((n, 1 + 2 * count)), np.empty((n, 12))), np.zeros((n, count))
    if params.q_noise > 0.0:
        noise = rng.normal(0.0, params.q_noise, (n, count))
    path = Followed(np.inf, np.empty((count, 1)), np.empty((count, 1, 6))) if swing is None else _followed(swing)
    drives = Drives(plant.limits.bounds, params.time_constant, params.q_step, noise)
    silent = _swing(time, tick, np.array(model.waiting), path, _controller(control), drives, model.chain, record)
    if not silent or (params.torque_share > 0.0 and not _has_torque(plant, record.joints, tick)):
        return None
    record.rackets[-1, 6:] = 0.0  # it stays there
    log = np.empty(MOST_CONTACTS, dtype=CONTACT_LOG)
    met, _, _ = travel(ball.vector, ball.time - time, longest - time, record.rackets, tick, Coefficients.of(physics), log)
    return contacts_from(log[:met], time), record.joints


def _followed(swing: Swing) -> Followed:
    return Followed(swing.start.time, swing.knots, swing.coefficients)
