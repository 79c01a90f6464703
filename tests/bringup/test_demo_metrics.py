"""The figures of a ball are those that were told, and its line shows them."""

import json

import numpy as np
import pytest
from tt_bringup.demo_metrics import TABLE_HEADER, demo_metrics, table_line, true_ball
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.states import BallState, ReturnGoal

AIR = Physics.liu().air
LAUNCHED = BallState(10.0, [2.6, 0.76, 0.3], [-6.0, 0.1, 1.0], [0, -300, 0])
GOAL = ReturnGoal([2.0, 0.7], 0.6, 100, 0)


def values(**changes):
    def row(time, position, velocity=(4.0, 0, 2.0), spin=(0, 104, 1)):
        return json.dumps([time, *position, *velocity, *spin])

    all_ = {
        "shot": "top 4",
        "result": "returned",
        "launched": json.dumps([LAUNCHED.time, *LAUNCHED.vector]),
        "hit": row(10.5, (-0.2, 0.7, 0.3)),
        "after_hit": row(10.5, (-0.2, 0.7, 0.3)),
        "offset": "0.004",
        "landing": row(11.102, (2.03, 0.74, 0.02)),
    }
    return {**all_, **changes}


MEASURED = BallState.from_vector(10.02, fly(LAUNCHED.vector, 0.02, AIR.coefficients) + np.array([0, 0, 0, 0, 0, 0, 3.0, 4.0, 0]))

TRUE = true_ball(values(), MEASURED.time, AIR)


def test_a_returned_ball():
    s = demo_metrics(values(), GOAL, MEASURED, 40.0, None, TRUE)
    assert (s.seen, s.hit, s.landed, s.reason) == (True, True, True, None)
    assert s.spin_error_rpm == pytest.approx(5.0 * 60 / (2 * np.pi))
    assert s.speed_true == pytest.approx(s.speed_measured)
    assert s.time_error_s == pytest.approx(0.002)
    assert (s.hit_error_m, s.landing_reached, s.return_spin_reached) == (0.004, [2.03, 0.74], [104.0, 1.0])
    assert table_line(s).split()[2:4] == ["2865", "2827"] and " 50 " in table_line(s) and " 40 " in table_line(s)
    json.dumps(s.as_dict())


MISSED = values(result="missed", hit="null", after_hit="null", offset="null", landing="null")


@pytest.mark.parametrize(
    ("values", "measured", "refusal", "reason"),
    [
        (MISSED, None, None, "not seen"),
        (MISSED, None, "estimate: refused: two balls", "estimate: refused: two balls"),
        (MISSED, MEASURED, "arm: no swing", "arm: no swing"),
        (MISSED, MEASURED, None, "missed"),
        (MISSED, BallState.from_vector(3.0, MEASURED.vector), None, "not seen"),
    ],
)
def test_a_missed_ball_has_its_reason(values, measured, refusal, reason):
    s = demo_metrics(values, GOAL, measured, None, refusal, true_ball(values, MEASURED.time, AIR))
    assert (s.hit, s.landed, s.reason) == (False, False, reason)
    assert table_line(s).rstrip().endswith(reason)


def test_columns_stand_under_their_heads():
    widths = {len(row) for row in TABLE_HEADER.splitlines()} | {len(table_line(demo_metrics(values(), GOAL, MEASURED, 40.0, None, TRUE)))}
    assert len(widths) == 1 and widths.pop() <= 80  # columns of a terminal
