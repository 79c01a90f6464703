"""The inverse of the rebound is its inverse, on the physical side."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tt_core.bounce import RacketRebound, racket_coefficients
from tt_core.states import RacketState
from tt_racket.impact import racket_for, spin_after

RUBBERS = [RacketRebound.liu(), RacketRebound.measured()]
incoming = arrays(float, 3, elements=st.floats(-1, 1, allow_subnormal=False)).map(lambda v: v + [-4.0, 0, 0])
spins = arrays(float, 3, elements=st.floats(-400, 400, allow_subnormal=False))
rackets = arrays(float, 3, elements=st.floats(-2, 2, allow_subnormal=False))


@pytest.mark.parametrize("rubber", RUBBERS)
@given(incoming, spins, rackets, st.floats(-0.8, 0.8), st.floats(0.6, 2.4))
def test_a_hit_gives_its_racket_back(rubber, v0, w0, velocity, alpha, beta):
    racket = RacketState(0.0, np.zeros(3), velocity, alpha, beta)
    if (v0 - velocity) @ racket.normal > -0.5:
        return
    v1, w1 = rubber.after(v0, w0, racket)
    got_velocity, normal = np.empty(3), np.empty(3)
    share = racket_for(v0, w0, v1, w1, racket_coefficients(rubber.coefficients), got_velocity, normal)
    assert share <= 1.0 + 1e-9
    if share < 0.999:  # at 1 the two roots meet, and the normal goes as the square root of the rounding error
        assert normal == pytest.approx(racket.normal, abs=1e-6)
        assert got_velocity == pytest.approx(velocity, abs=1e-5)
        assert normal @ (v1 - v0) > 0


@given(
    incoming, spins, arrays(float, 3, elements=st.floats(-1, 1)).map(lambda v: v + [4.0, 0, 2]), st.floats(-300, 300), st.floats(-300, 300)
)
def test_the_spin_condition_holds(v0, w0, v1, spin_y, spin_z):
    w1 = np.empty(3)
    spin_after(v0, w0, v1, spin_y, spin_z, w1)
    assert (w1[1], w1[2]) == (spin_y, spin_z)
    assert (v1 - v0) @ (w1 - w0) == pytest.approx(0, abs=1e-8)  # (4.16)


def test_more_spin_than_the_rubber_gives_is_told():
    v0, w0, v1 = np.array([-4.0, 0, 0]), np.zeros(3), np.array([4.0, 0, 2.0])
    most = RacketRebound.liu().turn * np.linalg.norm(v1 - v0)
    rubber = racket_coefficients(RacketRebound.liu().coefficients)
    share = racket_for(v0, w0, v1, np.array([0, 2 * most, 0]), rubber, np.empty(3), np.empty(3))
    assert share == pytest.approx(2.0)
