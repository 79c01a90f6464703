"""Offsets of clocks: never wrong by more than they say, whatever the delays."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tt_core.clock_offsets import CLOCK_ROUNDING, MAX_NAME, MAX_SAMPLES, MAX_SOURCES, OFFSET_WINDOW, ClockOffsets

NOW = 1_764_000_000.0  # s, a time of day
delays = st.tuples(st.floats(0.0, 0.5), st.floats(0.0, 0.5))  # s, there and back


def exchange(offsets, source, time, offset, there, back):
    return offsets.add(source, time, time + there + offset, time + there + back)


@given(st.floats(-1000.0, 1000.0), st.lists(delays, min_size=1, max_size=30))
def test_the_true_offset_lies_within_the_uncertainty(offset, ways):
    offsets, time = ClockOffsets(), NOW
    for there, back in ways:
        assert exchange(offsets, "camera", time, offset, there, back)
        time += 0.25
    known = offsets.offset("camera", time)
    assert abs(known.offset - offset) <= known.uncertainty + CLOCK_ROUNDING
    assert known.uncertainty == pytest.approx(min(sum(w) for w in ways) / 2.0, abs=CLOCK_ROUNDING)  # of the shortest exchange
    assert known.least <= abs(offset) + CLOCK_ROUNDING


@given(st.lists(delays, min_size=1, max_size=30))
def test_a_right_clock_is_never_told_to_be_off(ways):
    offsets = ClockOffsets()
    for number, (there, back) in enumerate(ways):
        exchange(offsets, "camera", NOW + 0.25 * number, 0.0, there, back)
    assert offsets.worst(NOW + 0.25 * len(ways)).least <= CLOCK_ROUNDING


def test_the_worst_is_the_one_beyond_its_uncertainty():
    offsets = ClockOffsets()
    exchange(offsets, "near", NOW, 0.010, 1e-4, 1e-4)
    exchange(offsets, "far", NOW, 0.030, 0.05, 0.05)  # may be right, for all we know
    worst = offsets.worst(NOW + 0.1)
    assert worst.source == "near" and worst.least == pytest.approx(0.0099, abs=CLOCK_ROUNDING)


def test_a_clock_that_is_set_is_seen_at_once():
    offsets = ClockOffsets()
    exchange(offsets, "camera", NOW, 0.0, 1e-4, 1e-4)
    exchange(offsets, "camera", NOW + 0.25, 0.050, 0.001, 0.001)  # a longer way, but it cannot be true with the other
    assert offsets.offset("camera", NOW + 0.3).offset == pytest.approx(0.050, abs=CLOCK_ROUNDING)


def test_what_is_old_does_not_count():
    offsets = ClockOffsets()
    exchange(offsets, "camera", NOW, 0.5, 0.0, 0.0)
    assert offsets.offset("camera", NOW + OFFSET_WINDOW - 0.1) is not None
    for later in (NOW + OFFSET_WINDOW + 0.1, NOW - OFFSET_WINDOW - 0.1):  # the second: this computer's clock was set back
        assert offsets.offset("camera", later) is None and offsets.worst(later) is None


def test_sources_and_samples_are_bounded():
    offsets = ClockOffsets()
    assert all(exchange(offsets, f"node {i}", NOW, 0.0, 0.0, 0.0) for i in range(MAX_SOURCES))
    assert not exchange(offsets, "one more", NOW, 0.0, 0.0, 0.0)
    assert exchange(offsets, "one more", NOW + OFFSET_WINDOW + 1.0, 0.0, 0.0, 0.0)  # the others have gone
    for i in range(3 * MAX_SAMPLES):
        exchange(offsets, "one more", NOW + OFFSET_WINDOW + 1.0 + 1e-3 * i, 0.0, 0.0, 0.0)
    assert len(offsets._samples["one more"]) == MAX_SAMPLES


def test_nonsense_is_refused():
    offsets = ClockOffsets()
    assert not offsets.add("camera", NOW, NOW, NOW - 1.0)
    assert not offsets.add("x" * (MAX_NAME + 1), NOW, NOW, NOW)
    assert not offsets.add("camera", float("nan"), NOW, NOW)
    assert offsets.worst(NOW) is None
    assert offsets.add("camera", NOW, -(2.0**31), NOW) and offsets.worst(NOW).least > 1e9  # a stamp may be anything
