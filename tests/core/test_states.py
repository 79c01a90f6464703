"""States copy, check and freeze what they hold."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tt_core.errors import BadShape, NotFinite, OutOfRange, TtError
from tt_core.flight import Aerodynamics, fly
from tt_core.states import BallPath, BallState, RacketState, ReturnGoal


def test_arrays_are_copied_and_frozen():
    position = np.array([1.0, 2, 3])
    ball = BallState(0.0, position, [0, 0, 0], [0, 0, 0])
    position[0] = 9.0
    assert ball.position[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        ball.position[0] = 5.0


def test_bad_values_name_themselves():
    with pytest.raises(BadShape, match=r"position has shape \(2,\), wanted \(3,\)"):
        BallState(0.0, [1, 2], [0, 0, 0], [0, 0, 0])
    with pytest.raises(NotFinite, match="spin"):
        BallState(0.0, [1, 2, 3], [0, 0, 0], [0, math.inf, 0])
    with pytest.raises(OutOfRange, match="flight_time = 0"):
        ReturnGoal([2.0, 0.7], 0.0, 0.0, 0.0)
    with pytest.raises(TtError, match="must not decrease"):
        BallPath([1.0, 0.5], np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)))


@given(st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_the_normal_gives_the_angles_back(alpha, beta):
    racket = RacketState(0.0, np.zeros(3), np.zeros(3), alpha, beta)
    again = RacketState.facing(0.0, np.zeros(3), np.zeros(3), racket.normal)
    assert (again.alpha, again.beta) == pytest.approx((alpha, beta), abs=1e-6)
    assert racket.rotation @ racket.rotation.T == pytest.approx(np.eye(3), abs=1e-12)


def test_a_path_is_as_exact_between_its_points_as_it_says():
    c = Aerodynamics.liu().coefficients
    start = np.array([2.6, 0.8, 0.3, -7.0, 0.3, 2.0, 100.0, -400.0, 150.0])
    times = np.arange(0, 0.5, 0.02)
    states = np.array([fly(start, t, c) for t in times])
    path = BallPath(times, states[:, :3], states[:, 3:6], states[:, 6:])
    for t in np.linspace(0, 0.48, 97):
        assert path.at(t).position == pytest.approx(fly(start, t, c)[:3], abs=1e-7)  # m, as BallPath promises
    with pytest.raises(OutOfRange, match="time = 0.6"):
        path.at(0.6)
