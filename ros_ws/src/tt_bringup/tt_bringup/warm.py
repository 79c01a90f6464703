"""Compile every numba kernel once and cache it, so that no node compiles while a ball flies: python -m tt_bringup.warm.

Two processes compile at the same time.
"""

from __future__ import annotations

import multiprocessing
import sys
from dataclasses import replace

import numpy as np
from tt_arm.control import warm as warm_arm
from tt_arm.model import ArmModel
from tt_core.physics import Physics
from tt_core.states import Array, BallPath, BallState
from tt_eval.episode import play
from tt_eval.scenario import load
from tt_eval.sweep_metrics import sweep_metrics
from tt_predict.identify import Predictor
from tt_predict.rollout import StopRule, rollout
from tt_predict.uncertainty import uncertainty
from tt_racket.goal import GoalParams, default_goal
from tt_racket.intercept import InterceptParams, intercept
from tt_racket.stroke import solve
from tt_sim.cameras.camera_sequence import camera_sequence
from tt_sim.render import Scene
from tt_sim.simulated_robot import warm as warm_hardware
from tt_sim.world.launcher import LauncherParams, launch
from tt_sim.world.plant import Plant
from tt_vision.rig import high_speed_pair, wide_pair
from tt_vision.warm import warm as warm_vision
from tt_vision.warm import warm_tracker


def vision() -> None:
    """Compile the kernels of the ball tracker, of the simulated cameras and of the measurement, which are half of all kernels."""
    warm_tracker(wide_pair())
    cameras, (ball, orientation) = high_speed_pair(), _launched()
    next(camera_sequence(ball, orientation, cameras, Scene(), Physics.liu(), np.random.default_rng(0)))
    warm_vision(cameras)


def flights(ball: BallState, physics: Physics) -> BallPath:
    """Compile the kernels of flight and rebounds, which all other parts use. Done first, so that no two processes compile them at once.

    Args:
        ball: State of a ball in flight.
        physics: Models of flight and rebounds.

    Returns:
        The predicted path of the ball, down to x = -0.4 m.
    """
    for rebound in (physics.table, Physics.measured().table):
        rebound.after(np.array([-5.0, 0.0, -2.0]), ball.spin)
    high_speed_pair()[0].project(ball.position[None])
    rollout(ball, physics, StopRule.at_x(-0.4), method="liu")
    return rollout(ball, physics, StopRule.at_x(-0.4))


def main() -> None:
    """Compile all kernels in two processes; the exit code of this process is that of the second one."""
    physics, (ball, _) = Physics.liu(), _launched()
    _print_step("flight and rebounds")
    path = flights(ball, physics)
    beside = multiprocessing.get_context("spawn").Process(target=vision)
    beside.start()
    _print_step("cameras and tracker beside: prediction")
    uncertainty(BallState.from_vector(0.0, ball.vector, 1e-6 * np.eye(9)), physics, StopRule.at_x(-0.4))
    Predictor(physics).positions(ball.vector, path.times)
    _print_step("strokes")
    goal = default_goal(ball.spin, GoalParams())
    intercept(path, goal, physics, InterceptParams())
    solve(path.end, goal, physics, method="sam")
    _print_step("arm")
    arm = ArmModel.pa10()
    warm_arm(arm)
    warm_hardware(Plant(arm))
    _print_step("arms without a closed form")
    warm_arm(replace(arm, closed_form=None))
    _print_step("rallies")
    for scenario in ("liu", "real"):
        sweep_metrics(play(load(scenario, images=False), 0))
    beside.join()
    sys.exit(beside.exitcode)


def _print_step(what: str) -> None:
    """Print what is compiled now, as it takes a minute or more."""
    print(f"  {what}", flush=True)


def _launched() -> tuple[BallState, Array]:
    return launch("top", 4, LauncherParams(), np.random.default_rng(0))


if __name__ == "__main__":
    main()
