"""Strokes as they come in play: made, or refused with the reason, and no limit is ever broken in the plant's own record."""

import numpy as np
import pytest
from tt_arm.model import ArmModel
from tt_arm.reach import ReachFailure
from tt_arm.swing import SwingFailure, SwingLimits
from tt_eval.arm_trial import TrialFailure, arm_trial, launched_ball_strokes
from tt_sim.world.launcher import SHOT_KINDS
from tt_sim.world.plant import PlantParams

MODEL = ArmModel.pa10()
NOISY = PlantParams(time_constant=0.007, q_noise=5e-5, qdot_noise=5e-3)


@pytest.mark.parametrize("kind", SHOT_KINDS)
@pytest.mark.parametrize("scale", [3, 4, 5])
def test_strokes_of_play_are_made_or_refused_within_all_limits(kind, scale):
    for seed in (100, 101):
        done = arm_trial(MODEL, launched_ball_strokes(kind, scale, seed), NOISY, seed)
        assert done.reason is None or isinstance(done.reason.code, (ReachFailure, SwingFailure, TrialFailure))
        assert done.room > 0.0
        assert done.speed <= 1.0
        assert done.acceleration <= 40.0 + 1e-6  # rad/s^2, the guard's
        assert done.clear > 0.9 * SwingLimits().clearance
        assert done.guarded == frozenset()
        if done.reason is None:
            assert done.miss < 0.010  # m; the plant is 2 ms slower than the servo believes: 2 ms at 3 m/s are 6 mm
            assert done.tilt < np.radians(1.5)  # 2 ms at 6 rad/s are 0.7 degrees
