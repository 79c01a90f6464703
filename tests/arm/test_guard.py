"""Whatever comes in, what leaves is finite, within the limits and able to stop in time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tt_arm.clearance import clearance
from tt_arm.guard import Guard, GuardParams
from tt_arm.model import ArmModel
from tt_arm.swing import Joints
from tt_core.errors import OutOfRange
from tt_sim.plant import Plant, PlantParams

MODEL, TICK = ArmModel.pa10(), 0.002
anything = arrays(float, st.integers(0, 9), elements=st.floats(allow_nan=True, allow_infinity=True))


def warmed():
    guard = Guard(MODEL)
    guard.check(0.0, np.zeros(7), MODEL.waiting)
    return guard


@given(st.lists(anything, max_size=5))
def test_nonsense_never_leaves(commands):
    guard, last = warmed(), np.zeros(7)
    for k, command in enumerate(commands):
        allowed, reason = guard.check((k + 1) * TICK, command, MODEL.waiting)
        assert np.isfinite(allowed).all()
        assert np.all(np.abs(allowed) <= MODEL.speed_limits)
        assert np.abs(allowed - last).max() <= 40.0 * TICK + 1e-9
        if command.shape != (7,) or not np.isfinite(command).all():
            assert guard.latched is not None
        assert reason is not None or np.array_equal(allowed, command)
        last = allowed


def test_what_is_broken_latches_until_reset():
    for command, q, words in (
        (np.full(7, np.nan), MODEL.waiting, "not finite"),
        (np.zeros(6), MODEL.waiting, "7 joints expected"),
        (np.zeros(7), np.append(MODEL.waiting[:6], 5.0), "joint w2 is 0.549 rad beyond its limit"),
    ):
        guard = warmed()
        assert words in guard.check(TICK, command, q)[1]
        allowed, reason = guard.check(2 * TICK, np.full(7, 0.01), MODEL.waiting)
        assert np.all(allowed == 0.0)
        assert words in reason
        guard.reset()
        assert guard.check(3 * TICK, np.zeros(7), MODEL.waiting)[1] is None


def test_from_zero_as_long_as_it_knows_no_time():
    guard, command = Guard(MODEL), np.full(7, 0.5)
    for _ in range(2):
        allowed, reason = guard.check(0.0, command, MODEL.waiting)
        assert np.array_equal(allowed, np.zeros(7))
        assert reason is None
        assert "acceleration limit" in guard.check(TICK, command, MODEL.waiting)[1]
        guard.reset()


def test_good_commands_pass_untouched():
    guard = warmed()
    for k in range(1, 50):
        command = np.full(7, 0.5 * np.sin(0.05 * k))
        allowed, reason = guard.check(k * TICK, command, MODEL.waiting)
        assert reason is None
        assert np.array_equal(allowed, command)


@settings(max_examples=20)
@given(arrays(float, 7, elements=st.floats(-10.0, 10.0)))
def test_a_runaway_stops_before_the_end_of_every_joint(command):
    """With a plant that brakes no better than the guard believes."""
    guard, plant, state = Guard(MODEL), Plant(MODEL, PlantParams(acceleration=40.0)), Joints(0.0, MODEL.waiting, np.zeros(7))
    for _ in range(1500):
        allowed, _ = guard.check(state.time, command, state.q)
        state = plant.advance(state, allowed, 2 * TICK)
        assert np.all(state.q > MODEL.position_limits[:, 0]) and np.all(state.q < MODEL.position_limits[:, 1])


def run(state, wanted, seconds, model=MODEL, **given):
    """Commands of wanted(q) through guard and plant until it stops: the joints, the guard, and the time (s) from latch to rest."""
    guard, plant, latched = Guard(model, GuardParams(**given)), Plant(model), None
    while state.time < seconds:
        allowed, _ = guard.check(state.time, wanted(state.q), state.q, state.qdot)
        latched = state.time if latched is None and guard.latched else latched
        state = plant.advance(state, allowed, TICK)
        if latched is not None and np.abs(state.qdot).max() < 1e-3:
            return state, guard, state.time - latched
    return state, guard, None


@pytest.mark.parametrize(
    ("degrees", "obstacle", "base_z"),
    [  # ways home that lead through something
        ((100, 70, -90, 10, 40, -80, 90), "the table", -0.06),
        ((20, 70, -40, 100, -20, -60, 50), "the floor", -0.5),
        ((-20, 80, -100, 130, 10, 90, -170), "itself", -0.06),
    ],
)
def test_it_stops_before_it_touches(degrees, obstacle, base_z):
    model = ArmModel.pa10(base=(-0.8, 0.7625, base_z, 0.0))
    start = Joints(0.0, np.radians(degrees), np.zeros(7))
    home = (MODEL.waiting - start.q) / np.max(np.abs(MODEL.waiting - start.q) / MODEL.speed_limits)  # straight, at full speed
    end, guard, took = run(start, lambda q: home, 5.0, model)
    assert obstacle in guard.latched
    assert clearance(end.q, model.chain)[0] > 0.0
    assert took < 0.20  # s; 2 pi rad/s at 40 rad/s^2 take 0.16

    guard.reset()  # and it may go back
    for k in range(20):
        allowed, reason = guard.check(end.time + k * TICK, -0.3 * home, end.q)
    assert reason is None or "acceleration" in reason
    assert np.any(allowed != 0.0)


def test_what_is_cut_for_long_latches():
    for wanted, changes, words in (
        (np.full(7, 10.0), {}, "speed limit"),
        (np.full(7, 0.9), {"braking": 0.1, "margin": 0.5}, "position limit"),
        (np.full(7, 0.9), {"acceleration": 1.0}, "acceleration limit"),
    ):
        end, guard, took = run(Joints(0.0, MODEL.waiting, np.zeros(7)), lambda q, wanted=wanted: wanted, 3.0, **changes)
        assert guard.latched.startswith(words)
        assert took < 0.3
        assert np.all(np.abs(end.qdot) < 1e-3)


def test_what_is_measured_too_fast_or_planned_too_long_ago_latches():
    guard, command = warmed(), np.full(7, 0.01)
    assert "joint e1 moves at 1.50 times" in guard.check(TICK, command, MODEL.waiting, np.array([0, 0, 0, 3.0, 0, 0, 0]))[1]
    guard = warmed()
    assert guard.check(TICK, command, MODEL.waiting, planned=-4.9)[1] is None
    assert guard.check(2 * TICK, command, MODEL.waiting, planned=-5.1)[1] == "the plan is 5.10 s old"


def test_silence_is_noticed_and_a_stop_is_gentle():
    guard = Guard(MODEL)
    command = np.zeros(7)
    for k in range(100):
        command, _ = guard.check(k * TICK, np.full(7, 0.5), MODEL.waiting)
    assert not guard.stale(1.0, 1.04)
    assert guard.stale(1.0, 1.06)
    for k in range(100, 120):
        slower = guard.stop(k * TICK)
        assert np.abs(slower - command).max() <= 40.0 * TICK + 1e-9
        command = slower
    assert np.all(command == 0.0)


def test_bad_values_name_themselves():
    with pytest.raises(OutOfRange, match="braking = 0"):
        GuardParams(braking=0.0)
