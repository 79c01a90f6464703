"""How many balls an arm could make a stroke for in time, from strokes that are prepared once: a hundred times as fast as playing them."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_arm.reach import ReachParams
from tt_arm.safety.clearance import clearance
from tt_arm.stroke_selection import SelectionParams, select_stroke
from tt_arm.swing import SwingLimits
from tt_core.robots import ArmFile
from tt_core.states import RacketState
from tt_racket.intercept import InterceptParams

from ..episode import Plan, Trial
from ..scenario import Scenario, load

AHEAD = 0.01  # s from the strokes' arrival to the begin of a swing, see `tt_arm.control.ControlParams`
PROBE = 8  # balls of each kind, after which an arm that has made a stroke for few of them is given up
FEW = 0.15  # share of them
BALLS = 100  # of each kind
KINDS = ("real", "rallies")  # scenarios: the catapult, and real play


@dataclass(frozen=True)
class QuickScore:
    """Shares of the balls for which a stroke can be made in time.

    Attributes:
        catapult: Of the catapult's, scales 3 to 5.
        rallies: Of real play's.
    """

    catapult: float
    rallies: float


@dataclass(frozen=True)
class PreparedBall:
    """The strokes for a ball, and when they are at the arm (s)."""

    rackets: tuple[RacketState, ...]
    due: float


def window_of(arm: ArmFile) -> InterceptParams:
    """Return where the strokes of an arm are looked for."""
    return InterceptParams.of(arm.hit_window, arm.racket_speed)


def scenario_of(kind: str, window: InterceptParams) -> Scenario:
    """Return a scenario of KINDS with another window, without images."""
    scenario = load(kind, images=False)
    return replace(scenario, robot=replace(scenario.robot, intercept=window))


@functools.lru_cache(maxsize=2)
def prepared(window: InterceptParams) -> dict[str, list[PreparedBall]]:
    """Return BALLS of each of KINDS, measured and with their strokes; the same ones each time. Raises NoShots."""
    balls: dict[str, list[PreparedBall]] = {}
    for kind in KINDS:
        plans = [Plan.of(Trial.drawn(scenario_of(kind, window), seed)) for seed in range(BALLS)]
        balls[kind] = [PreparedBall(tuple(plan.rackets), plan.due) for plan in plans]
    return balls


def quick_score(model: ArmModel, arm: ArmFile) -> QuickScore:
    """Score an arm; 0 if it cannot wait where it should, and what the first PROBE balls say if that is little. Raises NoShots."""
    limits = SwingLimits(command_timeout=arm.command_timeout)
    if clearance(model.waiting, model.bodies)[0] < limits.clearance:
        return QuickScore(0.0, 0.0)
    balls, made = prepared(window_of(arm)), {kind: list[bool]() for kind in KINDS}
    for k in range(BALLS):
        for kind in KINDS:
            made[kind].append(_makes(model, balls[kind][k], limits))
        if k + 1 == PROBE and np.mean([*made["real"], *made["rallies"]]) < FEW:
            break
    return QuickScore(*(float(np.mean(made[kind])) for kind in KINDS))


def _makes(model: ArmModel, ball: PreparedBall, limits: SwingLimits) -> bool:
    """Return whether a stroke can be made in time from the waiting posture."""
    if not np.isfinite(ball.due) or not ball.rackets:
        return False
    start = Joints.at_rest(ball.due + AHEAD, model.waiting)
    return select_stroke(model, ball.rackets, start, limits, ReachParams(), SelectionParams()).swing is not None
