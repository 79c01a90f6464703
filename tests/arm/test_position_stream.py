"""Positions streamed to an arm that takes no velocities lead where the velocities lead, and stop if nothing newer comes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tt_arm.position_stream import LEASH, LONGEST_AHEAD, PositionStream
from tt_core.errors import OutOfRange

BRAKING, TICK, AHEAD = np.array([20.0, 40.0]), 0.002, 0.02
SPEEDS = arrays(float, 2, elements=st.floats(-5.0, 5.0))


@given(SPEEDS, SPEEDS)
def test_the_points_hold_the_command_then_brake_within_the_limit(q, command):
    times, positions, velocities = PositionStream(BRAKING, AHEAD).points(0.0, q, command)
    assert times[0] == AHEAD and times[1] > AHEAD
    assert positions[0] == pytest.approx(q + AHEAD * command) and np.array_equal(velocities, [command, np.zeros(2)])
    assert np.abs(positions[1] - positions[0]) == pytest.approx(command**2 / (2.0 * BRAKING))
    assert np.all((positions[1] - positions[0]) * command >= 0.0)


@pytest.mark.parametrize("lag", [0.0, 0.01])
def test_an_arm_with_a_lag_moves_as_fast_as_commanded(lag):
    """It tracks the position that is due now with a first-order lag; after 10 time constants it is behind, and no slower."""
    stream, q, u = PositionStream(BRAKING, AHEAD), np.zeros(2), np.array([1.0, -2.0])
    before = q
    for k in range(100):
        times, positions, _ = stream.points(k * TICK, q, u)
        due = positions[0] - (times[0] - TICK) * u
        before, q = q, due if lag == 0.0 else q + (due - q) * (1.0 - np.exp(-TICK / lag))
    assert (q - before) / TICK == pytest.approx(u, rel=1e-3)
    assert np.all(np.abs(q - 99 * TICK * u) <= (lag + TICK) * np.abs(u) * 1.01)


@given(st.lists(SPEEDS, min_size=1, max_size=50))
def test_the_positions_stay_near_the_measured_ones(commands):
    stream = PositionStream(BRAKING, AHEAD)
    for k, command in enumerate(commands):  # the arm does not move
        _, positions, _ = stream.points(0.04 * k, np.zeros(2), command)
        assert np.all(np.abs(positions[0] - AHEAD * command) <= LEASH + 1e-12)


def test_after_a_gap_it_starts_from_where_the_arm_is():
    stream = PositionStream(BRAKING, AHEAD)
    stream.points(0.0, np.zeros(2), np.ones(2))
    _, positions, _ = stream.points(1.0, np.full(2, 0.05), np.zeros(2))
    assert positions[0] == pytest.approx([0.05, 0.05])


@pytest.mark.parametrize("ahead", [0.0, 2.0 * LONGEST_AHEAD])
def test_a_time_out_of_range_is_refused(ahead):
    with pytest.raises(OutOfRange):
        PositionStream(BRAKING, ahead)
