"""Quick score of an arm: for how many balls it could make a stroke in time.

The strokes, racket states that return the ball, are prepared once. This is a hundred times as fast as a simulation of the balls.
"""

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

SWING_AHEAD = 0.01  # s from the strokes' arrival to the begin of a swing, see `tt_arm.control.ControlParams`
PROBE = 8  # balls of each kind, after which an arm that can make a stroke for less than LEAST_SHARE_IN_TIME of them is given up
LEAST_SHARE_IN_TIME = 0.15  # share of these balls
BALLS = 100  # number of balls of each kind
SCENARIO_KINDS = ("real", "rallies")  # scenarios: the catapult, and real play


@dataclass(frozen=True)
class QuickScore:
    """Shares, 0 to 1, of the balls for which an arm can make a stroke in time.

    Attributes:
        catapult: Share for the catapult's balls, scales 3 to 5.
        rallies: Share for shots of real play.
    """

    catapult: float
    rallies: float


@dataclass(frozen=True)
class PreparedBall:
    """Strokes for one ball, best first, and the time (s) at which they arrive at the arm."""

    rackets: tuple[RacketState, ...]
    due: float


def window_of(arm: ArmFile) -> InterceptParams:
    """Return the region in which strokes for an arm are searched for: its hit window, with its racket speed."""
    return InterceptParams.of(arm.hit_window, arm.racket_speed)


def scenario_of(kind: str, window: InterceptParams) -> Scenario:
    """Return a scenario without images, with another region in which strokes are searched for.

    Args:
        kind: Name of the scenario, of SCENARIO_KINDS.
        window: The region.
    """
    scenario = load(kind, images=False)
    return replace(scenario, robot=replace(scenario.robot, intercept=window))


@functools.lru_cache(maxsize=2)
def prepared(window: InterceptParams) -> dict[str, list[PreparedBall]]:
    """Return measured balls with their strokes, BALLS for each of SCENARIO_KINDS. They are the same in each call.

    Args:
        window: Region in which strokes are searched for.

    Raises:
        NoShots: There are no shots of real play.
    """
    balls: dict[str, list[PreparedBall]] = {}
    for kind in SCENARIO_KINDS:
        plans = [Plan.of(Trial.drawn(scenario_of(kind, window), seed)) for seed in range(BALLS)]
        balls[kind] = [PreparedBall(tuple(plan.rackets), plan.due) for plan in plans]
    return balls


def quick_score(model: ArmModel, arm: ArmFile) -> QuickScore:
    """Compute the quick score of an arm.

    It is 0 if the arm is too near to an obstacle in its waiting posture. It is that of the first PROBE balls of each kind if this is below
    LEAST_SHARE_IN_TIME.

    Args:
        model: The arm.
        arm: Its arm file.

    Raises:
        NoShots: There are no shots of real play.
    """
    limits = SwingLimits(command_timeout=arm.command_timeout)
    if clearance(model.waiting, model.bodies)[0] < limits.clearance:
        return QuickScore(0.0, 0.0)
    balls, made = prepared(window_of(arm)), {kind: list[bool]() for kind in SCENARIO_KINDS}
    for k in range(BALLS):
        for kind in SCENARIO_KINDS:
            made[kind].append(_makes(model, balls[kind][k], limits))
        if k + 1 == PROBE and np.mean([*made["real"], *made["rallies"]]) < LEAST_SHARE_IN_TIME:
            break
    return QuickScore(*(float(np.mean(made[kind])) for kind in SCENARIO_KINDS))


def _makes(model: ArmModel, ball: PreparedBall, limits: SwingLimits) -> bool:
    """Return whether a stroke can be made in time from the waiting posture."""
    if not np.isfinite(ball.due) or not ball.rackets:
        return False
    start = Joints.at_rest(ball.due + SWING_AHEAD, model.waiting)
    return select_stroke(model, ball.rackets, start, limits, ReachParams(), SelectionParams()).swing is not None
