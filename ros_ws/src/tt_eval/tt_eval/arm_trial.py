"""Test of the arm alone on the strokes for one ball: no images, an exactly known ball, a simulated arm with lag and noise.

A stroke is position, orientation and velocity of the racket at one time, which return the ball.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from tt_arm.control import ArmControl
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_arm.safety.clearance import clearance
from tt_core.failures import Failure
from tt_core.hit_windows import path_end
from tt_core.physics import Physics
from tt_core.states import Array, RacketState
from tt_predict.rollout import StopRule, rollout
from tt_racket.goal import GoalParams, default_goal
from tt_racket.intercept import InterceptParams, intercept
from tt_sim.world.launcher import LauncherParams, launch
from tt_sim.world.plant import Plant, PlantParams

from .arm_loop import arm_ticks

TRIAL_TICK = 0.002  # s
STROKES_AT = 0.08  # s after the launch, when the strokes are at the arm: six frames and the latency of the chain
TRIAL_TIME = 4.0  # s, given to the stroke and the way back


class TrialFailure(Enum):
    """Reason why no stroke was made if the arm has refused none."""

    NO_STROKE = "no stroke"


@dataclass(frozen=True, slots=True, eq=False)
class ArmTrial:
    """Result of one ball. Numbers of the stroke are NaN if none was made.

    Attributes:
        strokes: Number of candidate strokes.
        reason: Why no stroke was made; None if one was.
        turning: rad/s, angular velocity of the racket's face at the strike.
        spare: s, between the earliest possible strike and the strike.
        back: s, from the strike to the waiting posture.
        miss: m, distance of the racket from its wanted position at the strike.
        tilt: rad, angle between its normal and the wanted one at the strike.
        room: rad, least distance of a true joint to its position limit.
        speed: Largest ratio of a true joint's speed to its speed limit.
        acceleration: rad/s^2, largest of a true joint.
        clear: m, least distance of the true arm to table, floor and itself.
        guarded: Names of the codes of all reasons why a command was not the one that the swing needed.
    """

    strokes: int
    reason: Failure | None
    turning: float
    spare: float
    back: float
    miss: float
    tilt: float
    room: float
    speed: float
    acceleration: float
    clear: float
    guarded: frozenset[str]


def launched_ball_strokes(kind: str, scale: int, seed: int) -> list[RacketState]:
    """Return the candidate strokes for a ball that is launched at random at the time 0 s.

    Args:
        kind: Kind of the shot, as for `tt_sim.world.launcher.launch`.
        scale: Scale of the shot, as for `launch`.
        seed: Seed of the launch.

    Returns:
        States of the racket, best first; empty if the ball does not come within reach.

    Raises:
        BadChoice: There is no such kind.
        OutOfRange: There is no such scale.
    """
    physics = Physics.liu()
    ball, _ = launch(kind, scale, LauncherParams(), np.random.default_rng(seed))
    path = rollout(ball, physics, StopRule.at_x(path_end(InterceptParams.x_low)))
    found = intercept(path, default_goal(ball.spin, GoalParams()), physics, InterceptParams())
    return [stroke.racket for stroke in found.strokes if stroke.racket is not None]


def arm_trial(model: ArmModel, rackets: list[RacketState], plant_params: PlantParams, seed: int) -> ArmTrial:
    """Plan and make one stroke in simulated steps, until the arm waits again.

    Args:
        model: The arm, as the controller knows it.
        rackets: Candidate strokes, best first; their times are s after the launch.
        plant_params: Differences of the true arm from a perfect one.
        seed: Seed of the noise of the encoders.
    """
    control, plant, rng = ArmControl(model), Plant(model, plant_params), np.random.default_rng(seed)
    control.enable(True)
    start, guarded, selected, rows = Joints.at_rest(0.0, model.waiting), set[str](), None, list[list[float]]()
    miss, tilt, end = np.nan, np.nan, TRIAL_TIME
    for joints, step in arm_ticks(control, plant, start, TRIAL_TICK, rng):
        if joints.time > 0.0:
            rows.append([*joints.q, *joints.qdot])
        if joints.time >= end:
            break
        guarded |= {step.reason.code.name} if step.reason else set()
        if selected is None and joints.time >= STROKES_AT:
            selected = control.take(rackets)
            end = joints.time + 0.2 if selected.swing is None else selected.swing.end_time + 0.1
        if selected is not None and selected.racket is not None and 0.0 <= selected.racket.time - joints.time < TRIAL_TICK:
            there = plant.racket(joints, step.command, selected.racket.time - joints.time)
            miss = float(np.linalg.norm(there.position - selected.racket.position))
            tilt = float(np.arccos(min(1.0, float(there.rotation[:, 2] @ selected.racket.normal))))
    record: Array = np.array(rows)
    q, qdot = np.split(record, 2, axis=1)
    made = selected is not None and selected.swing is not None and selected.reach is not None
    return ArmTrial(
        strokes=len(rackets),
        reason=None if made else selected.reasons[0].failure if selected and selected.reasons else Failure(TrialFailure.NO_STROKE),
        turning=selected.reach.turning if made else np.nan,  # type: ignore[union-attr]
        spare=selected.swing.strike_time - selected.swing.earliest if made else np.nan,  # type: ignore[union-attr]
        back=selected.swing.end_time - selected.swing.strike_time if made else np.nan,  # type: ignore[union-attr]
        miss=miss,
        tilt=tilt,
        room=float(np.minimum(q - model.position_limits[:, 0], model.position_limits[:, 1] - q).min()),
        speed=float((np.abs(qdot) / model.speed_limits).max()),
        acceleration=float(np.abs(np.diff(qdot, axis=0)).max() / TRIAL_TICK),
        clear=min(clearance(row, model.bodies)[0] for row in q),
        guarded=frozenset(guarded),
    )
