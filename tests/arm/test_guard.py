"""Whatever comes in, what leaves is finite, within the limits and able to stop in time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_arm.safety.clearance import braking_clearance, clearance
from tt_arm.safety.command_limits import SAME
from tt_arm.safety.guard import Guard, GuardParams
from tt_arm.safety.stops import ArmStop
from tt_arm.swing import SwingLimits
from tt_core.errors import OutOfRange
from tt_sim.world.plant import Plant, PlantParams

MODEL, TICK = ArmModel.pa10(), 0.002
anything = arrays(float, st.integers(0, 9), elements=st.floats(allow_nan=True, allow_infinity=True))


def at(time, q=MODEL.waiting, qdot=None):
    return Joints(time, q, np.zeros(7) if qdot is None else qdot)


def warmed():
    guard = Guard(MODEL)
    guard.check(at(0.0), np.zeros(7), 0.0)
    return guard


@given(st.lists(anything, max_size=5))
def test_nonsense_never_leaves(commands):
    guard, last = warmed(), np.zeros(7)
    for k, command in enumerate(commands):
        allowed, reason = guard.check(at((k + 1) * TICK), command, (k + 1) * TICK)
        assert np.isfinite(allowed).all()
        assert np.all(np.abs(allowed) <= MODEL.speed_limits)
        assert np.abs(allowed - last).max() <= 40.0 * TICK + 1e-9
        if command.shape != (7,) or not np.isfinite(command).all():
            assert reason.code is ArmStop.BROKEN_COMMAND
        assert reason is not None or np.allclose(allowed, command, rtol=0.0, atol=SAME)
        last = allowed


BEYOND = np.append(MODEL.waiting[:6], MODEL.position_limits[6, 1] + 0.1)
TOUCHING = np.radians((-54, 92, 68, 67, -12, 46, 167))  # the racket 12 mm in the table
DAMAGE = {
    ArmStop.BEYOND_LIMIT: at(0.0, BEYOND),
    ArmStop.OVERSPEED: at(0.0, MODEL.waiting, np.array([0, 0, 0, 3.0, 0, 0, 0])),
    ArmStop.CONTACT: at(0.0, TOUCHING),
}


@pytest.mark.parametrize("code", DAMAGE)
def test_damage_latches_once_it_lasts_until_reset(code):
    broken = DAMAGE[code]
    guard = warmed()
    for k in range(5):  # less than 10 ms
        guard.look(Joints(k * TICK, broken.q, broken.qdot))
    assert guard.latched is None
    guard.look(at(5 * TICK))
    for k in range(6, 13):
        assert guard.latched is None
        guard.look(Joints(k * TICK, broken.q, broken.qdot))
    assert guard.latched.code is code
    guard.look(at(12 * TICK))
    allowed, reason = guard.check(at(12 * TICK), np.full(7, 0.01), 12 * TICK)
    assert np.all(allowed == 0.0)
    assert reason is guard.latched
    guard.reset()
    assert guard.check(at(13 * TICK), np.zeros(7), 13 * TICK)[1] is None


def test_from_zero_as_long_as_it_knows_no_time():
    guard, command = Guard(MODEL), np.full(7, 0.5)
    allowed, reason = guard.check(at(0.0), command, 0.0)
    assert np.array_equal(allowed, np.zeros(7))
    assert reason is None
    assert guard.check(at(TICK), command, TICK)[1].code is ArmStop.ACCELERATION_CUT


def test_good_commands_pass_untouched():
    guard = warmed()
    for k in range(1, 50):
        command = np.full(7, 0.5 * np.sin(0.05 * k))
        allowed, reason = guard.check(at(k * TICK), command, k * TICK)
        assert reason is None
        assert np.array_equal(allowed, command)


@settings(max_examples=20)
@given(arrays(float, 7, elements=st.floats(-10.0, 10.0)))
def test_a_runaway_stops_before_the_end_of_every_joint(command):
    """With a plant that brakes no better than the guard believes."""
    guard, plant, state = Guard(MODEL), Plant(MODEL, PlantParams(acceleration=40.0)), Joints(0.0, MODEL.waiting, np.zeros(7))
    for _ in range(1500):
        allowed, _ = guard.check(state, command, state.time)
        state = plant.advance(state, allowed, 2 * TICK)
        assert np.all(state.q > MODEL.position_limits[:, 0]) and np.all(state.q < MODEL.position_limits[:, 1])


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
    state, guard, plant, stopped = Joints(0.0, np.radians(degrees), np.zeros(7)), Guard(model), Plant(model), None
    home = (MODEL.waiting - state.q) / np.max(np.abs(MODEL.waiting - state.q) / MODEL.speed_limits)  # straight, at full speed
    while stopped is None:
        assert state.time < 5.0
        allowed, reason = guard.check(state, home, state.time)
        stopped = reason if reason is not None and reason.code is ArmStop.NEAR else None
        state = plant.advance(state, allowed, TICK)
    assert stopped.values["obstacle"] == obstacle
    since = state.time
    while np.abs(state.qdot).max() > 1e-3:
        state = plant.advance(state, guard.stop(state.time), TICK)
    assert clearance(state.q, model.bodies)[0] > 0.0
    assert state.time - since < 0.40  # s; 2 pi rad/s at 20 rad/s^2 take 0.31
    back = 0.3 * (np.radians(degrees) - state.q) / np.abs(np.radians(degrees) - state.q).max()
    for k in range(20):  # and it may go back
        allowed, reason = guard.check(Joints(state.time + k * TICK, state.q, np.zeros(7)), back, state.time + k * TICK)
    assert reason is None or reason.code is ArmStop.ACCELERATION_CUT
    assert np.any(allowed != 0.0)


@pytest.mark.parametrize(
    ("wanted", "params", "limits", "code"),
    [
        (10.0, {}, {}, ArmStop.SPEED_CUT),
        (0.9, {"margin": 0.5}, {"acceleration": 0.1}, ArmStop.POSITION_CUT),
        (0.9, {"acceleration": 1.0}, {}, ArmStop.ACCELERATION_CUT),
    ],
)
def test_what_is_too_much_is_cut_and_named(wanted, params, limits, code):
    guard, plant, state = Guard(MODEL, GuardParams(**params), SwingLimits(**limits)), Plant(MODEL), at(0.0)
    seen = set()
    for _ in range(50):
        allowed, reason = guard.check(state, np.full(7, wanted), state.time)
        state = plant.advance(state, allowed, TICK)
        assert np.any(np.abs(allowed) < wanted)
        seen |= {reason.code} if reason else set()
    assert code in seen


def test_a_plan_that_is_too_old_moves_nothing():
    guard, command = warmed(), np.full(7, 0.01)
    assert guard.check(at(TICK), command, TICK, planned=-4.9)[1] is None
    assert guard.check(at(2 * TICK), command, 2 * TICK, planned=-5.1)[1].code is ArmStop.OLD_PLAN


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=50))
def test_a_stop_ends_whatever_its_times_are(steps):
    """Times that stand still or go back slow a stop down; any that go on end it."""
    guard = warmed()
    for k in range(1, 40):
        guard.check(at(k * TICK), np.full(7, 0.5), k * TICK)
    before, now = guard.last, 39 * TICK
    for step in steps:
        now += step
        command = guard.stop(now)
        assert np.all(np.abs(command) <= np.abs(before))
        before = command
    for _ in range(2):
        now += 1.0
        command = guard.stop(max(now, 1000.0 + now))
    assert np.all(command == 0.0)


def test_a_stop_keeps_the_braking_limit():
    guard = warmed()
    for k in range(1, 100):
        command, _ = guard.check(at(k * TICK), np.full(7, 0.5), k * TICK)
    for k in range(100, 120):
        slower = guard.stop(k * TICK)
        assert np.abs(slower - command).max() <= 20.0 * TICK + 1e-9
        command = slower
    assert np.all(command == 0.0)


def test_bad_values_name_themselves():
    with pytest.raises(OutOfRange) as error:
        GuardParams(margin=-1.0)
    assert (error.value.name, error.value.value) == ("margin", -1.0)


def test_a_command_whose_holding_would_end_in_the_table_does_not_leave():
    """Braking from it at once would not even come near the table."""
    guard, command = Guard(MODEL), np.array([0.86, -0.35, -0.72, -1.88, 2.52, -4.93, -5.67])  # rad/s, from the waiting posture on
    assert braking_clearance(MODEL.waiting, command, guard.braking, guard.hold, MODEL.bodies)[0] == 0.0  # within the table
    assert braking_clearance(MODEL.waiting, command, guard.braking, 0.0, MODEL.bodies)[0] > 0.1  # m
    guard.begin_from(command)
    assert guard.check(at(0.0), command, 0.0)[1].code is ArmStop.NEAR
