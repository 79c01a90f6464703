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
    with pytest.raises(ValueError):
        ball.position[0] = 5.0


def test_bad_values_name_themselves():
    with pytest.raises(BadShape) as error:
        BallState(0.0, [1, 2], [0, 0, 0], [0, 0, 0])
    assert (error.value.name, error.value.shape, error.value.wanted) == ("position", (2,), (3,))
    with pytest.raises(NotFinite) as error:
        BallState(0.0, [1, 2, 3], [0, 0, 0], [0, math.inf, 0])
    assert error.value.name == "spin"
    with pytest.raises(OutOfRange) as error:
        ReturnGoal([2.0, 0.7], 0.0, 0.0, 0.0)
    assert (error.value.name, error.value.value) == ("flight_time", 0.0)
    for times in ([1.0, 0.5], []):
        with pytest.raises(TtError):
            BallPath(times, *[np.zeros((len(times), 3))] * 3)


def test_a_goal_is_its_vector():
    goal = ReturnGoal([2.0, 0.7], 0.6, -100.0, 20.0)
    again = ReturnGoal.from_vector(goal.vector)
    assert goal.vector == pytest.approx([2.0, 0.7, 0.6, -100.0, 20.0], abs=0.0)
    assert (*again.landing, again.flight_time, again.spin_y, again.spin_z) == tuple(goal.vector)
    with pytest.raises(ValueError):
        goal.landing[0] = 1.0


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
    with pytest.raises(OutOfRange) as error:
        path.at(0.6)
    assert (error.value.name, error.value.value) == ("time", 0.6)
