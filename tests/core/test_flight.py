"""Flight keeps what physics keeps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tt_core.errors import BadShape, NotFinite, OutOfRange
from tt_core.flight import Aerodynamics, fly

AIRS = [Aerodynamics.liu(), Aerodynamics.measured(), Aerodynamics.gravity_only()]
velocities = arrays(float, 3, elements=st.floats(-12, 12, allow_subnormal=False))
spins = arrays(float, 3, elements=st.floats(-900, 900, allow_subnormal=False))


def mirrored(v, w):
    """In the plane y = 0; spin is an axial vector."""
    return v * [1, -1, 1], w * [-1, 1, -1]


@pytest.mark.parametrize("air", AIRS)
@given(velocities, spins)
def test_a_mirror_image_flies_mirrored(air, v, w):
    a = air.acceleration(v, w)
    assert air.acceleration(*mirrored(v, w)) == pytest.approx(a * [1, -1, 1], abs=1e-9)


@pytest.mark.parametrize("air", AIRS)
@given(velocities, spins, st.floats(-math.pi, math.pi))
def test_the_air_is_the_same_in_every_direction(air, v, w, angle):
    if np.linalg.norm(np.cross(v, [0, 0, 1])) * np.linalg.norm(w) < 1e-6:
        return  # (3.3) is 0/0 near there, and its guard is a threshold
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    # 1e-5: (3.3) amplifies rounding of spins as small as the guard
    assert air.acceleration(turn @ v, turn @ w) == pytest.approx(turn @ air.acceleration(v, w), abs=1e-5)


@pytest.mark.parametrize("air", AIRS)
@given(velocities, spins)
def test_the_air_never_speeds_up_the_ball(air, v, w):
    assert (air.acceleration(v, w) + [0, 0, air.gravity]) @ v <= 1e-9


@pytest.mark.parametrize("air", AIRS)
@pytest.mark.parametrize("w", [[0, 0, 0], [0, 0, 300], [300, 0, 0]])
def test_no_spin_and_spin_along_the_flight_are_safe(air, w):
    assert np.isfinite(air.acceleration([5, 0, 0], w)).all()
    assert air.acceleration([0, 0, 0], w) == pytest.approx([0, 0, -air.gravity])


def test_topspin_pushes_down_and_backspin_up():
    for air in AIRS[:2]:
        assert air.acceleration([-5, 0, 0], [0, -300, 0])[2] < -air.gravity < air.acceleration([-5, 0, 0], [0, 300, 0])[2]


def test_without_air_it_is_the_parabola():
    state = fly(np.array([1.0, 2, 3, 4, 5, 6, 7, 8, 9]), 0.7, AIRS[2].coefficients)
    assert state == pytest.approx([1 + 2.8, 2 + 3.5, 3 + 4.2 - 4.9 * 0.49, 4, 5, 6 - 9.8 * 0.7, 7, 8, 9], abs=1e-13)


@pytest.mark.parametrize("air", AIRS)
def test_a_flight_is_exact_to_rounding(air):
    start = np.array([2.6, 0.8, 0.3, -7.0, 0.3, 2.0, 100.0, -400.0, 150.0])
    coarse, fine = fly(start, 0.6, air.coefficients), start
    for _ in range(3000):
        fine = fly(fine, 0.6 / 3000, air.coefficients)
    assert coarse[:3] == pytest.approx(fine[:3], abs=1e-10)  # m; 1.2e-11 for liu on the day
    assert fly(coarse, -0.6, air.coefficients) == pytest.approx(start, abs=1e-8)  # spin is the largest number


def test_spin_fades_with_the_time_constant():
    end = fly(np.array([0, 0, 0, 5, 0, 0, 0, 100.0, 0]), 0.5, Aerodynamics.measured().coefficients)
    assert end[7] == pytest.approx(100 * math.exp(-0.5 / 12.5))


def test_bad_values_name_themselves():
    with pytest.raises(OutOfRange) as error:
        Aerodynamics(drag=3.0)
    assert (error.value.name, error.value.value, error.value.low, error.value.high) == ("drag", 3.0, 0.0, 2.0)
    with pytest.raises(NotFinite) as error:
        Aerodynamics.liu().acceleration([math.nan, 0, 0], [0, 0, 0])
    assert error.value.name == "velocity"
    with pytest.raises(BadShape) as error:
        Aerodynamics.liu().acceleration([1, 0, 0], [0, 0])
    assert (error.value.name, error.value.shape, error.value.wanted) == ("spin", (2,), (3,))
