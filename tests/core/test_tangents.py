"""Derivatives of flight and bounces are those of finite differences, and the flight is that of `walk`."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba import njit
from tt_core.events import MOST_BOUNCES, StopKind, walk_entry
from tt_core.physics import Physics, physics_coefficients
from tt_core.tangents import PARAMETERS, fly_through, scratch, start_tangents, with_factors

MIRROR = np.array([1, -1, 1, 1, -1, 1, -1, 1, -1])
WIDTH = np.array([0, 1.525, 0, 0, 0, 0, 0, 0, 0])  # y becomes 1.525 - y


@njit
def fly(parameters, duration, physics):
    state, tangents = parameters[:9].copy(), np.empty((9, PARAMETERS))
    start_tangents(tangents)
    bounces = fly_through(state, tangents, duration, with_factors(physics_coefficients(physics), parameters), scratch())
    return state, tangents, bounces


def parameters(spin, speed=-6.2, factors=(0.05, 0.1, -0.02, 0.05, 0.1)):
    return np.array([2.6, 0.76, 0.4, speed, 0.3, 1.0, *spin, *factors])


@pytest.mark.parametrize("physics", [Physics.liu(), Physics.measured()])
@pytest.mark.parametrize("duration", [0.1, 0.3, 0.7])
@given(st.tuples(*3 * [st.floats(10.0, 400.0) | st.floats(-400.0, -10.0)]), st.floats(-8.0, -4.5))  # (3.3) jumps at zero spin
@settings(max_examples=10)
def test_derivatives_are_those_of_finite_differences(physics, duration, spin, speed):
    start = parameters(spin, speed)
    _, tangents, bounces = fly(start, duration, physics.coefficients)
    found = np.empty_like(tangents)
    for k in range(PARAMETERS):
        moved = np.zeros(PARAMETERS)
        moved[k] = 1e-5 * max(1.0, abs(start[k]))
        (high, _, more), (low, _, less) = (fly(start + side * moved, duration, physics.coefficients) for side in (1, -1))
        assume(more == less == bounces)
        found[:, k] = (high - low) / (2 * moved[k])
    # 1e-5 of the largest: central differences, and the kink between slip and grip that hypothesis may hit within the difference
    scale = np.abs(found).max(axis=0) + 1e-9
    assert np.abs(tangents - found).max(axis=0) / scale == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("physics", [Physics.liu(), Physics.measured()])
@pytest.mark.parametrize("spin", [(20, -360, 30), (20, 320, 30), (0, 0, 0)])
def test_the_flight_is_that_of_walk(physics, spin):
    start, rows = parameters(spin, factors=np.zeros(5)), np.empty((400, 10))
    n, _, _ = walk_entry(0.0, start[:9], int(StopKind.TIME), 0.0, 0.7, physics.coefficients, rows, np.empty(MOST_BOUNCES, np.int64))
    assert fly(start, 0.7, physics.coefficients)[0] == pytest.approx(rows[n - 1, 1:], abs=1e-12)


@given(st.tuples(*3 * [st.floats(-400.0, 400.0)]))
@settings(max_examples=20)
def test_a_mirror_image_flies_mirrored(spin):
    physics, start = Physics.measured().coefficients, parameters(spin)
    other = start.copy()
    other[:9] = WIDTH + MIRROR * start[:9]
    (one, tangents, _), (two, mirrored, _) = fly(start, 0.7, physics), fly(other, 0.7, physics)
    assert two == pytest.approx(WIDTH + MIRROR * one, abs=1e-9)
    both = np.outer(MIRROR, np.concatenate([MIRROR, np.ones(5)]))
    assert mirrored == pytest.approx(both * tangents, abs=1e-7 * np.abs(tangents).max())


def test_a_ball_just_below_its_contact_has_just_bounced():
    physics = Physics.measured().coefficients
    start = parameters((0, 0, 0))
    start[2:6] = 0.018, -5.0, 0.0, -2.0
    state, _, bounces = fly(start, 0.01, physics)
    assert bounces == 1
    assert state[2] > 0.02


def test_a_ball_on_the_table_ends_the_loop():
    start = parameters((0, 0, 0), factors=(0, 0, 5.0, 0, 0))  # a restitution far above 1
    assert np.isfinite(fly(start, 5.0, Physics.measured().coefficients)[0]).all()
