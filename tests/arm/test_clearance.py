"""What is called clear is clear of the table."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tt_arm.arm_urdf.geometry import BLADE_ALLOWANCE
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_arm.reach import reach
from tt_arm.safety.clearance import (
    HELD_CLEARANCE,
    OBSTACLES,
    braking_clearance,
    clearance,
    clearances,
    from_segment,
    from_table,
    path_clearance,
)
from tt_arm.swing import SwingFailure, plan
from tt_core.constants import FLOOR_Z, RACKET_RADIUS, TABLE_THICKNESS, TABLE_WIDTH
from tt_core.states import RacketState

MODEL = ArmModel.pa10()
postures = arrays(float, 7, elements=st.floats(-1.0, 1.0)).map(lambda x: x * MODEL.position_limits[:, 1])


def test_the_racket_is_as_large_as_a_blade():
    assert MODEL.bodies.rim == pytest.approx(0.08)  # m, the blade's half length, 5 mm more than its half width
    assert MODEL.bodies.rim == pytest.approx(RACKET_RADIUS + BLADE_ALLOWANCE)


def test_distances_to_the_table_top():
    assert from_table(1.0, 0.7, 0.2) == pytest.approx(0.2)
    assert from_table(-0.3, 0.7, 0.4) == pytest.approx(0.5)
    assert from_table(1.0, -0.3, -0.01) == pytest.approx(0.3)
    assert from_table(1.0, 0.7, -0.02) == 0.0
    assert from_table(1.0, 0.7, -TABLE_THICKNESS - 0.5) == pytest.approx(0.5)


def test_distances_to_a_segment():
    starts, ends = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 1.0]])
    assert from_segment(0.3, 0.4, 1.5, starts, ends, 0) == pytest.approx(0.5)
    assert from_segment(0.3, 0.4, 1.0, starts, ends, 0) == pytest.approx(0.5)
    assert from_segment(0.0, 0.3, 2.4, starts, ends, 0) == pytest.approx(0.5)
    assert from_segment(0.0, 0.3, 1.4, starts, ends, 1) == pytest.approx(0.5)


@given(postures)
def test_it_bounds_the_distance_of_the_face(q):
    face, _ = MODEL.racket(q)
    table, floor, itself = clearances(q, MODEL.bodies)
    assert table <= from_table(*face) + MODEL.bodies.rim
    assert floor <= face[2] - FLOOR_Z + MODEL.bodies.rim
    pedestal = np.array([[-0.8, 0.7625, FLOOR_Z + 0.1]]), np.array([[-0.8, 0.7625, 0.0]])  # m, within the capsule of the URDF's base
    assert itself <= from_segment(*face, *pedestal, 0) - 0.1 + MODEL.bodies.rim
    least, what = clearance(q, MODEL.bodies)
    assert least == min(table, floor, itself) == (table, floor, itself)[what]


@given(postures)
def test_a_mirror_image_is_as_clear(q):
    """About the table's middle, where the base stands: z joints turn the other way."""
    assert MODEL.base.translation[1] == pytest.approx(TABLE_WIDTH / 2)
    mirrored = q * [-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0]
    assert clearances(mirrored, MODEL.bodies) == pytest.approx(clearances(q, MODEL.bodies), abs=1e-9)


@pytest.mark.parametrize(
    ("degrees", "obstacle", "base_z"),
    [
        ((0, 80, 0, 60, -80, 70, 110), "the table", -0.06),
        ((-140, 80, 10, 70, 10, 30, -210), "the floor", -0.5),  # out of reach from the pedestal
        ((0, 0, 0, 137, 0, 130, 0), "itself", -0.06),
        ((0, 45, 0, 0, 0, 165, 0), "itself", -0.06),
    ],
)
def test_touches_are_known_by_what_is_touched(degrees, obstacle, base_z):
    model = ArmModel.pa10(base=(-0.8, 0.7625, base_z, 0.0))
    least, what = clearance(np.radians(degrees), model.bodies)
    assert least < 0.0
    assert OBSTACLES[what] == obstacle


@given(postures, arrays(float, 7, elements=st.floats(-1.0, 1.0)))
def test_braking_ends_where_constant_deceleration_does(q, share):
    speeds = share * MODEL.speed_limits
    end = q + 0.5 * speeds * np.abs(speeds) / 20.0
    assert braking_clearance(q, speeds, np.full(7, 20.0), 0.0, MODEL.bodies)[0] <= clearance(end, MODEL.bodies)[0] + 1e-9


def test_a_path_is_clear_if_all_postures_are_from_which_and_to_which_the_arm_brakes():
    """A path of one moment; the postures that `path_clearance` leaves out are checked here, too."""
    rng, braking, hold, enough, refused = np.random.default_rng(0), np.full(7, 20.0), 0.14, 0.03, 0
    for _ in range(2000):
        q, speeds = rng.uniform(*MODEL.position_limits.T), rng.uniform(-1.0, 1.0, 7) * MODEL.speed_limits
        knots, coefficients = np.zeros((7, 1)), np.zeros((7, 1, 6))
        coefficients[:, 0, :2] = np.column_stack((q, speeds))
        held = braking_clearance(q, speeds, braking, hold, MODEL.bodies)[0] + enough - HELD_CLEARANCE
        least = min(clearance(q, MODEL.bodies)[0], braking_clearance(q, speeds, braking, 0.0, MODEL.bodies)[0], held)
        found, _ = path_clearance(0.0, 0.01, braking, hold, enough, knots, coefficients, MODEL.bodies)
        assert (found < enough) == (least < enough)
        if found < enough <= clearance(q, MODEL.bodies)[0]:
            refused += 1
            assert found == pytest.approx(least, abs=1e-9)
    assert 100 < refused < 1000  # because of braking


def test_a_strike_in_the_table_is_refused():
    start = Joints(0.0, MODEL.waiting, np.zeros(7))
    for height, clear in ((0.3, True), (0.06, False)):
        racket = RacketState(2.0, np.array([0.05, 0.7, height]), np.array([0.3, 0.0, 0.3]), 0.0, 1.4)
        reason = plan(MODEL, start, reach(MODEL, racket, MODEL.waiting), 2.0).reason
        assert reason is None if clear else (reason.code, reason.values["obstacle"]) == (SwingFailure.CLEARANCE, "the table")
