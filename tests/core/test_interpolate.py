"""Interpolation is exact for what it assumes, and its derivative is its derivative."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tt_core.interpolate import hermite, hermite_rate, hermite_weights, interpolate_states

numbers = st.floats(-10.0, 10.0)
shares = st.floats(0.0, 1.0)


@given(st.lists(numbers, min_size=4, max_size=4), st.floats(0.01, 1.0), shares)
def test_a_cubic_is_met_exactly(powers, duration, share):
    def value(t):
        return np.polynomial.polynomial.polyval(t, powers)

    def rate(t):
        return np.polynomial.polynomial.polyval(t, np.polynomial.polynomial.polyder(powers))

    ends = value(0.0), rate(0.0), value(duration), rate(duration)
    assert hermite(*ends, duration, share) == pytest.approx(value(share * duration), abs=1e-12)
    assert np.dot(hermite_weights(duration, share), ends) == pytest.approx(value(share * duration), abs=1e-12)
    assert hermite_rate(*ends, duration, share) == pytest.approx(rate(share * duration), abs=1e-9)


@given(numbers, numbers, numbers, numbers, st.floats(0.1, 1.0), st.floats(0.01, 0.99))
def test_the_rate_is_the_derivative(p0, v0, p1, v1, duration, share):
    d = 1e-6
    values = [hermite(p0, v0, p1, v1, duration, share + s) for s in (-d, d)]
    # central differences of numbers up to 10 over 2e-6: rounding gives 1e-9, curvature 1e-9
    assert hermite_rate(p0, v0, p1, v1, duration, share) == pytest.approx((values[1] - values[0]) / (2 * d * duration), abs=1e-6)


def test_at_a_bounce_the_state_after_it_counts():
    times = np.array([0.0, 0.1, 0.1, 0.2])
    states = np.zeros((4, 9))
    states[:, 8] = [1.0, 1.0, 5.0, 7.0]  # spin z jumps
    assert interpolate_states(times, states, np.array([0.05, 0.1, 0.15, 0.2]))[:, 8] == pytest.approx([1.0, 5.0, 6.0, 7.0])
