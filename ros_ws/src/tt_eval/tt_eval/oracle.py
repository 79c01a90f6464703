"""Upper bound of a robot: which balls it can reach in time if it knows everything from the launch on."""

from __future__ import annotations

from dataclasses import replace

from tt_arm.control import ArmControl
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_arm.stroke_selection import SelectionParams, StrokeSelection
from tt_arm.swing import SwingLimits, plan
from tt_core.hit_windows import path_end
from tt_predict.rollout import StopRule, rollout
from tt_racket.goal import default_goal
from tt_racket.intercept import intercept

from .episode import Trial

MOST_TRIED = 100  # most candidates that are tried: as many as there can be


def reachable(trial: Trial, model: ArmModel) -> StrokeSelection:
    """Find a stroke that hits a ball from the waiting posture, with the true path of the ball, full limits of the arm, and no delay.

    Args:
        trial: The ball, its physics and its robot.
        model: The arm.

    Returns:
        The selected stroke with its swing, or the reasons why there is none.
    """
    scenario = trial.scenario
    robot = scenario.robot
    path = rollout(trial.ball, trial.physics, StopRule.at_x(path_end(scenario.intercept.x_low)))
    goal = scenario.goal or default_goal(trial.ball.spin, robot.default_goal)
    candidates = intercept(path, goal, trial.physics, scenario.intercept)
    limits = SwingLimits(command_timeout=scenario.arm_file.command_timeout)
    control = ArmControl(model, limits, selection=SelectionParams(method=robot.reach, tries=MOST_TRIED))
    control.enable(True)
    start = Joints.at_rest(trial.ball.time, model.waiting)
    control.joints, control.swing = start, replace(plan(model, start, None, start.time), end_time=start.time)
    return control.take([stroke.racket for stroke in candidates.strokes if stroke.racket])
