"""The filter estimates how much the balls of one session differ from each other."""

import numpy as np
import pytest
from tt_predict.factor_filter import FIRST_PROBABILITY, FactorFilter

SESSION, BALL = np.array([0.04, 0.1]), np.array([0.008, 0.02])
SCALES = (1.0, 2.0, 5.0)
NOISE = np.diag((0.2 * SESSION) ** 2)


def observe(known, factors, rng):
    """Give the filter one ball, whose factors are measured with NOISE. Return whether the filter used it."""
    prior = np.diag(np.diag(known.covariance))
    gain = prior @ np.linalg.inv(prior + NOISE)
    measured = rng.multivariate_normal(factors, NOISE)
    return known.add(prior, gain @ (measured - known.mean), prior - gain @ prior, gate=20.0)


@pytest.mark.parametrize("right", [0, 1, 2])
def test_the_right_hypothesis_becomes_the_most_probable_one(right):
    rng, found = np.random.default_rng(0), []
    for _ in range(20):
        session, known = SESSION * rng.normal(size=2), FactorFilter(SESSION, BALL, SCALES, 0.02, 3.0)
        for _ in range(40):
            observe(known, session + SCALES[right] * BALL * rng.normal(size=2), rng)
        assert known.probabilities.sum() == pytest.approx(1.0)
        found.append(np.argmax(known.probabilities))
    assert found.count(right) >= 18  # 80 differences tell a standard deviation within 8 %; the hypotheses are a factor of 2 apart


def test_equal_hypotheses_are_one_kalman_filter():
    rng = np.random.default_rng(1)
    known, session = FactorFilter(SESSION, BALL, (1.0, 1.0), 0.0, 3.0), 0.5 * SESSION
    mean, covariance, ball = np.zeros(2), np.diag(SESSION**2), np.diag(BALL**2)
    for _ in range(10):
        prior = np.diag(np.diag(known.covariance))
        gain = prior @ np.linalg.inv(prior + NOISE)
        measured = rng.multivariate_normal(session, ball + NOISE)
        assert known.add(prior, gain @ (measured - known.mean), prior - gain @ prior, gate=1e6)
        gain = covariance @ np.linalg.inv(covariance + ball + NOISE)
        mean, covariance = mean + gain @ (measured - mean), covariance - gain @ covariance
        assert known.mean == pytest.approx(mean) and known.covariance == pytest.approx(covariance + ball)
    assert known.probabilities[0] == pytest.approx(FIRST_PROBABILITY)  # no ball tells one from the other


def test_it_notices_that_the_balls_differ_more_than_before():
    rng, known = np.random.default_rng(2), FactorFilter(SESSION, BALL, SCALES, 0.02, 3.0)
    for _ in range(30):
        observe(known, BALL * rng.normal(size=2), rng)
    assert np.argmax(known.probabilities) == 0
    used = [observe(known, SCALES[2] * BALL * rng.normal(size=2), rng) for _ in range(30)]
    assert np.argmax(known.probabilities) == 2
    assert sum(used) >= 20


def test_what_tells_nothing_changes_nothing():
    known = FactorFilter(SESSION, BALL, SCALES, 0.0, 3.0)
    prior = known.covariance
    before = known.mean, known.covariance, known.probabilities
    assert known.add(prior, np.zeros(2), prior.copy(), gate=20.0)
    assert all(np.allclose(new, old) for new, old in zip((known.mean, known.covariance, known.probabilities), before, strict=True))


def test_a_factor_that_is_known_exactly_is_learnt_at_once():
    known = FactorFilter(SESSION, BALL, (1.0, 1.0, 1.0), 0.0, 3.0)
    assert known.add(known.covariance, SESSION, np.zeros((2, 2)), gate=20.0)
    share = SESSION**2 / (SESSION**2 + BALL**2)  # of the factor of one ball, the rest is the ball's own
    assert known.mean == pytest.approx(share * SESSION, rel=1e-4)  # the estimate is believed to 1e-5, the square root of LEAST_VARIANCE
