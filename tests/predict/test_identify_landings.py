"""Coefficients of the air come back from shots and their first bounces."""

import numpy as np
import pytest
from tt_core.errors import TtError
from tt_core.path_end import PathEnd
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_predict.identify import NoFlights, identify_landings, with_coefficients
from tt_predict.landing_fit import BadLandings
from tt_predict.rollout import StopRule, rollout

NAMES = ("air.drag", "air.lift_ratio", "air.ratio_offset")
VALUES = [0.095 / 0.2755, 0.118, 0.239]  # about those of professional match play: k_d = 0.095 1/m, K = 1.67e-3 / (0.239 + S)
TRUE = with_coefficients(Physics.measured(), NAMES, VALUES)


def pairs(count, noise=0.0, seed=0, start=0.0):
    """States of random shots, and place and time of their bounces with noise (m, and a tenth of it in s)."""
    rng, states, landings, times = np.random.default_rng(seed), [], [], []
    while len(states) < count:
        velocity = [rng.uniform(-13, -5), rng.uniform(-1, 1), rng.uniform(-0.5, 2.5)]
        spin = rng.normal(0.0, 1.0, 3) * [40, 200, 150]
        ball = BallState(start, [rng.uniform(2.6, 3.4), rng.uniform(0.2, 1.3), rng.uniform(0.1, 0.6)], velocity, spin)
        path = rollout(ball, TRUE, StopRule.at_landing())
        if path.ended is PathEnd.STOP and path.end.position[0] < 1.37:
            states.append(ball)
            landings.append(path.end.position[:2] + rng.normal(0.0, noise, 2))
            times.append(path.end.time + rng.normal(0.0, 0.1 * noise))
    return states, np.array(landings), np.array(times)


def test_exact_pairs_give_their_coefficients_back():
    found = identify_landings(*pairs(60))
    assert found.values == pytest.approx(VALUES, rel=2e-3)  # the weak prior pulls by that much
    assert found.errors[1] < 1e-3 < found.errors[0]
    assert found.physics.air.drag == found.values[0]


def test_the_clock_of_the_states_does_not_matter():
    states, landings, times = pairs(20, 0.02)
    later, _, late = pairs(20, 0.02, start=1e3)
    rows = np.array([state.vector for state in states])
    for other in (identify_landings(later, landings, late), identify_landings(rows, np.column_stack([landings, np.zeros(20)]), times)):
        assert other.values == pytest.approx(identify_landings(states, landings, times).values, rel=1e-4)


def test_the_intervals_hold_the_truth():
    """95 % of 20 trials of three coefficients: 57 of 60; bound at 50, as 100 pairs are few for a sandwich."""
    inside = 0
    for seed in range(20):
        found = identify_landings(*pairs(100, 0.05, seed))
        inside += int((np.abs(found.values - VALUES) < found.intervals).sum())
    assert inside >= 50


def test_wrong_pairs_count_little():
    states, landings, times = pairs(100, 0.02)
    landings[::10] += 0.7
    found = identify_landings(states, landings, times)
    assert (np.abs(found.values - VALUES) < 2.0 * found.intervals).all()


def test_few_pairs_stay_near_the_models():
    found = identify_landings(*pairs(1, 0.05))
    assert found.physics.air.drag == pytest.approx(Physics.measured().air.drag, rel=0.5)


def test_bad_input_names_itself():
    states, landings, times = pairs(3)
    with pytest.raises(NoFlights):
        identify_landings([], np.empty((0, 2)), [])
    for wrong in (
        (states, landings[:2], times),
        (states, landings, times[:2]),
        (states, landings, -times),
        (states, landings, times + 100.0),
    ):
        with pytest.raises(BadLandings):
            identify_landings(*wrong)
    for wrong in ((states, landings[:, :1], times), (states, landings * np.nan, times), (np.zeros((3, 8)), landings, times)):
        with pytest.raises(TtError):
            identify_landings(*wrong)
    with pytest.raises(TtError):
        identify_landings(states, landings, times, names=("table.restitution",))
