"""The uncertainty by sigma points is that of thousands of sampled balls."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_predict.rollout import StopRule, rollout
from tt_predict.uncertainty import NoCovariance, NotACovariance, NotInTheAir, covariances, sigma_points, uncertainty

# m, m/s, rad/s: what six frames measure, about
SIGMAS = np.repeat([5e-4, 0.02, 10.0], 3)
SAMPLES = 2000


def ball(spin, sigmas=SIGMAS):
    return BallState(1.0, [2.6, 0.76, 0.45], [-6.2, 0.1, 1.0 if spin[1] < 100 else -0.4], spin, np.diag(sigmas**2))


def sampled(start, physics, stop):
    """(n, 10) ends of balls drawn from the covariance."""
    rng, ends = np.random.default_rng(0), []
    for row in rng.multivariate_normal(start.vector, start.covariance, SAMPLES):
        end = rollout(BallState.from_vector(start.time, row), physics, stop).end
        ends.append([end.time, *end.vector])
    return np.array(ends)


@pytest.mark.parametrize("physics", [Physics.liu(), Physics.measured()])
@pytest.mark.parametrize("spin", [[20, -360, 30], [20, 320, 30], [0, 30, 350]])
@pytest.mark.parametrize("stop", [StopRule.at_time(1.2), StopRule.at_landing(), StopRule.at_x(-0.2), StopRule.at_time(1.55)])
def test_the_uncertainty_is_that_of_sampled_balls(physics, spin, stop):
    start = ball(spin)
    found, ends = uncertainty(start, physics, stop), sampled(start, physics, stop)
    assert found.reached == 1.0
    wanted = np.cov(ends.T)
    sigma = np.sqrt(np.diag(wanted))
    floor = np.array([1e-6, *[1e-5] * 3, *[1e-4] * 3, *[1e-2] * 3])  # what is fixed by the rule, x at a plane, is certain
    # 8 %: 2,000 samples give 1.6 %, 256 points another 2 %, and the largest of ten is asked
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(sigma, rel=0.08, abs=1e-5)
    scale = np.maximum(sigma, floor)
    # 0.15 in correlation: the bounce is not linear, and 2,000 samples give 0.02
    assert found.covariance / np.outer(scale, scale) == pytest.approx(wanted / np.outer(scale, scale), abs=0.15)
    assert found.mean == pytest.approx(ends.mean(axis=0), abs=0.1 * sigma.max() + 1e-9)


@given(st.floats(0.0, 0.55))
def test_a_covariance_is_one(after):
    (found,) = covariances(ball([20, -360, 30]), Physics.liu(), [1.0 + after])
    assert found == pytest.approx(found.T)
    assert np.linalg.eigvalsh(found / np.outer(SIGMAS, SIGMAS))[0] > -1e-9


def test_it_starts_as_it_was_given_and_grows_with_time():
    start = ball([20, -360, 30])
    found = covariances(start, Physics.liu(), [1.0, 1.1, 1.2, 1.3])
    assert found[0] == pytest.approx(start.covariance, abs=1e-9)
    assert all(np.diff(np.trace(found[:, :3, :3], axis1=1, axis2=2)) > 0)
    assert np.cov(sigma_points(start).T, bias=True) == pytest.approx(start.covariance, abs=1e-9)


def test_balls_that_do_not_get_there_do_not_count():
    slow = BallState(0.0, [2.6, 0.76, 0.3], [-3.95, 0, 1.15], [0, 0, 0], np.diag(np.repeat([1e-3, 0.1, 10.0], 3) ** 2))
    found = uncertainty(slow, Physics.liu(), StopRule.at_x(1.3))  # some meet the net
    assert 0.0 < found.reached < 1.0
    assert uncertainty(slow, Physics.liu(), StopRule.at_x(5.0)) is None


def test_bad_input_names_itself():
    with pytest.raises(NoCovariance):
        uncertainty(BallState(0.0, [2.6, 0.76, 0.3], [-5, 0, 1], [0, 0, 0]), Physics.liu(), StopRule.at_landing())
    with pytest.raises(NotACovariance) as error:
        uncertainty(BallState(0.0, [2.6, 0.76, 0.3], [-5, 0, 1], [0, 0, 0], -np.eye(9)), Physics.liu(), StopRule.at_landing())
    assert error.value.eigenvalue == pytest.approx(-1.0)
    with pytest.raises(NotInTheAir) as error:
        covariances(ball([0, 0, 10]), Physics.liu(), [0.5])
    assert error.value.time == 0.5
