"""Steps come in order, on time, none lost."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tt_tools.play import Step, pace, with_clock

MS = 1_000_000  # ns
times = st.lists(st.integers(0, 200 * MS), max_size=30).map(sorted)


@given(times, st.integers(1, 50))
def test_the_clock_never_runs_behind_a_message(times, period):
    messages = [Step(time, ("/a", "std_msgs/msg/Empty"), b"x") for time in times]
    steps = list(with_clock(messages, 0, 200 * MS, period * MS))
    assert [step for step in steps if step.topic] == messages
    ticks = [step.time for step in steps if not step.topic]
    assert ticks == list(range(0, 200 * MS + 1, period * MS))
    assert [step.time for step in steps] == sorted(step.time for step in steps)


class Watch:
    """A clock that only moves by sleeping and by what is done between the steps."""

    def __init__(self):
        self.time = 100.0

    def now(self):
        return self.time

    def sleep(self, seconds):
        self.time += seconds


@pytest.mark.parametrize("rate", [0.5, 1.0, 3.0])
def test_steps_are_due_by_the_rate_and_delays_do_not_add_up(rate):
    watch, start = Watch(), 5 * MS
    busy = 0.004 / rate  # s for each step: less than between two steps, but more than once
    done = []
    for step in pace([Step(start + i * 10 * MS) for i in range(20)], start, rate, watch.now, watch.sleep):
        done.append(watch.time - 100.0)
        watch.time += 5 * busy if step.time == start + 30 * MS else busy
    due = [i * 0.01 / rate for i in range(20)]
    assert done[:4] == pytest.approx(due[:4])
    assert done[4] == pytest.approx(due[3] + 5 * busy)  # late, not dropped
    assert done[7:] == pytest.approx(due[7:])
