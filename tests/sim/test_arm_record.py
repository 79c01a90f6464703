"""The record keeps the worst of all ticks and tells a broken bound once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_arm.safety.clearance import clearance
from tt_sim.world.arm_record import ArmRecord

MODEL, TICK = ArmModel.pa10(), 0.002
LOW, HIGH = MODEL.position_limits.T


def state(k, q=MODEL.waiting, qdot=(0.0,) * 7):
    return Joints(k * TICK, q, np.array(qdot))


@given(st.lists(st.tuples(*(st.floats(-0.99, 0.99) for _ in range(14))), min_size=1, max_size=10))
def test_it_keeps_the_worst(rows):
    rows = np.array(rows)
    q, qdot = rows[:, :7] * HIGH, rows[:, 7:] * MODEL.speed_limits
    record = ArmRecord(MODEL, state(0))
    for k in range(len(q)):
        record.note(state(k + 1, q[k], qdot[k]))
    speeds = np.abs(qdot / MODEL.speed_limits).max(axis=1)
    assert record.speed[0] == pytest.approx(speeds.max(), abs=1e-12)
    assert speeds.max() == 0.0 or record.speed[1] == pytest.approx(TICK * (speeds.argmax() + 1))
    steps = np.abs(np.diff(np.vstack([np.zeros(7), qdot]), axis=0)).max() / TICK
    assert record.acceleration[0] == pytest.approx(steps, rel=1e-9)
    everywhere = np.vstack([MODEL.waiting, q])
    assert record.limit_distance[0] == pytest.approx(np.minimum(everywhere - LOW, HIGH - everywhere).min())
    assert record.clearance[0] == pytest.approx(min(clearance(each, MODEL.bodies)[0] for each in everywhere))
    assert record.hits == 0


def test_an_end_stop_is_counted_once_for_each_time_it_is_met():
    record, at_end = ArmRecord(MODEL, state(0)), np.array(MODEL.waiting)
    at_end[6] = HIGH[6]
    places = [MODEL.waiting, at_end, at_end, MODEL.waiting, at_end]
    assert [record.note(state(k + 1, q)) for k, q in enumerate(places)] == [False, True, False, False, True]
    assert record.hits == 2 and record.limit_distance == (0.0, 2 * TICK) and not record.kept


def test_a_speed_above_its_limit_is_told_at_the_limit_is_not():
    record = ArmRecord(MODEL, state(0))
    assert not record.note(state(1, qdot=MODEL.speed_limits)) and record.kept
    assert record.note(state(2, qdot=-MODEL.speed_limits * (1.0 + 1e-5))) and not record.kept
    assert record.speed[0] == pytest.approx(1.0 + 1e-5)


def test_a_touch_is_told_with_what_was_touched():
    record, postures = ArmRecord(MODEL, state(0)), np.random.default_rng(0).uniform(0.99 * LOW, 0.99 * HIGH, (1000, 7))
    folded = next(q for q in postures if clearance(q, MODEL.bodies)[0] <= 0.0)
    left, _ = clearance(folded, MODEL.bodies)
    assert record.note(state(1, folded)) and record.clearance[0] == left
    values = record.to_text()
    assert float(values["clearance"]) == pytest.approx(left) and values["nearest"] == record.nearest
