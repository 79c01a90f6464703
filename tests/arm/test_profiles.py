"""One joint: what is called possible is done within the limits, and nothing faster is."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from tt_arm.trajectory.profiles import (
    Bounds,
    Ends,
    decay,
    evaluate_path,
    is_possible,
    largest_distance,
    largest_end_speed,
    least_time,
    polyline,
    quintic,
    quintic_is_possible,
    trapezoid,
    trapezoid_is_possible,
)

SPEED, ACCELERATION, JERK = 2.0, 10.0, 1000.0
BOUNDS = Bounds(SPEED, ACCELERATION, JERK)
speeds, distances, times = st.floats(-SPEED, SPEED), st.floats(-2.0, 2.0), st.floats(0.01, 2.0)
accelerations = st.floats(-ACCELERATION, ACCELERATION)


def samples(fill, time, *given):
    """q, qdot, qddot along a motion; an empty motion of seven equal joints carries it."""
    knots, c = np.full((7, 13), np.inf), np.zeros((7, 13, 6))
    for i in range(7):
        fill(time, *given, knots[i], c[i])
    rows = []
    for t in np.linspace(0.0, time, 400):
        q, v, a = np.empty(7), np.empty(7), np.empty(7)
        evaluate_path(t, knots, c, q, v, a)
        rows.append((q[0], v[0], a[0]))
    return np.array(rows).T


def check(q, v, a, time, start, end):
    """From start to end (position, speed), within the limits, and speed is the slope of position."""
    assert (q[0], v[0]) == pytest.approx(start, abs=1e-9)
    assert (q[-1], v[-1]) == pytest.approx(end, abs=1e-7)
    assert np.abs(v).max() <= SPEED * (1 + 1e-6)
    assert np.abs(a).max() <= ACCELERATION * (1 + 1e-3)  # rounding of very short pieces
    # the trapezoidal rule is exact for a speed of straight pieces but where it bends: a h^2 = 10 (time/400)^2
    step = time / 399
    assert np.abs(np.diff(q) - 0.5 * step * (v[1:] + v[:-1])).max() <= 2.0 * ACCELERATION * step**2 + 1e-9


def check_jerk(a, time, start):
    """From the acceleration `start` to none without a step: no change is more than the jerk limit makes."""
    assert (a[0], a[-1]) == pytest.approx((start, 0.0), abs=1e-6)
    assert np.abs(np.diff(a)).max() <= JERK * time / 399 * (1 + 1e-3) + 1e-6  # rounding of very short pieces, as above


@given(times, distances, speeds, speeds)
def test_what_is_possible_is_done_within_the_limits(time, distance, v0, v1):
    assume(is_possible(time, distance, v0, v1, SPEED, ACCELERATION))
    check(*samples(polyline, time, Ends(0.3, v0, 0.0, 0.3 + distance, v1), BOUNDS), time, (0.3, v0), (0.3 + distance, v1))


@given(times, distances, speeds, accelerations, speeds)
def test_a_quintic_that_holds_keeps_the_limits(time, distance, v0, a0, v1):
    ends = Ends(0.3, v0, a0, 0.3 + distance, v1)
    assume(quintic_is_possible(time, ends, BOUNDS))
    q, v, a = samples(quintic, time, ends)
    check(q, v, a, time, (0.3, v0), (0.3 + distance, v1))
    check_jerk(a, time, a0)
    assert is_possible(time, distance, v0, v1, SPEED, ACCELERATION)


@given(times, st.floats(0.0, 1.0), speeds, accelerations, speeds)
def test_a_trapezoid_keeps_the_limits_and_that_of_jerk(time, share, v0, a0, v1):
    """A distance between the least and the most that are possible."""
    first, eased_by, v = decay(0.0, v0, a0, JERK)
    within = time - first - 2.0 * ACCELERATION / JERK
    assume(abs(v) <= SPEED and within > 1e-3 and abs(v1 - v) < ACCELERATION * within)
    most, least = largest_distance(within, v, v1, SPEED, ACCELERATION), -largest_distance(within, -v, -v1, SPEED, ACCELERATION)
    end = 0.3 + eased_by + least + share * (most - least) + ACCELERATION / JERK * (v + v1)
    ends = Ends(0.3, v0, a0, end, v1)
    assert trapezoid_is_possible(time, ends, BOUNDS)
    q, v, a = samples(trapezoid, time, ends, BOUNDS)
    check(q, v, a, time, (0.3, v0), (end, v1))
    check_jerk(a, time, a0)


@given(times, distances, speeds, accelerations, speeds)
def test_no_trapezoid_does_what_no_polyline_can(time, distance, v0, a0, v1):
    ends = Ends(0.3, v0, 0.0, 0.3 + distance, v1)
    if trapezoid_is_possible(time, ends, BOUNDS):
        assert is_possible(time, distance, v0, v1, SPEED, ACCELERATION)
    assert not trapezoid_is_possible(0.5 * ACCELERATION / JERK, ends, BOUNDS)  # a ramp takes more


@given(distances, speeds)
def test_a_trapezoid_takes_a_ramp_more_than_a_polyline(distance, v1):
    """From rest, whose end is shifted by half a ramp at v1."""
    ramp = 2.0 * ACCELERATION / JERK
    time = ramp + least_time(distance - 0.5 * ramp * v1, 0.0, v1, SPEED, ACCELERATION)
    assume(time > ramp + 1e-3)
    ends = Ends(0.3, 0.0, 0.0, 0.3 + distance, v1)
    for more in (1e-6, 0.1, 1.0):
        assert trapezoid_is_possible(time + more, ends, BOUNDS)
    assert not trapezoid_is_possible(time - 1e-4, ends, BOUNDS)


@given(distances, speeds, speeds)
def test_the_least_time_is_possible_and_no_shorter_one(distance, v0, v1):
    time = least_time(distance, v0, v1, SPEED, ACCELERATION)
    assume(time > 1e-3)
    assert is_possible(time * (1 + 1e-6) + 1e-9, distance, v0, v1, SPEED, ACCELERATION) or abs(v0) > 0.0
    assert not any(is_possible(time * share, distance, v0, v1, SPEED, ACCELERATION) for share in np.linspace(0.3, 0.999, 30))


@given(distances, speeds)
def test_from_rest_every_longer_time_is_possible(distance, v1):
    time = least_time(distance, 0.0, v1, SPEED, ACCELERATION)
    assert all(is_possible(time + more, distance, 0.0, v1, SPEED, ACCELERATION) for more in np.geomspace(1e-6, 5.0, 40))


@given(times, speeds, speeds)
def test_a_mirror_image_moves_mirrored(time, v0, v1):
    assume(abs(v1 - v0) < ACCELERATION * time)
    most, least = largest_distance(time, v0, v1, SPEED, ACCELERATION), -largest_distance(time, -v0, -v1, SPEED, ACCELERATION)
    assert least <= most + 1e-12
    backwards = largest_distance(time, v1, v0, SPEED, ACCELERATION)  # the same motion run backwards
    assert backwards == pytest.approx(most, abs=1e-9)


@given(times, distances, speeds)
def test_the_fastest_end_is_possible_and_no_faster_one(time, distance, v0):
    high, low = largest_end_speed(time, distance, v0, SPEED, ACCELERATION), -largest_end_speed(time, -distance, -v0, SPEED, ACCELERATION)
    assume(high - low > 1e-3)
    for share in (1e-6, 0.5, 1.0 - 1e-6):
        assert is_possible(time, distance, v0, low + share * (high - low), SPEED, ACCELERATION)
    for v1 in (high + 1e-3, low - 1e-3):
        assert abs(v1) > SPEED or not is_possible(time, distance, v0, v1, SPEED, ACCELERATION)
