"""One swing of the arm and the ball that meets it, in one call: what `SimulatedRobot` and `ArmControl` do tick by tick.

If the guard or a torque limit would act, the result is None and the ticks must be played.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numba import njit
from tt_arm.kinematics import Chain, forward_into
from tt_arm.safety.guard import GuardParams
from tt_arm.servo import ServoParams
from tt_arm.swing import Swing, SwingLimits
from tt_arm.trajectory.profiles import evaluate
from tt_core.physics import Physics
from tt_core.states import Array, BallState
from tt_sim.world.plant import Plant, advance_joints
from tt_sim.world.true_ball import CONTACT_LOG, Coefficients, Contact, contacts_from, travel

MOST_CONTACTS = 8  # more than a ball has from launch to landing
AFTER_STRIKE = 0.06  # s that the swing is followed on
GUARD, SERVO, LIMITS = GuardParams(), ServoParams(), SwingLimits()


@njit(cache=True)
def _swing(
    q: Array, time: float, tick: float, lead: float, gain: float, start: float, knots: Array, coefficients: Array, speeds: Array,
    limits: Array, guard: Array, lag: float, acceleration: float, noise: Array, q_step: float, chain: Chain, joints: Array, rackets: Array,
) -> bool:  # fmt: skip
    """From rest at q (7,), in place, at `time`: fills joints (n, 15) and rackets (n, 12) a tick apart, the first row at `time`.

    noise (n, 14) of what the encoders tell. guard: steepest change of a command, braking, margin. Whether the guard stays silent.
    """
    rest, qdot, command, last = q.copy(), np.zeros(7), np.zeros(7), np.zeros(7)
    path_q, path_v, ahead_q, ahead_v, unused = np.empty(7), np.empty(7), np.empty(7), np.empty(7), np.empty(7)
    position, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, 7))
    for n in range(len(joints)):
        now = time + n * tick
        joints[n, 0] = now
        for i in range(7):
            joints[n, 1 + i], joints[n, 8 + i] = q[i], qdot[i]
        forward_into(q, chain, position, rotation, jacobian)
        for k in range(3):
            rackets[n, k], rackets[n, 3 + k] = position[k], rotation[k, 2]
        for k in range(6):
            rackets[n, 6 + k] = 0.0
            for i in range(7):
                rackets[n, 6 + k] += jacobian[k, i] * qdot[i]
        if now + lead >= start:
            evaluate(now - start, knots, coefficients, path_q, path_v, unused)
            evaluate(now + lead - start, knots, coefficients, ahead_q, ahead_v, unused)
        else:
            path_q[:], ahead_v[:] = rest, 0.0
        for i in range(7):
            told = q[i] + noise[n, i]
            if q_step > 0.0:
                told = round(told / q_step) * q_step
            command[i] = min(speeds[i], max(-speeds[i], ahead_v[i] + gain * (path_q[i] - told)))
            up = math.sqrt(2.0 * guard[1] * max(0.0, limits[i, 1] - guard[2] - told))
            down = math.sqrt(2.0 * guard[1] * max(0.0, told - limits[i, 0] - guard[2]))
            if not -down <= command[i] <= up or abs(command[i] - last[i]) > guard[0] * tick or abs(path_q[i] - told) > guard[3]:
                return False
        last[:] = command
        advance_joints(q, qdot, command, tick, limits, lag, acceleration)
    return True


def _strong_enough(plant: Plant, joints: Array, tick: float) -> bool:
    """Whether the motors have the torque of every tick, as `Plant` asks."""
    model, most = plant.model.pinocchio, plant.params.torque_share * plant.model.torque_limits
    data, qddot = model.createData(), np.diff(joints[:, 8:], axis=0) / tick
    moving = np.flatnonzero(np.abs(qddot).max(axis=1) > 1e-6)
    rows = zip(joints[moving, 1:8], joints[moving, 8:], qddot[moving], strict=True)
    return all((np.abs(pin.rnea(model, data, q, qdot, a)) <= most).all() for q, qdot, a in rows)


def rally(
    ball: BallState, swing: Swing | None, time: float, physics: Physics, plant: Plant, tick: float, longest: float, rng: np.random.Generator
) -> tuple[list[Contact], Array] | None:
    """Contacts of the ball until `longest` (s), and joints (n, 15) as of Episode, for an arm that waits until `time` (s) and then makes the
    swing; None when the guard or the motors have a say in it."""
    params, model = plant.params, plant.model
    q = np.array(model.waiting)
    n = 2 if swing is None else math.ceil((swing.strike_time + AFTER_STRIKE - time) / tick)
    joints, rackets = np.empty((n, 15)), np.empty((n, 12))
    start, knots, coefficients = (np.inf, np.empty((7, 1)), np.empty((7, 1, 6))) if swing is None else _parts(swing)
    noise = np.zeros((n, 14))
    if params.q_noise > 0.0:
        noise[:, :7] = rng.normal(0.0, params.q_noise, (n, 7))
    guard = np.array([GUARD.acceleration, LIMITS.acceleration, GUARD.margin, 0.15])
    silent = _swing(
        q, time, tick, SERVO.lead, SERVO.gain, start, knots, coefficients, model.speed_limits, plant.limits, guard,
        params.time_constant, params.acceleration, noise, params.q_step, model.chain, joints, rackets,
    )  # fmt: skip
    if not silent or (params.torque_share > 0.0 and not _strong_enough(plant, joints, tick)):
        return None
    rackets[-1, 6:] = 0.0  # it stays there
    log = np.empty(MOST_CONTACTS, dtype=CONTACT_LOG)
    met, _, _ = travel(ball.vector, ball.time - time, longest - time, rackets, tick, Coefficients.of(physics), log)
    return contacts_from(log[:met], time), joints


def _parts(swing: Swing) -> tuple[float, Array, Array]:
    return swing.start.time, swing.knots, swing.coefficients
