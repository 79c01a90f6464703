"""An arm that cannot play says so at the start, with numbers."""

import numpy as np
import pytest
from tt_arm.joints import Joints
from tt_arm.model import ArmModel, UrdfError, UrdfFailure
from tt_arm.reach import ReachFailure, reach
from tt_arm.safety.guard import GuardParams
from tt_arm.startup_check import StartupError, StartupFailure, check_feasible, check_guard, typical_strokes
from tt_arm.swing import SwingLimits, plan
from tt_core.errors import OutOfRange
from tt_core.robots import read_arm

MODEL = ArmModel.pa10()


def test_this_arm_can_play():
    check_feasible(MODEL, SwingLimits())
    start = Joints(0.0, MODEL.waiting, np.zeros(7))
    assert all(plan(MODEL, start, reach(MODEL, racket, MODEL.waiting), racket.time).reason is None for racket in typical_strokes())


@pytest.mark.parametrize(
    ("changes", "code", "values"),
    [
        ({"base": (-2.0, 0.7625, -0.06, 0.0)}, StartupFailure.TOO_FEW_STROKES, {"x": -2.0, "made": 0, "tried": 12, "needed": 6.0}),
        ({"mount": (0.15, 0.0)}, StartupFailure.TOO_FEW_STROKES, {"tried": 12}),  # a racket square to the flange's axis
        ({"waiting": np.radians((0, 80, 0, 60, -80, 70, 110))}, StartupFailure.WAITING_TOO_NEAR, {"obstacle": "the table", "bound": 0.01}),
    ],
)
def test_an_arm_that_cannot_play_is_told(changes, code, values):
    with pytest.raises(StartupError) as error:
        check_feasible(ArmModel.pa10(**changes), SwingLimits())
    assert error.value.failure.code is code
    assert values.items() <= error.value.failure.values.items()


def test_an_arm_that_is_too_far_tells_how_far():
    with pytest.raises(StartupError) as error:
        check_feasible(ArmModel.pa10(base=(-2.0, 0.7625, -0.06, 0.0)), SwingLimits())
    values = error.value.failure.values
    assert values["reason"].code is ReachFailure.OUT_OF_REACH
    assert values["far"] == pytest.approx(2.03, abs=0.01)  # m from the base to the furthest of the typical strokes
    assert values["far"] > values["length"]


@pytest.mark.parametrize(
    ("old", "new", "code", "values"),
    [
        ("<robot", "<nonsense", UrdfFailure.NOT_READABLE, {}),
        ('type="revolute"', 'type="fixed"', UrdfFailure.WRONG_COUNT, {"count": 0}),
        ('velocity="2"', 'velocity="0"', UrdfFailure.WRONG_LIMITS, {"joint": "s3", "speed": 0.0, "unit": "rad"}),
        ('<cylinder radius="0.055" length="0.36"/>', "<cone/>", UrdfFailure.NO_SHAPE, {"link": "link_e2"}),
    ],
)
def test_a_bad_urdf_is_told(tmp_path, old, new, code, values):
    bad = tmp_path / "bad.urdf"
    bad.write_text(read_arm("pa10")[1].read_text().replace(old, new))
    with pytest.raises(UrdfError) as error:
        ArmModel.pa10(urdf=str(bad))
    assert error.value.failure.code is code
    assert values.items() <= error.value.failure.values.items()


def test_a_waiting_posture_beyond_a_limit_is_told():
    with pytest.raises(OutOfRange) as error:
        ArmModel.pa10(waiting=(4.0, 0, 0, 0, 0, 0, 0))
    assert "s1" in error.value.name
    assert error.value.value == 4.0


@pytest.mark.parametrize(
    ("guard", "limits", "code", "values"),
    [
        ({"acceleration": 10.0}, {}, StartupFailure.GUARD_LIMIT, {"joint": "s1", "allowed": 10.0, "used": 20.0, "unit": "rad/s^2"}),
        ({"margin": 0.03}, {}, StartupFailure.GUARD_LIMIT, {"joint": "s1", "unit": "rad"}),
        ({}, {"acceleration": 50.0}, StartupFailure.GUARD_LIMIT, {"allowed": 40.0, "used": 50.0}),
        ({"clearance": 0.02}, {}, StartupFailure.GUARD_CLEARANCE, {"kept": 0.02, "used": 0.01}),
    ],
)
def test_a_guard_that_would_cut_what_swings_use_is_told(guard, limits, code, values):
    with pytest.raises(StartupError) as error:
        check_guard(MODEL, SwingLimits(**limits), GuardParams(**guard))
    assert error.value.failure.code is code
    assert values.items() <= error.value.failure.values.items()


def test_the_guard_lets_swings_pass():
    check_guard(MODEL, SwingLimits(), GuardParams())
    check_guard(MODEL, SwingLimits(), GuardParams(acceleration=20.0, margin=0.02, clearance=0.01))
