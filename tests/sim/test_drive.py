"""The drives follow the newest command while it holds, and brake within their limit when there is none."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_core.errors import BadShape, NotFinite, OutOfRange, TtError
from tt_sim.world.drive import LARGEST_SPEED_COMMAND, Drive, DriveParams
from tt_sim.world.plant import Plant

MODEL, TICK, TIMEOUT = ArmModel.pa10(), 0.002, 0.1
SPEED = st.floats(-LARGEST_SPEED_COMMAND, LARGEST_SPEED_COMMAND)


def drive():
    return Drive(MODEL.limits)


def test_without_a_command_nothing_moves():
    assert np.all(drive().command(0.0, TICK, np.zeros(7), TIMEOUT) == 0.0)


@given(command=st.lists(SPEED, min_size=7, max_size=7))
def test_a_command_holds_for_the_timeout_cut_at_the_speed_limits(command):
    drives = drive()
    drives.take(command, 5.0)
    wanted = np.clip(command, -MODEL.speed_limits, MODEL.speed_limits)
    assert np.all(drives.command(5.0 + TIMEOUT, TICK, np.zeros(7), TIMEOUT) == wanted)
    assert not drives.braking
    drives.command(5.0 + 1.01 * TIMEOUT, TICK, np.zeros(7), TIMEOUT)
    assert drives.braking


@given(command=st.lists(SPEED, min_size=7, max_size=7), moving=st.integers(0, 100))
def test_braking_begins_at_the_speed_and_keeps_its_limit(command, moving):
    """Whatever was commanded last, and however far the joints had followed it."""
    drives, plant = drive(), Plant(MODEL)
    drives.take(command, 0.0)
    state = Joints(0.0, MODEL.waiting, np.zeros(7))
    for _ in range(moving):
        state = plant.advance(state, drives.command(0.0, TICK, state.qdot, TIMEOUT), TICK)
    drives.sole = False
    slowest = np.abs(state.qdot)
    ticks = int(np.ceil(slowest.max() / (drives.params.braking * TICK)))
    free = np.ones(7, bool)  # joints that met no end stop
    for _ in range(ticks + 20):  # the lag of the plant is 2.5 ticks; 20 leave exp(-8) of the ramp's 0.1 rad/s
        before, state = state, plant.advance(state, drives.command(0.0, TICK, state.qdot, TIMEOUT), TICK)
        free &= (state.q > MODEL.position_limits[:, 0]) & (state.q < MODEL.position_limits[:, 1])
        assert np.all(np.abs(state.qdot - before.qdot)[free] <= drives.params.braking * TICK * (1.0 + 1e-9) + 1e-12)
        assert np.all(np.abs(state.qdot) <= np.abs(before.qdot) + 1e-12)
    assert np.abs(state.qdot).max() < 1e-3


def test_after_braking_the_next_command_is_followed():
    drives = drive()
    drives.take(np.full(7, 0.5), 0.0)
    drives.command(1.0, TICK, np.full(7, 0.5), TIMEOUT)
    drives.take(np.full(7, 0.25), 1.0)
    assert np.all(drives.command(1.0, TICK, np.full(7, 0.4), TIMEOUT) == 0.25)


@pytest.mark.parametrize(
    ("command", "error"),
    [
        ([], BadShape),
        ([0.0] * 6, BadShape),
        ([0.0] * 8, BadShape),
        ([np.nan] * 7, NotFinite),
        ([0.0] * 6 + [-np.inf], NotFinite),
        ([0.0] * 6 + [1e17], OutOfRange),
        ([-100.1] + [0.0] * 6, OutOfRange),
    ],
)
def test_a_broken_command_is_refused_and_is_none(command, error):
    drives = drive()
    drives.take(np.full(7, 0.5), 0.0)
    with pytest.raises(error):
        drives.take(command, TIMEOUT)
    assert np.all(drives.command(TIMEOUT, TICK, np.zeros(7), TIMEOUT) == 0.5)
    drives.command(2.0 * TIMEOUT, TICK, np.zeros(7), TIMEOUT)
    assert drives.braking


def test_parameters_out_of_range_are_refused():
    for wrong in ({"command_timeout": 0.0}, {"braking": -1.0}, {"braking": np.nan}):
        with pytest.raises(TtError):
            DriveParams(**wrong)
