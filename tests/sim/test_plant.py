"""The simulated arm obeys its command as an ideal lag within limits does."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_core.errors import OutOfRange, TtError
from tt_sim.world.plant import Plant, PlantParams, step_joint

MODEL = ArmModel.pa10()
PLANT, START = Plant(MODEL), Joints(0.0, MODEL.waiting, np.zeros(7))
TICK = 0.002  # s


@given(v=st.floats(-3, 3), u=st.floats(-3, 3), first=st.floats(0, 0.05), second=st.floats(0, 0.05))
def test_two_steps_are_one(v, u, first, second):
    whole = step_joint(0.1, v, u, first + second, 0.005, 40.0)
    parts = step_joint(*step_joint(0.1, v, u, first, 0.005, 40.0), u, second, 0.005, 40.0)
    assert parts == pytest.approx(whole, abs=1e-12)


@given(v=st.floats(-3, 3), u=st.floats(-3, 3))
def test_a_step_solves_its_differential_equation(v, u):
    q, speed, h = 0.0, v, 1e-5
    for _ in range(5000):
        q, speed = q + h * speed, speed + h * min(40.0, max(-40.0, (u - speed) / 0.005))
    # Euler's method at 1e-5 s is off by h/2 times the acceleration: 2e-4 rad/s, and 1e-5 rad over 0.05 s
    assert step_joint(0.0, v, u, 0.05, 0.005, 40.0) == pytest.approx((q, speed), abs=3e-4)


def run(state, command, ticks):
    for _ in range(ticks):
        state = PLANT.advance(state, command, TICK)
    return state


def test_a_joint_stops_at_its_end_and_comes_back():
    end = run(START, np.full(7, 10.0), 3000)
    assert end.q == pytest.approx(MODEL.position_limits[:, 1])
    assert np.all(end.qdot == 0.0)
    assert run(end, np.full(7, -0.5), 100).qdot == pytest.approx(np.full(7, -0.5))


def test_the_racket_inside_a_tick_joins_both_ends():
    command = np.array([0.5, -0.5, 1.0, -1.0, 3.0, -3.0, 2.0])
    for since in (0.0, 0.5 * TICK, TICK):
        now, soon = PLANT.racket(START, command, since), PLANT.racket(START, command, since + 1e-7)
        # the racket accelerates by less than 60 m/s^2: 6e-6 m/s in 1e-7 s
        assert (soon.position - now.position) / 1e-7 == pytest.approx(now.velocity, abs=1e-5)
    end = PLANT.racket(PLANT.advance(START, command, TICK))
    assert PLANT.racket(START, command, TICK).position == pytest.approx(end.position, abs=1e-15)


def test_noise_is_measured_not_lived():
    plant = Plant(MODEL, PlantParams(q_noise=1e-3, qdot_noise=1e-2))
    state = plant.advance(START, np.zeros(7), TICK)
    assert state.q == pytest.approx(MODEL.waiting)
    measured = plant.measured(state, np.random.default_rng(1))
    assert 0.0 < np.abs(measured.q - state.q).max() < 5e-3  # 5 sigma
    assert 0.0 < np.abs(measured.qdot - state.qdot).max() < 5e-2


def test_a_tick_without_enough_torque_is_what_the_motors_can():
    """Forward dynamics with the torque at its limit; with twice the torque that it takes nothing changes."""
    state = PLANT.advance(START, np.array([1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0]), TICK)
    command = np.array([-1.0, 1.0, -1.0, -1.0, -1.0, 1.0, -1.0])
    free = PLANT.advance(state, command, TICK)
    needed = pin.rnea(MODEL.pinocchio, MODEL.pinocchio.createData(), state.q, state.qdot, (free.qdot - state.qdot) / TICK)
    share = np.max(np.abs(needed) / MODEL.torque_limits)
    strong, weak = Plant(MODEL, PlantParams(torque_share=2.0 * share)), Plant(MODEL, PlantParams(torque_share=0.5 * share))
    assert strong.advance(state, command, TICK).qdot == pytest.approx(free.qdot, abs=0.0)
    got = weak.advance(state, command, TICK)
    used = pin.rnea(MODEL.pinocchio, MODEL.pinocchio.createData(), state.q, state.qdot, (got.qdot - state.qdot) / TICK)
    assert np.max(np.abs(used) / MODEL.torque_limits) == pytest.approx(0.5 * share, rel=1e-6)


def test_slow_drives_and_coarse_encoders():
    plant = Plant(MODEL, PlantParams(speed_share=0.5, q_step=0.01))
    state = START
    for _ in range(100):
        state = plant.advance(state, np.full(7, 100.0), TICK)
    moving = state.q < MODEL.position_limits[:, 1] - 1e-9
    assert state.qdot[moving] == pytest.approx(0.5 * MODEL.speed_limits[moving], rel=1e-3)
    steps = plant.measured(state, np.random.default_rng(0)).q / 0.01
    assert steps == pytest.approx(np.round(steps), abs=1e-9) and np.abs(steps * 0.01 - state.q).max() <= 0.005 + 1e-12


def test_nonsense_is_refused():
    with pytest.raises(TtError) as command:
        PLANT.advance(START, np.full(7, np.nan), TICK)
    with pytest.raises(OutOfRange) as time_constant:
        PlantParams(time_constant=0.0)
    assert (command.value.name, time_constant.value.name, time_constant.value.value) == ("command", "time_constant", 0.0)
