"""Compiles every kernel once, so that no node compiles when a ball flies: python -m tt_bringup.warm."""

from __future__ import annotations

import numpy as np
from tt_arm.control import warm as warm_arm
from tt_arm.model import ArmModel
from tt_arm.swing import Joints
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_predict.identify import Predictor
from tt_predict.rollout import StopRule, rollout
from tt_predict.spread import spread
from tt_racket.goal import GoalParams, answer
from tt_racket.intercept import InterceptParams, intercept
from tt_sim.episode import play
from tt_sim.figures import figures
from tt_sim.footage import footage
from tt_sim.launcher import LauncherParams, launch
from tt_sim.plant import Plant
from tt_sim.render import Scene
from tt_sim.scenario import load
from tt_vision.measure import warm as warm_vision
from tt_vision.rig import high_speed_pair


def main() -> None:
    rng, physics, cameras = np.random.default_rng(0), Physics.liu(), high_speed_pair()
    ball, orientation = launch("top", 4, LauncherParams(), rng)
    warm_vision(cameras)
    next(footage(ball, orientation, cameras, Scene(), physics, rng))
    path = rollout(ball, physics, StopRule.at_x(-0.4))
    rollout(ball, physics, StopRule.at_x(-0.4), method="liu")
    spread(BallState.from_vector(0.0, ball.vector, 1e-6 * np.eye(9)), physics, StopRule.at_x(-0.4))
    Predictor(physics).positions(ball.vector, path.times)
    intercept(path, answer(ball.spin, GoalParams()), physics, InterceptParams())
    for scenario in ("liu", "real"):
        figures(play(load(scenario, images=False), 0))
    for rebound in (physics.table, Physics.measured().table):
        rebound.after(np.array([-5.0, 0.0, -2.0]), ball.spin)
    arm = ArmModel.pa10()
    warm_arm(arm)
    plant, joints = Plant(arm), Joints(0.0, arm.waiting, np.zeros(7))
    plant.racket(plant.advance(joints, np.zeros(7), 0.002))


if __name__ == "__main__":
    main()
