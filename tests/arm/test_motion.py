"""One joint: what is called possible is done within the limits, and nothing faster is."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from tt_arm.motion import evaluate, farthest, fastest, least_time, polyline, possible, quintic, quintic_holds

SPEED, ACCELERATION = 2.0, 10.0
speeds, distances, times = st.floats(-SPEED, SPEED), st.floats(-2.0, 2.0), st.floats(0.01, 2.0)


def samples(fill, time, *ends):
    """q, qdot, qddot along a motion; an empty motion of seven equal joints carries it."""
    knots, c = np.full((7, 6), np.inf), np.zeros((7, 6, 6))
    for i in range(7):
        fill(time, *ends, knots[i], c[i])
    rows = []
    for t in np.linspace(0.0, time, 400):
        q, v, a = np.empty(7), np.empty(7), np.empty(7)
        evaluate(t, knots, c, q, v, a)
        rows.append((q[0], v[0], a[0]))
    return np.array(rows).T


def check(fill, time, distance, v0, v1):
    def limited(time, q0, v0, q1, v1, knots, c):
        return fill(time, q0, v0, q1, v1, SPEED, ACCELERATION, knots, c)

    q, v, a = samples(quintic if fill is quintic else limited, time, 0.3, v0, 0.3 + distance, v1)
    assert (q[0], v[0]) == pytest.approx((0.3, v0), abs=1e-9)
    assert (q[-1], v[-1]) == pytest.approx((0.3 + distance, v1), abs=1e-7)
    assert np.abs(v).max() <= SPEED * (1 + 1e-6)
    assert np.abs(a).max() <= ACCELERATION * (1 + 1e-3)  # rounding of very short pieces
    # the trapezoidal rule is exact for a speed of straight pieces but where it bends: a h^2 = 10 (time/400)^2
    step = time / 399
    assert np.abs(np.diff(q) - 0.5 * step * (v[1:] + v[:-1])).max() <= 2.0 * ACCELERATION * step**2 + 1e-9


@given(times, distances, speeds, speeds)
def test_what_is_possible_is_done_within_the_limits(time, distance, v0, v1):
    assume(possible(time, distance, v0, v1, SPEED, ACCELERATION))
    check(polyline, time, distance, v0, v1)


@given(times, distances, speeds, speeds)
def test_a_quintic_that_holds_keeps_the_limits(time, distance, v0, v1):
    assume(quintic_holds(time, 0.3, v0, 0.3 + distance, v1, SPEED, ACCELERATION))
    check(quintic, time, distance, v0, v1)
    assert possible(time, distance, v0, v1, SPEED, ACCELERATION)


@given(distances, speeds, speeds)
def test_the_least_time_is_possible_and_no_shorter_one(distance, v0, v1):
    time = least_time(distance, v0, v1, SPEED, ACCELERATION)
    assume(time > 1e-3)
    assert possible(time * (1 + 1e-6) + 1e-9, distance, v0, v1, SPEED, ACCELERATION) or abs(v0) > 0.0
    assert not any(possible(time * share, distance, v0, v1, SPEED, ACCELERATION) for share in np.linspace(0.3, 0.999, 30))


@given(distances, speeds)
def test_from_rest_every_longer_time_is_possible(distance, v1):
    time = least_time(distance, 0.0, v1, SPEED, ACCELERATION)
    assert all(possible(time + more, distance, 0.0, v1, SPEED, ACCELERATION) for more in np.geomspace(1e-6, 5.0, 40))


@given(times, speeds, speeds)
def test_a_mirror_image_moves_mirrored(time, v0, v1):
    assume(abs(v1 - v0) < ACCELERATION * time)
    most, least = farthest(time, v0, v1, SPEED, ACCELERATION), -farthest(time, -v0, -v1, SPEED, ACCELERATION)
    assert least <= most + 1e-12
    backwards = farthest(time, v1, v0, SPEED, ACCELERATION)  # the same motion run backwards
    assert backwards == pytest.approx(most, abs=1e-9)


@given(times, distances, speeds)
def test_the_fastest_end_is_possible_and_no_faster_one(time, distance, v0):
    high, low = fastest(time, distance, v0, SPEED, ACCELERATION), -fastest(time, -distance, -v0, SPEED, ACCELERATION)
    assume(high - low > 1e-3)
    for share in (1e-6, 0.5, 1.0 - 1e-6):
        assert possible(time, distance, v0, low + share * (high - low), SPEED, ACCELERATION)
    for v1 in (high + 1e-3, low - 1e-3):
        assert abs(v1) > SPEED or not possible(time, distance, v0, v1, SPEED, ACCELERATION)
