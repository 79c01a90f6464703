"""The linear error of landings is that of sampled strokes; the baselines do what their own models say."""

import math

import numpy as np
import pytest
from tt_core.bounce import RacketRebound
from tt_core.errors import OutOfRange
from tt_core.failures import Failure
from tt_core.flight import Aerodynamics, fly
from tt_core.physics import Physics
from tt_core.states import BallState, RacketState, ReturnGoal
from tt_racket.baselines import fixed_pitch, specular
from tt_racket.failures import StrokeFailure
from tt_racket.sensitivity import StrikeErrorParams, landing_rms
from tt_racket.stroke import Stroke, solve

PHYSICS = Physics.liu()
BALL = BallState(0.0, [-0.15, 0.7, 0.25], [-3.5, 0.2, 0.1], [20, -150, 30])
GOAL = ReturnGoal([2.055, 0.7625], 0.55, 60, 20)


def test_the_landing_error_is_that_of_sampled_strokes():
    stroke, errors, rng = solve(BALL, GOAL, PHYSICS), StrikeErrorParams(), np.random.default_rng(0)
    racket, off = stroke.racket, []
    for _ in range(4000):
        d = rng.normal(0.0, errors.sigmas)
        hit = RacketState(0.0, racket.position, racket.velocity + d[:3], racket.alpha + d[3], racket.beta + d[4] / math.cos(racket.alpha))
        after = PHYSICS.racket.after(BALL.velocity + d[5:8], BALL.spin + d[8:], hit)
        end = fly(np.concatenate([BALL.position, *after]), GOAL.flight_time, PHYSICS.air.coefficients)
        place = end[:2] - (end[2] - PHYSICS.contact_height) * end[3:5] / end[5]
        off.append(np.sum((place - GOAL.landing) ** 2))
    # 10 %: 4,000 samples give 2 %, the rest is curvature
    assert landing_rms(BALL, stroke, GOAL.flight_time, PHYSICS, errors) == pytest.approx(math.sqrt(np.mean(off)), rel=0.1)


def test_smaller_errors_land_nearer_and_no_stroke_lands_nowhere():
    stroke = solve(BALL, GOAL, PHYSICS)
    half = StrikeErrorParams(0.015, 0.005, 0.025, 7.5)
    rms = [landing_rms(BALL, stroke, GOAL.flight_time, PHYSICS, e) for e in (StrikeErrorParams(), half)]
    assert rms[1] == pytest.approx(0.5 * rms[0], rel=0.05)  # linear, but for the differences' size
    assert landing_rms(BALL, Stroke(None, None, 0.0, 0, Failure(StrokeFailure.NET, low=0.1)), 0.5, PHYSICS, half) == math.inf
    with pytest.raises(OutOfRange) as error:
        StrikeErrorParams(racket_angle=1.0)
    assert (error.value.name, error.value.value) == ("racket_angle", 1.0)


def test_acostas_stroke_lands_on_the_goal_of_its_own_model():
    """A mirror that takes 30 % of the energy, no air, no spin: restitution and tangential transfer alike."""
    kept = math.sqrt(0.7)
    mirror = Physics(Aerodynamics.gravity_only(), racket=RacketRebound(kept, 1.0 - kept, 0.0))
    still = BallState(0.0, BALL.position, BALL.velocity, np.zeros(3))
    assert specular(still, GOAL, mirror).residual < 1e-9
    assert specular(BALL, GOAL, PHYSICS).residual > 0.2  # m; the ball has spin and the rubber takes it


def test_yangs_racket_keeps_its_pitch():
    stroke = fixed_pitch(BALL, GOAL, PHYSICS, 0.3)
    assert stroke.racket.normal[2] == pytest.approx(math.sin(0.3))
    assert np.cross(stroke.racket.velocity, stroke.racket.normal) == pytest.approx(np.zeros(3), abs=1e-12)
    assert stroke.residual > 0.2
