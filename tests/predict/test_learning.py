"""The learner finds the coefficients of a session from flights and returns, as well as it says, and no more than it may."""

import numpy as np
import pytest
from tt_core.errors import BadShape
from tt_core.factors import FACTORS, OF_BALL, scaled
from tt_core.physics import Physics
from tt_core.states import BallState, RacketState
from tt_predict.learning import LearningParams, PhysicsLearner

PHYSICS, PARAMS = Physics.measured(), LearningParams()
SESSION, BALL = np.array(PARAMS.session_spreads), np.array(PARAMS.ball_spreads)
RACKET = RacketState.facing(0.0, [-0.3, 0.7, 0.3], [1.5, 0.2, 0.8], np.array([0.9, 0.1, np.sqrt(0.18)]))
TURNING = np.array([1.0, -2.0, 3.0])
SIGMAS = np.repeat([1e-3, 0.01, 2.0], 3)  # m, m/s, rad/s: of the tracker's ball before the racket
SEEN = np.repeat([2e-3, 0.02, 20.0], 3)  # the same after it


def incoming(rng):
    """A ball at the racket, from in front of it."""
    velocity = np.array([-4.0, 0.0, -0.5]) + rng.normal(0.0, 0.5, 3)
    place = RACKET.position + 0.02 * RACKET.normal + rng.normal(0.0, 5e-3, 3)
    return np.concatenate([place, velocity, rng.normal(0.0, 150.0, 3)])


def play(learner, truth, rng, scale=1.0):
    """One ball: what a tracker finds out about it, with the errors that it knows of. Return the logarithms of its factors."""
    factors = truth + scale * BALL * rng.normal(size=7)
    prior, noise = np.diag(learner.spreads[:OF_BALL] ** 2), np.diag((0.5 * SESSION[:OF_BALL]) ** 2)
    gain = prior @ np.linalg.inv(prior + noise)
    residual = factors[:OF_BALL] - learner.logarithms[:OF_BALL] + np.sqrt(np.diag(noise)) * rng.normal(size=OF_BALL)
    learner.add_flight(gain @ residual, prior - gain @ prior)
    true = incoming(rng)
    before = BallState.from_vector(0.0, true + SIGMAS * rng.normal(size=9), np.diag(SIGMAS**2))
    expected = learner.expect_return(before, RACKET, TURNING)
    after = PhysicsLearner(scaled(PHYSICS, factors)).expect_return(BallState.from_vector(0.0, true, np.diag(SIGMAS**2)), RACKET, TURNING)
    seen = after.ball.vector + SEEN * rng.normal(size=9)
    covariance = expected.ball.covariance
    gain = covariance @ np.linalg.inv(covariance + np.diag(SEEN**2))
    posterior = expected.ball.vector + gain @ (seen - expected.ball.vector)
    learner.add_return(expected, BallState.from_vector(0.0, posterior, covariance - gain @ covariance))
    return factors


def test_a_session_is_learnt_as_well_as_told():
    rng, distances = np.random.default_rng(0), []
    for _ in range(12):
        truth, learner = SESSION * rng.normal(size=7), PhysicsLearner(PHYSICS, LearningParams(ball_scales=(1.0, 1.0, 1.0)))
        for _ in range(10):
            play(learner, truth, rng)
        sigma = np.sqrt(learner.spreads**2 - BALL**2)
        distances.append((learner.logarithms - truth) / sigma)
        assert (sigma[OF_BALL:] < 0.5 * SESSION[OF_BALL:]).all()
    # 84 numbers, of which the mean square scatters by 0.15
    assert np.mean(np.square(distances)) == pytest.approx(1.0, abs=0.5)


@pytest.mark.parametrize(("session", "scale"), [(1.0, 1.0), (0.0, 5.0)])
def test_the_next_ball_differs_from_what_was_learnt_as_much_as_told(session, scale):
    """In the first case the balls of a session are alike. In the second one all sessions are alike, and the balls differ."""
    rng, distances = np.random.default_rng(2), []
    for _ in range(6):
        truth, learner = session * SESSION * rng.normal(size=7), PhysicsLearner(PHYSICS)
        for number in range(30):
            learnt, spreads = learner.logarithms, learner.spreads
            factors = play(learner, truth, rng, scale)
            if number >= 10:
                distances.append((factors - learnt) / spreads)
    # the mean of 840 numbers, of which those of one session depend on each other; a filter for alike balls has 20 in the second case
    assert np.mean(np.square(distances)) == pytest.approx(1.0, abs=0.3)


def test_the_next_ball_is_played_with_what_was_learnt():
    learner = PhysicsLearner(PHYSICS)
    assert learner.physics == scaled(PHYSICS, np.zeros(7))
    covariance = np.diag((0.3 * learner.spreads[:OF_BALL]) ** 2)
    assert learner.add_flight(np.array([0.03, 0.0, 0.0, 0.0, 0.0]), covariance)
    assert PHYSICS.air.drag < learner.physics.air.drag < PHYSICS.air.drag * np.exp(0.03)
    assert learner.physics.racket == PHYSICS.racket


def test_nothing_is_learnt_beyond_the_bound_nor_from_what_does_not_fit():
    learner = PhysicsLearner(PHYSICS, LearningParams(farthest=0.5, gate=1e6))
    tight = np.diag((0.01 * learner.spreads[:OF_BALL]) ** 2)
    for _ in range(20):
        learner.add_flight(np.full(OF_BALL, 0.2), tight)
    assert learner.logarithms[:OF_BALL] == pytest.approx(0.5 * SESSION[:OF_BALL])
    strict = PhysicsLearner(PHYSICS)
    assert not strict.add_flight(np.full(OF_BALL, 0.9), tight)
    assert strict.logarithms == pytest.approx(0.0)


def test_a_return_has_the_derivatives_it_says():
    rng, h = np.random.default_rng(1), 1e-3
    ball = BallState.from_vector(0.0, incoming(rng), np.diag(SIGMAS**2))
    expected = PhysicsLearner(PHYSICS).expect_return(ball, RACKET, TURNING)
    for k in range(2):
        logarithms = np.zeros(len(FACTORS))
        logarithms[OF_BALL + k] = h
        high, low = (PhysicsLearner(scaled(PHYSICS, s * logarithms)).expect_return(ball, RACKET, TURNING).ball.vector for s in (1, -1))
        assert expected.slopes[:, k] == pytest.approx((high - low) / (2 * h), rel=1e-3, abs=1e-6)


def test_a_ball_that_flies_away_from_the_racket_is_not_returned():
    away = BallState(0.0, RACKET.position + 0.02 * RACKET.normal, RACKET.velocity, [0, 0, 0], np.eye(9))
    assert PhysicsLearner(PHYSICS).expect_return(away, RACKET, TURNING) is None


def test_wrong_shapes_are_refused():
    with pytest.raises(BadShape):
        LearningParams(ball_spreads=(0.1,))
    with pytest.raises(BadShape):
        PhysicsLearner(PHYSICS).add_flight(np.zeros(4), np.eye(5))
