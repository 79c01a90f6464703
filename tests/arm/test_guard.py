"""Whatever comes in, what leaves is finite, within the limits and able to stop in time: for every arm that comes with the workspace."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tt_arm.arm_file import load_arm
from tt_arm.joints import NO_ACCELERATION_LIMIT, Joints
from tt_arm.model import ArmModel
from tt_arm.reach import reach
from tt_arm.safety.clearance import braking_clearance, clearance
from tt_arm.safety.command_limits import SAME_COMMAND
from tt_arm.safety.guard import Guard, GuardParams
from tt_arm.safety.stops import ArmStop
from tt_arm.swing import SwingLimits
from tt_core.errors import OutOfRange
from tt_core.robots import robots
from tt_core.states import RacketState
from tt_sim.world.plant import Plant, PlantParams

ARMS, TICK = {name: load_arm(name) for name in robots()}, 0.002
MODEL = ARMS["pa10"]
each_arm = pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)
anything = arrays(float, st.integers(0, 9), elements=st.floats(allow_nan=True, allow_infinity=True))


def at(time, q=None, qdot=None, arm=MODEL):
    return Joints(time, arm.waiting if q is None else q, np.zeros(len(arm.names)) if qdot is None else qdot)


def warmed(arm=MODEL):
    guard = Guard(arm)
    guard.check(at(0.0, arm=arm), np.zeros(len(arm.names)), 0.0)
    return guard


def steepest(arm):
    """Largest change of a command, (n,) rad/s^2 or m/s^2: twice the stated acceleration; 40 where none is stated."""
    return np.where(arm.limits.acceleration < NO_ACCELERATION_LIMIT, 2.0 * arm.limits.acceleration, 40.0)


def test_every_arm_is_there():
    assert {"pa10", "frame5"} <= set(ARMS)


@each_arm
@given(commands=st.lists(anything, max_size=5))
def test_nonsense_never_leaves(arm, commands):
    n = len(arm.names)
    guard, last = warmed(arm), np.zeros(n)
    for k, command in enumerate(commands):
        allowed, reason = guard.check(at((k + 1) * TICK, arm=arm), command, (k + 1) * TICK)
        assert np.isfinite(allowed).all()
        assert np.all(np.abs(allowed) <= arm.speed_limits)
        assert np.all(np.abs(allowed - last) <= steepest(arm) * TICK + 1e-9)
        if command.shape != (n,) or not np.isfinite(command).all():
            assert reason.code is ArmStop.BROKEN_COMMAND
        assert reason is not None or np.allclose(allowed, command, rtol=0.0, atol=SAME_COMMAND)
        last = allowed


def touching(arm):
    """The lower edge of the racket 15 mm in the table, near its end."""
    racket = RacketState.facing(0.0, np.array([0.03, 0.7625, 0.06]), np.zeros(3), np.array([1.0, 0.0, 0.0]))
    found = reach(arm, racket, arm.waiting, method="any")
    assert found.reason is None
    return found.q


def damaged(code, name):
    """The arm as it must not be."""
    arm = ARMS[name]
    beyond = np.append(arm.waiting[:-1], arm.position_limits[-1, 1] + 0.1)
    too_fast = np.zeros(len(arm.names))
    too_fast[3] = 1.5 * arm.speed_limits[3]
    states = {
        ArmStop.BEYOND_LIMIT: at(0.0, beyond, arm=arm),
        ArmStop.OVERSPEED: at(0.0, qdot=too_fast, arm=arm),
        ArmStop.CONTACT: at(0.0, touching(arm), arm=arm),
    }
    return states[code]


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("code", [ArmStop.BEYOND_LIMIT, ArmStop.OVERSPEED, ArmStop.CONTACT])
def test_damage_latches_once_it_lasts_until_reset(code, name):
    broken, arm = damaged(code, name), ARMS[name]
    n, at_rest = len(arm.names), functools.partial(at, arm=arm)
    guard = warmed(arm)
    for k in range(5):  # less than 10 ms
        guard.check_state(Joints(k * TICK, broken.q, broken.qdot))
    assert guard.latched is None
    guard.check_state(at_rest(5 * TICK))
    for k in range(6, 13):
        assert guard.latched is None
        guard.check_state(Joints(k * TICK, broken.q, broken.qdot))
    assert guard.latched.code is code
    guard.check_state(at_rest(12 * TICK))
    allowed, reason = guard.check(at_rest(12 * TICK), np.full(n, 0.01), 12 * TICK)
    assert np.all(allowed == 0.0)
    assert reason is guard.latched
    guard.reset()
    assert guard.check(at_rest(13 * TICK), np.zeros(n), 13 * TICK)[1] is None


@each_arm
def test_from_zero_as_long_as_it_knows_no_time(arm):
    n = len(arm.names)
    guard, command = Guard(arm), np.full(n, 0.5)
    allowed, reason = guard.check(at(0.0, arm=arm), command, 0.0)
    assert np.array_equal(allowed, np.zeros(n))
    assert reason is None
    assert guard.check(at(TICK, arm=arm), command, TICK)[1].code is ArmStop.ACCELERATION_CUT


@each_arm
def test_good_commands_pass_untouched(arm):
    guard = warmed(arm)
    for k in range(1, 50):
        command = np.full(len(arm.names), 0.5 * np.sin(0.05 * k))
        allowed, reason = guard.check(at(k * TICK, arm=arm), command, k * TICK)
        assert reason is None
        assert np.array_equal(allowed, command)


@each_arm
@settings(max_examples=20)
@given(shares=arrays(float, 8, elements=st.floats(-2.0, 2.0)))
def test_a_runaway_stops_before_the_end_of_every_joint(arm, shares):
    """With a plant that brakes no better than the guard believes."""
    guard, plant, state = Guard(arm), Plant(arm, PlantParams(acceleration=40.0)), at(0.0, arm=arm)
    command = shares[: len(arm.names)] * arm.speed_limits
    for _ in range(1500):
        allowed, _ = guard.check(state, command, state.time)
        state = plant.advance(state, allowed, 2 * TICK)
        assert np.all(state.q > arm.position_limits[:, 0]) and np.all(state.q < arm.position_limits[:, 1])


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


@each_arm
def test_a_plan_that_is_too_old_moves_nothing(arm):
    guard, command = warmed(arm), np.full(len(arm.names), 0.01)
    assert guard.check(at(TICK, arm=arm), command, TICK, planned=-4.9)[1] is None
    assert guard.check(at(2 * TICK, arm=arm), command, 2 * TICK, planned=-5.1)[1].code is ArmStop.OLD_PLAN


@each_arm
@given(steps=st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=50))
def test_a_stop_ends_whatever_its_times_are(arm, steps):
    """Times that stand still or go back slow a stop down; any that go on end it."""
    guard = warmed(arm)
    for k in range(1, 40):
        guard.check(at(k * TICK, arm=arm), np.full(len(arm.names), 0.5), k * TICK)
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


@each_arm
def test_a_stop_keeps_the_braking_limit(arm):
    guard, braking = warmed(arm), SwingLimits().of_joints(arm).acceleration
    for k in range(1, 100):
        command, _ = guard.check(at(k * TICK, arm=arm), np.full(len(arm.names), 0.5), k * TICK)
    for k in range(100, 120):
        slower = guard.stop(k * TICK)
        assert np.all(np.abs(slower - command) <= braking * TICK + 1e-9)
        command = slower
    assert np.all(command == 0.0)


def test_bad_values_name_themselves():
    with pytest.raises(OutOfRange) as error:
        GuardParams(margin=-1.0)
    assert (error.value.name, error.value.value) == ("margin", -1.0)


def test_a_command_whose_holding_would_end_in_the_table_does_not_leave():
    """Braking from it at once would not even come near the table."""
    guard, command = Guard(MODEL), np.array([0.86, -0.35, -0.72, -1.88, 2.52, -4.93, -5.67])  # rad/s, from the waiting posture on
    waiting = MODEL.waiting.copy()  # for read-only arrays the kernel would be compiled again
    assert braking_clearance(waiting, command, guard.braking, guard.hold, MODEL.bodies)[0] == 0.0  # within the table
    assert braking_clearance(waiting, command, guard.braking, 0.0, MODEL.bodies)[0] > 0.1  # m
    guard.begin_from(command)
    assert guard.check(at(0.0), command, 0.0)[1].code is ArmStop.NEAR
