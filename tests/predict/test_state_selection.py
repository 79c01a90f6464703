"""Few states are predicted, none whose spin is not known yet, unless nothing better comes."""

import numpy as np
from tt_core.states import BallState
from tt_predict.state_selection import StateSelection, StateSelectionParams

UNKNOWN, KNOWN = np.repeat([1e-3, 0.1, 300.0], 3) ** 2, np.repeat([1e-3, 0.1, 5.0], 3) ** 2


def ball(time, x=2.5, variances=KNOWN):
    return BallState(time, [x, 0.7, 0.3], [-5, 0, 1], [0, 0, 0], np.diag(variances))


def test_states_are_taken_no_sooner_than_the_interval():
    selection = StateSelection(StateSelectionParams(interval=0.03))
    times = np.arange(0.0, 0.2, 0.01)
    taken = [t for t in times if selection.takes(ball(t, 2.5 - 5 * t))]
    assert np.allclose(taken, [0.0, 0.03, 0.06, 0.09, 0.12, 0.15, 0.18])


def test_an_unknown_spin_is_waited_for_but_not_for_ever():
    selection = StateSelection(StateSelectionParams(patience=0.1))
    assert not selection.takes(ball(0.0, variances=UNKNOWN))
    assert selection.takes(ball(0.01))  # measured
    assert not selection.takes(ball(2.0, variances=UNKNOWN))  # another ball
    assert not selection.takes(ball(2.09, 2.2, UNKNOWN))
    assert selection.takes(ball(2.11, 2.1, UNKNOWN))


def test_another_ball_that_follows_soon_is_taken_for_one():
    selection = StateSelection(StateSelectionParams(interval=0.1))
    assert selection.takes(ball(0.0, 0.0))
    assert not selection.takes(ball(0.02, -0.1))
    assert selection.takes(ball(0.04, 2.5))


def test_a_state_without_covariance_is_taken():
    assert StateSelection(StateSelectionParams()).takes(BallState(0.0, [2.5, 0.7, 0.3], [-5, 0, 1], [0, 0, 0]))
