"""An arm that cannot play says so at the start, with numbers."""

import numpy as np
import pytest
from tt_arm.joints import Joints
from tt_arm.model import URDF, ArmModel
from tt_arm.reach import ReachFailure, reach
from tt_arm.startup_check import StartupError, StartupFailure, check_feasible, strokes
from tt_arm.swing import SwingLimits, plan
from tt_core.errors import TtError

MODEL = ArmModel.pa10()


def test_this_arm_can_play():
    check_feasible(MODEL, SwingLimits())
    start = Joints(0.0, MODEL.waiting, np.zeros(7))
    assert all(plan(MODEL, start, reach(MODEL, racket, MODEL.waiting), racket.time).reason is None for racket in strokes())


@pytest.mark.parametrize(
    ("changes", "code", "values"),
    [
        ({"base": (-2.0, 0.7625, -0.06, 0.0)}, StartupFailure.TOO_FEW_STROKES, {"x": -2.0, "made": 0, "tried": 12, "needed": 6.0}),
        ({"mount": (0.15, 0.0)}, StartupFailure.TOO_FEW_STROKES, {"tried": 12}),  # a racket square to the flange's axis
        ({"waiting": np.radians((0, 80, 0, 60, -80, 70, 110))}, StartupFailure.WAITING_TOO_NEAR, {"obstacle": "the table", "bound": 0.01}),
    ],
)
def test_an_arm_that_cannot_play_is_told(changes, code, values):
    with pytest.raises(StartupError) as told:
        check_feasible(ArmModel.pa10(**changes), SwingLimits())
    assert told.value.failure.code is code
    assert values.items() <= told.value.failure.values.items()


def test_an_arm_that_is_too_far_tells_how_far():
    with pytest.raises(StartupError) as told:
        check_feasible(ArmModel.pa10(base=(-2.0, 0.7625, -0.06, 0.0)), SwingLimits())
    values = told.value.failure.values
    assert values["reason"].code is ReachFailure.OUT_OF_REACH
    assert values["far"] == pytest.approx(1.98, abs=0.01)
    assert values["far"] > values["length"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<robot", "<nonsense", "cannot be read"),
        ('name="w2" type="revolute"', 'name="w2" type="fixed"', "has 6 joints .* wanted 7 revolute ones"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="1 0 0"/>', "joint s2 is a RX, wanted one about y"),
        ('velocity="2"', 'velocity="0"', "joint s3 has limits .* 0 rad/s"),
        ('xyz="0 0 0.315"', 'xyz="0 0.1 0.315"', "joint s2 stands at .* wanted straight above"),
    ],
)
def test_a_bad_urdf_is_told(tmp_path, old, new, words):
    bad = tmp_path / "bad.urdf"
    bad.write_text(URDF.read_text().replace(old, new))
    with pytest.raises(TtError, match=words):
        ArmModel.pa10(urdf=str(bad))


def test_a_waiting_posture_beyond_a_limit_is_told():
    with pytest.raises(TtError, match="waiting angle of joint s1 = 4 is outside"):
        ArmModel.pa10(waiting=(4.0, 0, 0, 0, 0, 0, 0))
