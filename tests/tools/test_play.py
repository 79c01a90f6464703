"""Steps come in order, on time, none lost."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tt_tools.play import Playback, PlaybackItem, with_clock

MS = 1_000_000  # ns
times = st.lists(st.integers(0, 200 * MS), max_size=30).map(sorted)


@given(times, st.integers(1, 50))
def test_the_clock_never_runs_behind_a_message(times, period):
    messages = [PlaybackItem(time, ("/a", "std_msgs/msg/Empty"), b"x") for time in times]
    steps = list(with_clock(messages, 0, 200 * MS, period * MS))
    assert [step for step in steps if step.topic] == messages
    ticks = [step.time for step in steps if not step.topic]
    assert ticks == list(range(0, 200 * MS + 1, period * MS))
    assert [step.time for step in steps] == sorted(step.time for step in steps)


def at(milliseconds, topic=("/a", "std_msgs/msg/Empty")):
    return PlaybackItem(milliseconds * MS, topic)


@pytest.mark.parametrize("rate", [0.5, 1.0, 3.0])
def test_steps_are_due_by_the_rate_and_delays_do_not_add_up(rate):
    playback = Playback(5 * MS, rate, 100.0)
    assert playback.wait(at(5), 100.0) == 0.0
    assert playback.wait(at(105), 100.0) == pytest.approx(0.1 / rate)
    assert playback.wait(at(105), 100.0 + 5.0) == 0.0  # late: played at once
    assert playback.wait(at(5105), 100.0 + 5.0) == pytest.approx(5.1 / rate - 5.0) or rate == 3.0  # the next one is where it was
    assert playback.position(101.0) == 5 * MS + rate * 1000 * MS


def test_time_stands_still_while_paused():
    playback = Playback(0, 2.0, 10.0)
    playback.pause(True, 11.0)
    assert playback.paused and playback.position(50.0) == 2000 * MS and playback.wait(at(1), 50.0) == math.inf
    playback.pause(False, 60.0)
    assert playback.wait(at(3000), 60.0) == pytest.approx(0.5)


def test_single_messages_are_played_while_paused():
    playback = Playback(0, 1.0, 10.0, paused=True)
    assert playback.play_next()
    assert playback.wait(at(10, None), 10.0) == 0.0
    playback.done(at(10, None))  # a tick of the clock is no message
    assert playback.wait(at(20), 10.0) == 0.0
    playback.done(at(20))
    assert playback.wait(at(30), 10.0) == math.inf and playback.position(99.0) == 20 * MS
    playback.pause(False, 100.0)
    assert not playback.play_next() and playback.wait(at(30), 100.0) == pytest.approx(0.01)


def test_it_goes_on_at_another_place_and_rate():
    playback = Playback(0, 1.0, 0.0)
    playback.seek(5000 * MS, 1.0)
    assert playback.moves == 1 and playback.position(2.0) == 6000 * MS
    playback.set_rate(10.0, 2.0)
    assert playback.position(2.0) == 6000 * MS and playback.position(3.0) == 16000 * MS
